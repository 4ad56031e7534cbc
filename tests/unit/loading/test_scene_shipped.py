"""The shipped scenes: they load, come back from a written scene, and start as their text says."""

from math import cos, sin
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from subsoil_ros.errors import SceneError
from subsoil_ros.limits.communication_steps import coupling_bounds
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.messages import BodyState
from subsoil_ros.scene.tool_mesh import load_tool_mesh

SCENES = Path(__file__).parents[3] / "config" / "scenes"
NAMES = sorted(path.stem for path in SCENES.glob("*.yaml"))


def shipped(name: str, *overrides: str) -> ResolvedScene:
    return load_scene(SCENES / f"{name}.yaml", overrides)


def first_bodies(resolved: ResolvedScene) -> dict[str, BodyState]:
    state = MechanismEngine(resolved.scene, resolved.timing).state("run", -1, 0)
    return {body.name: body for body in state.bodies}


def tip_m(resolved: ResolvedScene, shank: BodyState) -> tuple[float, float]:
    scene = resolved.scene
    assert scene.mechanism is not None
    assert scene.report.tip_m is not None
    reference = scene.mechanism.bodies["shank"].position_m
    dx, dz = scene.report.tip_m[0] - reference[0], scene.report.tip_m[1] - reference[1]
    c, s = cos(shank.angle_rad), sin(shank.angle_rad)
    return shank.x_m + c * dx - s * dz, shank.z_m + s * dx + c * dz


def test_names() -> None:
    """The scenes that the documentation names are there."""
    assert {"subsoiler_1s300", "subsoiler_1s300_quick", "tine", "mechanism_only"} <= set(NAMES)


@pytest.mark.full
@pytest.mark.parametrize("name", NAMES)
def test_round_trip(name: str, tmp_path: Path) -> None:
    """Written as a run writes it, a scene loads from another folder with the same hash."""
    first = shipped(name)
    first.write(tmp_path / "scene.yaml")
    second = load_scene(tmp_path / "scene.yaml")
    assert second.scene_hash == first.scene_hash
    assert second.document == first.document
    assert second.timing == first.timing


def test_same_machine_and_soil_law() -> None:
    """The quick scene differs from the paper's in bin and wheels, not in bodies, joints, spring or law."""
    full, quick = (
        shipped("subsoiler_1s300", "initial_condition=lowered").scene,
        shipped("subsoiler_1s300_quick").scene,
    )
    assert full.mechanism is not None
    assert quick.mechanism is not None
    assert full.soil is not None
    assert quick.soil is not None
    assert quick.mechanism.bodies == full.mechanism.bodies
    assert quick.mechanism.joints == full.mechanism.joints
    assert quick.mechanism.forces["H9_spring"] == full.mechanism.forces["H9_spring"]
    assert quick.soil.law == full.soil.law
    assert quick.tools == {"shank": full.tools["shank"]}
    assert "not the paper's" in quick.report.note


def test_end_wall_start() -> None:
    """At rest; the wheels touch the surface inside the bin, the tip is behind x = 0, near its depth."""
    resolved = shipped("subsoiler_1s300")
    bodies = first_bodies(resolved)
    assert_allclose([bodies["wheel_left"].z_m, bodies["wheel_right"].z_m], 0.20, atol=1e-9)
    assert bodies["wheel_left"].x_m - 0.20 > 0.0
    x, z = tip_m(resolved, bodies["shank"])
    assert x < -0.1
    assert_allclose(z, -0.305 + 0.028, atol=0.002)  # they sink by 28 mm (yuan_yu_2020/depth_wheel.md)
    assert_allclose([body.velocity_x_m_per_s for body in bodies.values()], 0.0, atol=1e-12)


def test_lowered_start() -> None:
    """Moving at 0.5 m/s, the tip within 10 mm above the surface inside the bin, the wheels above it."""
    resolved = shipped("subsoiler_1s300", "initial_condition=lowered")
    bodies = first_bodies(resolved)
    x, z = tip_m(resolved, bodies["shank"])
    assert 0.1 < x < 0.3
    assert 0.0 < z < 0.01
    assert bodies["wheel_left"].z_m > 0.20
    assert_allclose([body.velocity_x_m_per_s for body in bodies.values()], 0.5, atol=1e-9)


