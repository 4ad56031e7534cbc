"""Soil in LAMMPS, on one rank: the laws that it says exactly, tools, and what is refused.

On two ranks: tests/system/test_ranks.py.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.lammps import rank_tools
from subsoil_ros.errors import PhysicsError, SceneError
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import ToolMotion
from tests.physics.conftest import SoilMaker
from tests.physics.test_field import driven, field
from tests.soils import DRY, ELASTIC, LINEAR
from validation.laboratory import box_mesh

RADIUS_M, SPEED = 0.01, 1.0
SLIDING = DRY | {"static_friction": 0.4}
ELASTIC_ROW = ELASTIC | {"static_friction": 0.4, "rolling_friction": 0.0, "restitution": 0.6}
HERTZ = {"kind": "hertz_mindlin", "particle": ELASTIC_ROW, "boundary": ELASTIC_ROW}


def law(**changes: float) -> dict[str, Any]:
    """The linear law as LAMMPS has it: one friction."""
    row = SLIDING | changes
    return {"kind": "linear", "particle": row, "boundary": row}


UNDAMPED = law(damping_newton_s_per_m=0.0, tangential_damping_newton_s_per_m=0.0)


def scene_of(engine: str, soil: dict[str, Any], tools: dict[str, Any] | None = None) -> ResolvedScene:
    """A bin without weight, in one of the engines."""
    parts = {
        "engine": engine, "bin": {"length_m": 0.3, "width_m": 0.2, "depth_m": 0.2}, "monitors": None,
        "particles": {"radius_m": RADIUS_M, "density_kg_per_m3": 1800.0},
        "bed": {"kind": "grid", "spacing_m": 0.02}, "time_step_s": 1e-5, "law": law(),
    }  # fmt: skip
    document = {"name": "bin", "duration_s": 0.1, "gravity_m_per_s2": 0.0, "soil": parts | soil}
    document["coupling"] = {"communication_step_ns": 50_000}
    return load_scene(document | ({"tools": tools} if tools else {}))


def engine_of(engine: str, soil: dict[str, Any], tools: dict[str, Any] | None = None) -> SoilEngine:
    """The soil of such a bin."""
    return build_engine(scene_of(engine, soil, tools))


def collided(
    engine: SoilEngine, places: Any, velocities: Any, spins: Any = None, ticks: int = 200
) -> np.ndarray:
    """(n, 6) velocities and rim speeds after a flight of 10 ms."""
    spins = np.zeros_like(np.array(velocities)) if spins is None else spins
    engine.place(np.array(places), np.array(velocities), np.array(spins))
    engine.start(())
    for tick in range(ticks):
        engine.advance(tick, ())
    return np.hstack((engine.velocities_m_per_s(), RADIUS_M * engine.angular_velocities_rad_per_s()))


PAIR = ([[0.10, 0.0, -0.10], [0.121, 0.0, -0.10]], [[SPEED, 0.0, 0.0], [0.0, 0.0, 0.0]])


def test_a_head_on_collision_is_that_of_the_own_engine():
    """Spring and dashpot: the same sums, in another order."""
    own, theirs = (collided(engine_of(engine, {}), *PAIR) for engine in ("own", "lammps"))
    assert 0.1 < own[1, 0] < 0.99  # they met, and lost energy
    assert_allclose(theirs, own, rtol=0.0, atol=1e-10)


def test_an_oblique_collision_differs_by_the_lever_of_friction():
    """Friction acts on the radius there, on half the distance here: they differ by overlap over diameter."""
    places = [[0.10, 0.0, -0.10], [0.117, 0.012, -0.10], [0.0115, -0.05, -0.10]]  # the third meets a wall
    velocities, spins = (
        [[SPEED, 0.0, 0.3], [-0.5, 0, 0], [-SPEED, 0.7, 0.0]],
        [[3, 5, -20], [0, 10, 4], [0, 9, 2]],
    )
    found = [
        collided(engine_of(one, {"law": UNDAMPED}), places, velocities, spins) for one in ("own", "lammps")
    ]
    mass_kg = 1800.0 * 4.0 / 3.0 * np.pi * RADIUS_M**3
    overlap_m = 1.5 * SPEED * np.sqrt(mass_kg / DRY["stiffness_newton_per_m"])
    assert_allclose(found[1], found[0], rtol=0.0, atol=overlap_m / (2.0 * RADIUS_M) * SPEED)
    assert np.abs(found[0] - np.hstack((velocities, RADIUS_M * np.array(spins)))).max() > 0.3  # they met


def test_a_hertz_contact_has_its_restitution():
    """Velocities after a head-on collision of equal spheres: (1 -+ e) / 2 of the speed."""
    found = collided(engine_of("lammps", {"law": HERTZ}), *PAIR)
    assert_allclose(found[:, 0], [0.2 * SPEED, 0.8 * SPEED], atol=2e-3 * SPEED)


def test_spheres_of_several_sizes_and_layers_keep_momentum_and_restitution():
    """Two radii, two densities: v1' = (m1 - e m2) / (m1 + m2) v, v2' = (1 + e) m1 / (m1 + m2) v."""
    row = {key: value for key, value in SLIDING.items() if "damping" not in key} | {"restitution": 0.5}
    soil = {
        "law": {"kind": "linear", "particle": row, "boundary": row},
        "particles": {
            "sizes": {
                "kind": "listed",
                "radii_m": [0.008, 0.01],
                "shares": [1.0, 1.0],
                "shares_are": "number",
            },
            "density_kg_per_m3": 1800.0,
        },
        "bed": {"kind": "tiled", "seed": 1},  # not prepared here
        "layers": [{"name": "top", "thickness_m": 0.1}, {"name": "heavy", "density_kg_per_m3": 2500.0}],
    }
    places, radii = np.array([[0.05, 0.0, -0.095], [0.05, 0.0, -0.114]]), np.array([0.008, 0.01])
    bed = Bed(places, (0.0, -0.1, -0.2), (0.3, 0.1), radii_m=radii, materials=np.array([0, 1]))
    engine = SoilEngine(scene_of("lammps", soil | {"time_step_s": 1e-6}), bed)
    engine.place(places, np.array([[0.0, 0.0, -SPEED], [0.0, 0.0, 0.0]]), None, radii)
    engine.start(())
    for tick in range(60):
        engine.advance(tick, ())
    mass = np.array([1800.0, 2500.0]) * radii**3
    wanted = np.array([mass[0] - 0.5 * mass[1], 1.5 * mass[0]]) / mass.sum()
    assert_allclose(-engine.velocities_m_per_s()[:, 2], wanted * SPEED, rtol=2e-3)


def test_a_held_sphere_stays_where_it_is():
    """Another one bounces off it without loss; monitors do not count the force that the held one feels."""
    places = np.array(PAIR[0])
    bed = Bed(places, (0.0, -0.1, -0.2), (0.3, 0.1), held=np.array([False, True]))
    engine = SoilEngine(scene_of("lammps", {"law": UNDAMPED}), bed)
    engine._steps.state.particles.velocity[0, 0] = SPEED
    engine.start(())
    for tick in range(60):
        engine.advance(tick, ())
        added = 0.5e-5 * engine.forces_newton()[0] / engine.mass_kg  # in half a step
        assert_allclose(engine.motion_sums().half_speed2, added @ added, rtol=1e-9)
    assert_allclose(engine.velocities_m_per_s()[:, 0], [-SPEED, 0.0], atol=2e-3 * SPEED)
    assert_allclose(engine.positions_m()[1], places[1], rtol=0.0, atol=0.0)


def test_a_tool_strikes_as_in_the_own_engine(tmp_path: Path):
    """A box that runs into a sphere: forces, and the sphere's motion; contacts are those of dem.tools."""
    mesh = box_mesh(tmp_path, 0.02, 0.04, 0.04)
    tools = {"box": {"path": {"speed_x_m_per_s": {"kind": "constant", "value": 0.5}},
                     "groups": {"face": {"mesh": mesh}}}}  # fmt: skip
    found = []
    for name in ("own", "lammps"):
        engine = engine_of(name, {}, tools)
        engine.place(
            np.array([[0.121, 0.019, -0.105]]), np.array([[-0.5, 0.2, 0.1]]), np.array([[5.0, -9, 3]])
        )
        engine.start((ToolMotion("box", 0.1, 0.0, -0.1, 0.0, 0.5, 0.0, 0.0),))
        forces = []
        for tick in range(120):
            motion = ToolMotion("box", 0.1 + 0.5 * 5e-5 * (tick + 1), 0.0, -0.1, 0.0, 0.5, 0.0, 0.0)
            (wrench,) = engine.advance(tick, (motion,))
            engine.state_arrays()  # after it LAMMPS searches the particles near the tool anew
            forces.append([wrench.force_x_newton, wrench.torque_y_newton_m, wrench.work_joule])
        found.append((np.array(forces), engine.velocities_m_per_s(), engine.angular_velocities_rad_per_s()))
    for own, theirs in zip(*found, strict=True):
        assert_allclose(theirs, own, rtol=0.0, atol=1e-10 * np.abs(own).max())
    assert found[0][0][:, 0].min() < -1.0


