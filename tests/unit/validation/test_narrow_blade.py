"""What is computed in validation.narrow_blade, without running particles."""

import dataclasses
import math

import numpy as np
import trimesh

from subsoil_ros.loading.files import shipped_material
from subsoil_ros.loading.material_file import read_material
from validation import narrow_blade as narrow
from validation.blades import Blade, Force, godwin_odogherty, perumpral

SOIL = narrow.Soil(10e3, math.radians(32.0), 1450.0, math.radians(23.0))


def row(depth_m: float, draft: float, vertical: float = 100.0, loosened: float = 1.0) -> narrow.Row:
    """A blade of 45 degrees whose theories have draft 1000 N at 0.1 m, growing as depth^1.5."""
    theory = Force(1000.0 * (depth_m / 0.1) ** 1.5, 300.0, 0.3, 0.5)
    names = ("Perumpral", narrow.GODWIN, "McKyes and Ali")
    return narrow.Row(
        45.0, 0.04, depth_m, 0.5, 2.0, 1000, draft, vertical, loosened, dict.fromkeys(names, theory), 1.0
    )


def test_what_is_missed():
    """Nothing of a blade that follows theory; one line for each thing that does not."""
    good = [row(0.1, 1000.0), row(0.2, 1000.0 * 2.0**1.5)]
    assert narrow.misses(good) == []
    assert len(narrow.misses([row(0.1, 1500.0)])) == 1
    assert "wrong sign" in narrow.misses([row(0.1, 1000.0, vertical=-5.0)])[0]
    assert "loosened 0.50 m" in narrow.misses([row(0.1, 1000.0, loosened=0.5)])[0]
    flat = [row(0.1, 1200.0), row(0.2, 1200.0 * 2.0)]
    assert narrow.misses(flat) == ["rake 45, 40 mm, 0.5 m/s: exponent over depth 1.00"]


def test_crescents_of_an_upright_blade_are_circles():
    """Their radius to each side; of a raked one less, as the circle is about a foot behind the tip."""
    upright, raked = Blade(0.04, 0.2, 0.5 * math.pi), Blade(0.04, 0.2, math.radians(45.0))
    assert math.isclose(
        narrow.crescents_m(SOIL, upright),
        0.04 + 2.0 * godwin_odogherty(SOIL, upright).rupture_m,
        rel_tol=1e-9,
    )
    assert narrow.crescents_m(SOIL, raked) < 0.04 + 2.0 * godwin_odogherty(SOIL, raked).rupture_m


def test_blade_is_sharp_and_nothing_is_below_its_tip(tmp_path):
    """A closed prism, its face at the rake, its lowest points the tip."""
    for rake in (45.0, 90.0):
        blade = Blade(0.08, 0.2, math.radians(rake))
        mesh = trimesh.load_mesh(narrow.blade_mesh(tmp_path, blade))
        assert mesh.is_watertight
        assert np.allclose(mesh.bounds[:, 1], (-0.04, 0.04))
        lowest = mesh.vertices[mesh.vertices[:, 2] < 1e-6]
        assert np.allclose(lowest[:, [0, 2]], 0.0)
        facing = mesh.face_normals[mesh.face_normals[:, 0] > 1e-6]
        assert np.allclose(facing, (math.sin(blade.rake_rad), 0.0, math.cos(blade.rake_rad)), atol=1e-6)


def test_a_nose_is_an_upright_face_below_the_raked_one(tmp_path):
    """From the tip up; the rake begins at its upper end."""
    blade = Blade(0.06, 0.2, math.radians(45.0))
    mesh = trimesh.load_mesh(narrow.blade_mesh(tmp_path, blade, 0.04))
    upright = mesh.face_normals[:, 0] > 0.999
    corners = mesh.triangles[upright].reshape(-1, 3)
    assert np.allclose(corners[:, 0], 0.0)
    assert np.isclose(corners[:, 2].min(), 0.0)
    assert np.isclose(corners[:, 2].max(), 0.04)
    raked = mesh.triangles[(mesh.face_normals[:, 0] > 0.1) & ~upright].reshape(-1, 3)
    assert np.isclose(raked[:, 2].min(), 0.04)
    assert np.isclose(raked[:, 2].max(), 0.2 + 0.15)


def test_growth_with_speed_is_judged_by_its_interval():
    """Draft may grow by more than inertia as long as the interval holds it."""

    def at(speed: float, draft: float, half: float) -> narrow.Row:
        one = row(0.1, draft)
        force = Force(1000.0 + 100.0 * speed**2, 300.0, 0.3, 0.5)
        return dataclasses.replace(
            one, speed_m_per_s=speed, half_widths=(half, 0.0), theories=dict.fromkeys(one.theories, force)
        )

    grown = list(narrow.growth([at(1.0, 1200.0, 40.0), at(0.5, 1000.0, 30.0)]))
    assert [found[1:] for found in grown] == [(200.0, 50.0, 75.0)]
    assert len(narrow.misses([at(1.0, 1200.0, 40.0), at(0.5, 1000.0, 30.0)])) == 1
    assert narrow.misses([at(1.0, 1200.0, 150.0), at(0.5, 1000.0, 30.0)]) == []


def test_means_of_seeds():
    """Intervals of independent beds add in squares."""
    assert narrow.mean_of([(1.0, 3.0), (3.0, 4.0)]) == (2.0, 2.5)


def test_soil_of_a_material():
    """What was measured of its particles, not what was asked."""
    material = read_material(shipped_material(narrow.Path("loam")), "loam")
    soil = narrow.soil_of(material)
    assert soil.cohesion_pa == material.measured["cohesion_pa"].value
    assert perumpral(soil, Blade(0.06, 0.2, math.radians(45.0))).draft_newton > 500.0