def test_quick_start() -> None:
    """In equilibrium on sunk wheels, the tip 50 mm before the bin and above its floor."""
    resolved = shipped("subsoiler_1s300_quick")
    assert resolved.scene.soil is not None
    bodies = first_bodies(resolved)
    x, z = tip_m(resolved, bodies["shank"])
    assert_allclose(x, -0.05, atol=0.005)
    assert -resolved.scene.soil.bin.depth_m + 0.03 < z < -0.30
    assert_allclose(bodies["wheel_left"].z_m, 0.172, atol=0.001)  # 784 N on 28 kN/m, the reference pose
    accelerations = [abs(body.acceleration_z_m_per_s2) for body in bodies.values()]
    assert_allclose(accelerations, 0.0, atol=1e-3)


def test_coupling_bounds_of_the_full_scene() -> None:
    """The bounds follow from the law and the mass, and the default interval is far below them."""
    resolved = shipped("subsoiler_1s300")
    scene = resolved.scene
    meshes = {name: load_tool_mesh(resolved.directory, scene, name) for name in scene.tools}
    bounds = {bound.tool: bound for bound in coupling_bounds(scene, meshes)}
    stiffness, damping = 10.0 * 10e3 * 16e3 / 26e3, 20.0 * 20.0 / 40.0
    wheel = bounds["wheel_left"]
    assert_allclose(wheel.undamped_s, 2.0 * damping / stiffness, rtol=1e-12)
    mass_kg = 1.0 / (1.0 / 25.0 + 0.20**2 / 0.5585)  # the rim is the farthest point
    assert_allclose(wheel.effective_mass_kg, mass_kg, rtol=1e-6)
    assert_allclose(wheel.unstable_s, 2.0 * mass_kg / (wheel.contact_count * damping), rtol=1e-6)
    assert all(
        5.0 * resolved.timing.communication_step_s < min(b.undamped_s, b.unstable_s) for b in bounds.values()
    )
    assert resolved.timing.soil_steps == 1  # without soil.material: every step
    coarse = {"force": "tick_mean", "communication_step_ns": 4 * resolved.timing.communication_step_ns}
    mean = scene.model_copy(update={"coupling": scene.coupling.model_copy(update=coarse)})
    assert_allclose(coupling_bounds(mean, meshes)[0].undamped_s, damping / stiffness / (1.0 - 1.0 / 8.0))


@pytest.mark.parametrize(
    ("change", "steps"),
    [
        ({}, 7),  # (0.8 x 3 (C / K) (m / k))^(1/3), 623 us, over steps of 81 us
        ({"soil.material": "loam_bonded"}, 9),  # 626 us over 63 us
        ({"soil.time_step_s": 2.0e-5}, 31),
        ({"coupling.force": "tick_end"}, 2),  # 0.8 of 2 C / K, 194 us
        ({"coupling.force": "tick_mean"}, 1),  # of two steps it is 3/4 of the interval old, so 130 us
        ({"coupling.communication_step_ns": "soil_step"}, 1),
        ({"coupling.communication_step_ns": 567_000}, 7),
    ],
)
def test_a_soil_by_its_strength_exchanges_within_the_bounds(change: dict[str, object], steps: int) -> None:
    """As many whole soil steps as fit in 0.8 of what is stable; a written scene keeps them."""
    resolved = load_scene("field_swing", change)
    assert resolved.timing.soil_steps == steps
    again = load_scene(resolved.document)
    assert (again.timing, again.scene_hash) == (resolved.timing, resolved.scene_hash)


def test_soil_steps_need_particles() -> None:
    """An exchange every soil step is refused where there is none."""
    with pytest.raises(SceneError, match="communication_step_ns: soil_step, but there are no particles"):
        shipped("subsoiler_1s300_wedge", "coupling.communication_step_ns=soil_step")