def test_a_run_goes_on_from_its_state():
    """Arrays of one engine, restored in another: the same motion of a stirred bed, sides periodic.

    Without dampers and rolling: LAMMPS first computes forces at the velocities of whole steps, and lets
    springs slip by them.
    """
    soil = {"bin": {"length_m": 0.1, "width_m": 0.1, "depth_m": 0.1, "sides": "periodic"}}
    soil["law"] = law(damping_newton_s_per_m=0.0, tangential_damping_newton_s_per_m=0.0, rolling_friction=0.0)
    plain, whole, other = (engine_of("lammps", soil) for _ in range(3))
    velocities = np.random.default_rng(1).normal((0.0, 5.0, 0.0), 0.3, (whole.particle_count, 3))
    for engine in (plain, whole):
        engine.place(engine.positions_m(), velocities)
    for engine in (plain, whole, other):
        engine.start(())
    for tick in range(300):
        plain.advance(tick, ())
        whole.advance(tick, ())
    other.restore({name: array.copy() for name, array in whole.state_arrays().items()})
    assert other.state("", 299, 0).contact_count == whole.state("", 299, 0).contact_count
    for tick in range(300, 320):
        for engine in (plain, whole, other):
            engine.advance(tick, ())
    assert_array_equal(whole.positions_m(), plain.positions_m())
    moved = whole.displacements_m()
    assert moved[:, 1].min() > 0.06  # some have crossed the sides, y = 0.05 m
    assert_allclose(other.displacements_m(), moved, rtol=0.0, atol=1e-9)
    state = whole.state("", 319, 0)
    assert state.contact_count > 0
    assert state.max_overlap_m > 0.0


