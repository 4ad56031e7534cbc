"""Element tests: mean stress, affine strain and similarity of endless soil."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.dem.bed import Bed, ignore_progress, scaled
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.packing.periodic_sample import at_pressure, endless_soil
from subsoil_ros.dem.packing.relaxation import Settling
from subsoil_ros.experiments.element_tests import (
    Cell,
    confined_modulus_pa,
    fit_strength,
    plane_strain,
    prepare_cell,
    tensile_strength_pa,
    unconfined_strength_pa,
)
from subsoil_ros.limits.stable_steps import SAFETY, step_limits
from subsoil_ros.loading.loader import ResolvedScene, load_scene

STIFFNESS, RADIUS = 8e4, 0.01


def scene(ratio: float = 1.0, friction: float = 0.5, attraction: float = 0.0) -> ResolvedScene:
    """Spheres `ratio` times as large as those that the law is for."""
    radius = ratio * RADIUS
    row = {
        "stiffness_newton_per_m": STIFFNESS, "tangential_stiffness_newton_per_m": 0.8 * STIFFNESS,
        "damping_newton_s_per_m": 4.0, "tangential_damping_newton_s_per_m": 2.0,
        "static_friction": friction, "sliding_friction": friction, "rolling_friction": 0.1,
    }  # fmt: skip
    law: dict[str, object] = {"kind": "linear", "particle": row, "boundary": row}
    if attraction > 0.0:
        row |= {"cohesive_stiffness_newton_per_m": attraction / 5e-4, "cohesion_range_m": 5e-4}
        row |= {"equilibrium_overlap_m": 2e-5}
        law |= {"kind": "cohesive_linear", "combining_rule": "none"}
    edge = 18.0 * radius
    return load_scene(
        {
            "name": "cell",
            "duration_s": 1.0,
            "soil": {
                "bin": {"length_m": edge, "width_m": edge, "depth_m": edge},
                "particles": {
                    "sizes": {
                        "kind": "uniform",
                        "min_radius_m": 0.85 * radius,
                        "max_radius_m": 1.15 * radius,
                    },
                    "density_kg_per_m3": 2400.0,
                    "reference_radius_m": RADIUS,
                },
                "bed": {"kind": "tiled", "solid_fraction": 0.60},
                "law": law,
            },
        }
    )


def at_rest(resolved: ResolvedScene, pressure_pa: float) -> SoilEngine:
    """An engine with a cell at rest at a pressure."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    cell = prepare_cell(resolved, edge_m=soil.bin.length_m)
    endless = endless_soil(soil, soil.bin.length_m)
    settling = Settling(
        resolved, 1, soil=endless, step_s=SAFETY * step_limits(endless)[0].limit_s,
        gravity_m_per_s2=0.0,
    )  # fmt: skip
    engine = settling.engine(at_pressure(settling, cell.sample, pressure_pa, ignore_progress))
    engine.start(())
    return engine


def test_stress_of_a_cubic_lattice():
    """Columns of equal spheres, overlapping by other parts along x, y and z: force over the area of a
    column."""
    resolved = scene()
    soil = resolved.scene.particle_soil
    assert soil is not None
    spacing = 2.0 * RADIUS * np.array((0.998, 0.997, 0.996))
    low = -0.5 * 8 * spacing
    cells = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), -1).reshape(-1, 3)
    bed = Bed(
        (cells + 0.5) * spacing + (0.0, low[1], -8 * spacing[2]), (0.0, low[1], -8 * spacing[2]),
        (8 * spacing[0], -low[1]), radii_m=np.full(512, RADIUS), sides="endless",
    )  # fmt: skip
    endless = endless_soil(soil, 0.16)
    engine = Settling(resolved, 1, soil=endless, step_s=1e-5, gravity_m_per_s2=0.0).engine(bed)
    engine.start(())
    ratio = soil.particles.mean_volume_radius_m / RADIUS  # the law is scaled with it
    force = ratio * STIFFNESS * (2.0 * RADIUS - spacing)
    area = np.prod(spacing) / spacing
    assert_allclose(engine.stress_pa(), np.diag(force / area), rtol=1e-9, atol=1e-6)


def test_strain_does_the_work_that_is_stored():
    """Without sliding, energy grows by - volume x stress x strain, tangential springs included: stress and
    strain belong together. (Without attraction, contacts that open would slide.)"""
    engine = at_rest(scene(friction=50.0, attraction=4.0), 5e3)
    rate = np.array((2e-7, 3e-7, -8e-7))
    for _ in range(100):  # springs have some stress
        engine.resize(1.0 + rate)
    before, work = engine.potential_joule(), 0.0
    for _ in range(100):
        stress = np.diagonal(engine.stress_pa())
        volume = np.prod(engine.bed.periods_m)
        engine.resize(1.0 + rate)
        middle = 0.5 * (stress + np.diagonal(engine.stress_pa()))
        work -= float(volume * middle @ rate)
    sheared = engine.state_arrays()["pairs.history"]
    assert np.abs(sheared).max() > 1e-7
    assert_allclose(engine.potential_joule() - before, work, rtol=2e-4)