def test_a_particle_between_too_many_tools_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """More contacts than are kept: refused, not forgotten."""
    monkeypatch.setattr(rank_tools, "SLOTS", 1)
    mesh = box_mesh(tmp_path, 0.02, 0.04, 0.04)
    tools = {name: {"path": {}, "groups": {"face": {"mesh": mesh}}} for name in ("a", "b")}
    engine = engine_of("lammps", {}, tools)
    engine.place(np.array([[0.121, 0.0, -0.1], [0.2, 0.0, -0.1]]))
    places = [ToolMotion(name, x, 0.0, -0.1, 0.0, 0.0, 0.0, 0.0) for name, x in (("a", 0.1), ("b", 0.142))]
    engine.start(tuple(places))
    nearer = [
        ToolMotion("a", 0.1015, 0.0, -0.1, 0.0, 0.0, 0.0, 0.0),
        ToolMotion("b", 0.1405, 0.0, -0.1, 0, 0, 0, 0),
    ]
    with pytest.raises(PhysicsError, match="more than 1 contacts with tools, one of them b"):
        engine.advance(0, tuple(nearer))


@pytest.mark.parametrize(
    ("soil", "words"),
    [
        ({"law": LINEAR}, "LAMMPS has one number for both"),
        ({"law": HERTZ | {"boundary": ELASTIC_ROW | {"rolling_friction": 0.1}}}, "grow with a Hertz contact"),
        ({"law": law(damping_newton_s_per_m=0.0)}, "beside a damping_newton_s_per_m of 0"),
        ({"precision": "mixed"}, "precision: given mixed"),
        ({"device": "gpu"}, "device: given gpu"),
        ({"monitors": {"max_energy_defect": 1e-3}}, "monitors.max_energy_defect: given 0.001"),
    ],
)  # fmt: skip
def test_what_lammps_cannot_compute_is_refused(soil: dict[str, Any], words: str):
    """When the scene is read."""
    with pytest.raises(SceneError, match=words):
        engine_of("lammps", soil)


def test_cohesion_is_refused():
    """In a shipped soil."""
    box = {"length_m": 0.2, "width_m": 0.2, "depth_m": 0.2}
    soil = {"material": "loam", "engine": "lammps", "particles": {"radius_m": 0.01}, "bin": box}
    with pytest.raises(
        SceneError, match=r"law\.kind: given 'cohesive_linear'; LAMMPS has linear and hertz_mindlin"
    ):
        load_scene({"name": "loam", "duration_s": 1.0, "soil": soil | {"bed": {"seed": 1}}})


def test_the_whole_field_of_a_window_is_laid_out(soil: SoilMaker):
    """Held sides and floor; the first forces on a bar are those of the own engine in its window."""
    found = []
    for engine in ("own", "lammps"):
        scene = field(soil, engine=engine, law=law(), monitors=None)
        made, wrenches = driven(scene, ticks=30)
        found.append((made.particle_count, np.array([wrench[0].force_x_newton for wrench in wrenches])))
    (part, own), (whole, theirs) = found
    assert whole > 3 * part
    assert_allclose(theirs, own, atol=0.02 * np.abs(own).max())