def test_scaled_soil_is_the_same_soil():
    """Spheres 1.5 times as large, the law scaled: the same stresses at the same strains, to round-off."""
    cell = prepare_cell(scene(attraction=2.0), edge_m=18.0 * RADIUS)
    larger = scaled(cell.sample, np.full(3, 1.5))
    larger = replace(larger, radii_m=1.5 * larger.radii_m)
    one = plane_strain(cell, 5e3, 2e-3)
    other = plane_strain(Cell(scene(1.5, attraction=2.0), larger, 1), 5e3, 2e-3)
    assert_allclose(other.strain[:60], one.strain[:60], rtol=1e-6)
    assert_allclose(other.greatest_pa[:60], one.greatest_pa[:60], rtol=1e-5)


def test_cohesion_and_tension():
    """Attraction makes cohesion, and a tension below Rumpf's and below what the strength allows; dry soil has
    neither, and softens to its critical state."""
    cell = prepare_cell(scene(attraction=4.0), edge_m=18.0 * RADIUS)
    dry_cell = prepare_cell(scene(), edge_m=18.0 * RADIUS)
    found = []
    for one in (cell, dry_cell):
        curves = [plane_strain(one, least) for least in (5e3, 1e4)]
        assert max(curve.held_to for curve in curves) < 0.02
        found.append(fit_strength(*zip(*(curve.peak_pa() for curve in curves), strict=True)))
    bonded, dry = found
    assert abs(dry.cohesion_pa) < 300.0 < 2000.0 < bonded.cohesion_pa
    assert 33.0 < dry.friction_angle_deg < 40.0
    rumpf = 0.6 * 6.5 * 4.0 / (np.pi * (2.0 * RADIUS) ** 2)
    allowed = bonded.cohesion_pa / np.tan(np.radians(bonded.friction_angle_deg))
    assert 0.3 * rumpf < tensile_strength_pa(cell, 0.05) < min(rumpf, allowed)
    assert tensile_strength_pa(dry_cell, 0.02) < 50.0
    flowing = plane_strain(dry_cell, 1e4, 0.3, to_peak=False)
    ratios = [greatest / least for least, greatest in (flowing.peak_pa(), flowing.critical_pa())]
    assert 2.5 < ratios[1] < 0.97 * ratios[0]
    assert flowing.volume_strain[-1] > 0.01


def test_confined_modulus():
    """Of the order of that of particles that move with the mean strain, n_c d^2 (K / 5 + 2 K_t / 15), and
    below it (K. Walton, J. Mech. Phys. Solids 35 (1987) 213)."""
    cell = prepare_cell(scene(friction=0.5), edge_m=18.0 * RADIUS)
    found = confined_modulus_pa(cell)
    contacts = 3.0 * 0.61 * 5.5 / (np.pi * (2.0 * RADIUS) ** 3)
    affine = contacts * (2.0 * RADIUS) ** 2 * (STIFFNESS / 5.0 + 2.0 * 0.8 * STIFFNESS / 15.0)
    assert 0.4 * affine < found < affine


@pytest.mark.full
def test_a_preload_strengthens_what_yields_and_sticks() -> None:
    """After 80 kPa the unconfined strength is a multiple of that after 5 kPa; without attraction there
    is next to none."""
    document = scene().document
    row = {
        "youngs_modulus_pa": 1.5e7, "poisson_ratio": 0.3, "restitution": 0.5, "contact_plasticity": 0.75,
        "surface_energy_joule_per_m2": 300.0, "static_friction": 0.3, "sliding_friction": 0.3,
        "rolling_friction": 0.1,
    }  # fmt: skip
    found = []
    for energy, preload_pa in ((300.0, 5e3), (300.0, 8e4), (0.0, 8e4)):
        row["surface_energy_joule_per_m2"] = energy
        law = {"kind": "elasto_plastic_adhesive", "particle": row, "boundary": row}
        resolved = load_scene(document | {"soil": document["soil"] | {"law": law}})
        soil = resolved.scene.particle_soil
        assert soil is not None
        found.append(
            unconfined_strength_pa(prepare_cell(resolved, edge_m=soil.bin.length_m), preload_pa, 0.05)
        )
    assert found[1] > 3.0 * found[0] > 0.0
    assert found[2] < 0.15 * found[1]
