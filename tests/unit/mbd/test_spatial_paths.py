"""Paths in space, and motions in space on their way through messages, checkpoints and series."""

import copy
import json
import math
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from subsoil_ros.coupling.checkpoints import CouplingState
from subsoil_ros.coupling.energy_account import InterfaceWork, held_work_joule
from subsoil_ros.errors import SceneError
from subsoil_ros.limits.communication_steps import coupling_bounds
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.mbd.tool_paths import PathEngine
from subsoil_ros.messages import SpatialMotion, ToolMotion, ToolMotions, ToolWrench
from subsoil_ros.recording.checkpoint import Checkpoint
from subsoil_ros.recording.message_codec import reader, writer
from subsoil_ros.recording.types import deserialize, message_type
from subsoil_ros.rotations import (
    matrix_of,
    placed_m,
    planar_quaternion,
    product,
    quaternion_of,
    rotation_between,
    turned,
)
from subsoil_ros.scene.tool_mesh import load_tool_mesh
from tests.soils import BOUNDARY, PARTICLE

MOTION = SpatialMotion.of("tool", (0.1, -0.2, 0.3), (0.5, -0.5, 0.1, 0.7), (1.0, 2.0, 3.0), (-4.0, 5.0, 6.0))
POSES = {
    "times_s": [0.0, 0.4, 1.0],
    "positions_m": [[0.0, 0.0, 0.0], [0.1, 0.05, -0.1], [0.3, 0.0, 0.0]],
    "rotations_rad": [[0.0, 0.0, 0.0], [0.2, -1.0, 0.4], [0.0, -2.0, 1.0]],
}
TICKS = ("soil.time_step_s=1e-4", "allow=[unstable_time_step]")
SPUN = {"axis": [0.0, 2.0, 0.0], "speed_rad_per_s": {"kind": "ramp", "end_value": 6.0, "end_s": 0.5}}
ROLLING = {"axis": [0.0, 1.0, 0.0], "free": {"inertia_kg_m2": 0.02}}


def spun(folder: Path, path: dict[str, Any], *overrides: str, **tool: Any) -> ResolvedScene:
    """A scene of one disc, its axis y, radius 0.1 m, on this path."""
    mesh = trimesh.creation.cylinder(radius=0.1, height=0.02, sections=24)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.5 * math.pi, (1, 0, 0)))
    mesh.export(folder / "disc.stl")
    document = {
        "name": "disc",
        "duration_s": 1.0,
        "soil": {
            "bin": {"length_m": 0.3, "width_m": 0.2, "depth_m": 0.1},
            "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
            "bed": {"kind": "grid", "spacing_m": 0.018},
            "law": {"kind": "cohesive_linear", "particle": PARTICLE, "boundary": BOUNDARY},
        },
        "tools": {"tool": {"path": copy.deepcopy(path), "groups": {"disc": {"mesh": "disc.stl"}}, **tool}},
    }
    (folder / "scene.yaml").write_text(yaml.safe_dump(document))
    return load_scene(folder / "scene.yaml", overrides)


def test_rotations_are_those_of_scipy() -> None:
    """Products, rotation vectors, matrices, the shortest way between two orientations."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        vectors = rng.normal(size=(2, 3)) * rng.choice((1e-9, 0.1, 2.0))
        first, second = map(Rotation.from_rotvec, vectors)
        a, b = (quaternion_of(tuple(vector)) for vector in vectors.tolist())
        assert (Rotation.from_quat(product(b, a)) * (second * first).inv()).magnitude() < 1e-14
        assert_allclose(rotation_between(a, b), (second * first.inv()).as_rotvec(), atol=1e-14)
        negative = tuple(-part for part in b)
        assert_allclose(rotation_between(a, negative), (second * first.inv()).as_rotvec(), atol=1e-14)
        assert_allclose(np.reshape(matrix_of(a), (3, 3)), first.as_matrix(), atol=1e-15)
        point = rng.normal(size=(4, 3))
        assert_allclose(turned(a, tuple(point[0])), first.apply(point[0]), atol=1e-15)
        assert_allclose(placed_m(point, (1.0, 2.0, 3.0), a), first.apply(point) + np.arange(1, 4), atol=1e-14)
    assert_allclose(turned(planar_quaternion(0.3), (1.0, 0.0, 0.0)), (math.cos(0.3), 0.0, math.sin(0.3)))


def test_a_planar_motion_has_a_quaternion_and_the_vectors_of_its_twist() -> None:
    """From the angle, which turns about -y; what a message of it has held so far."""
    motion = ToolMotion("tool", 0.1, 0.2, 0.3, 7.0, 1.0, 2.0, 3.0)
    assert motion.quaternion == (0.0, -math.sin(3.5), 0.0, math.cos(3.5))
    assert motion.velocity_m_per_s == (1.0, 0.0, 2.0)
    assert motion.spin_rad_per_s == (0.0, -3.0, 0.0)


def test_a_motion_in_space_comes_back_from_messages_and_documents() -> None:
    """All of it, exactly, and its planar angle is none."""
    assert math.isnan(MOTION.angle_rad)
    record = ToolMotions("run", 3, 4_000, (MOTION, ToolMotion("b", *map(float, range(7)))))
    data = writer(ToolMotions, 1_000)(record)
    assert repr(reader(ToolMotions)(data)) == repr(record)
    message = deserialize(data, message_type(ToolMotions))
    pose, twist = message.tools[0].pose, message.tools[0].twist
    assert (pose.position.y, pose.orientation.w, twist.linear.y, twist.angular.y) == (-0.2, 0.7, 2.0, 5.0)
    document = json.loads(json.dumps(asdict(MOTION)))
    assert repr(SpatialMotion(**document)) == repr(MOTION)
    assert [item.name for item in fields(ToolMotion)] == list(document)[:8]


def test_a_motion_in_space_comes_back_from_a_checkpoint() -> None:
    """Planar and spatial motions of one exchange, through the document that a checkpoint keeps."""
    planar = ToolMotion("b", 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    state = CouplingState(7, (MOTION, planar), (), InterfaceWork())
    document = json.loads(json.dumps(state.document())) | {"wall_time_s": 0.0}
    assert list(document["motions"][1]) == [item.name for item in fields(ToolMotion)]
    kept = Checkpoint(Path("there"), 7, 0.0, "run", document, {})
    assert repr(CouplingState.of(kept)) == repr(state)


def test_all_six_components_of_a_held_wrench_do_work() -> None:
    """Force times way and torque times angle, for a torque about the axis of the rotation."""
    axis = np.array((0.6, 0.0, 0.8))
    at = (Rotation.from_rotvec(axis * angle) for angle in (0.3, 0.7))
    ends = [
        SpatialMotion.of("tool", place, tuple(turn.as_quat()), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        for place, turn in zip(((0.0, 0.0, 0.0), (0.1, -0.2, 0.3)), at, strict=True)
    ]
    wrench = ToolWrench("tool", 1.0, 2.0, 3.0, *(5.0 * axis), 0.0, 0)
    assert held_work_joule(wrench, *ends) == pytest.approx(0.1 - 0.4 + 0.9 + 5.0 * 0.4, rel=1e-12)


@pytest.mark.parametrize(
    "path",
    [
        {"start_angle_rad": 0.4, "speed_y_m_per_s": {"kind": "sine", "amplitude": 0.3, "frequency_hz": 2.0}},
        {"turn": {"start_rotation_rad": [0.2, 0.1, 0.9], **SPUN}, "start_z_m": 0.05},
        {"poses": POSES},
    ],
)
def test_velocities_are_the_derivatives_of_poses(tmp_path: Path, path: dict[str, Any]) -> None:
    """Along time functions, about an axis, through poses: central differences of the poses of three ticks."""
    step_s = 1e-4
    resolved = spun(tmp_path, path, *TICKS)
    engine = PathEngine(resolved.scene, resolved.timing)
    (before,), (now,) = engine.initial_motions(), engine.advance(0)
    assert isinstance(before, SpatialMotion)
    moved = 0.0
    for tick in range(1, 9_000):
        (after,) = engine.advance(tick)
        if tick % 300 == 0:
            way = (np.array(after.position_m) - before.position_m) / (2.0 * step_s)
            turn = np.array(rotation_between(before.quaternion, after.quaternion)) / (2.0 * step_s)
            assert_allclose(now.velocity_m_per_s, way, atol=2e-5)
            assert_allclose(now.spin_rad_per_s, turn, atol=2e-5)
            moved = max(moved, float(np.abs(way).max()), float(np.abs(turn).max()))
        before, now = now, after
    assert moved > 0.1


def test_poses_are_passed_through(tmp_path: Path) -> None:
    """At their times, from the first to the last."""
    resolved = spun(tmp_path, {"poses": POSES}, *TICKS)
    engine = PathEngine(resolved.scene, resolved.timing)
    motions = [engine.initial_motions()[0], *(engine.advance(tick)[0] for tick in range(10_000))]
    for k, time_s in enumerate(POSES["times_s"]):
        motion = motions[round(time_s / 1e-4)]
        assert_allclose(motion.position_m, POSES["positions_m"][k], atol=1e-12)
        given = Rotation.from_rotvec(POSES["rotations_rad"][k])
        assert (given.inv() * Rotation.from_quat(motion.quaternion)).magnitude() < 1e-9


def test_a_constant_torque_turns_a_free_disc_as_in_the_book(tmp_path: Path) -> None:
    """angle = torque t^2 / (2 I), exactly; the torque about the axis counts alone."""
    resolved = spun(tmp_path, {"turn": {"start_rotation_rad": [0.0, 0.0, 0.5 * math.pi], **ROLLING}})
    engine = PathEngine(resolved.scene, resolved.timing)
    engine.initial_motions()
    held = ToolWrench("tool", 9.0, 9.0, 9.0, -0.05, 0.3, 0.7, 0.0, 1)  # the axis is -x
    for tick in range(500):
        (motion,) = engine.advance(tick, (held,))
    time_s = 500 * resolved.timing.communication_step_s
    assert_allclose(motion.spin_rad_per_s, (-2.5 * time_s, 0.0, 0.0), rtol=1e-12, atol=1e-15)
    start = (0.0, 0.0, math.sin(0.25 * math.pi), math.cos(0.25 * math.pi))
    angle = 0.5 * 2.5 * time_s**2
    assert_allclose(rotation_between(start, motion.quaternion), (-angle, 0.0, 0.0), rtol=1e-9, atol=1e-12)


def test_a_free_disc_has_a_coupling_bound(tmp_path: Path) -> None:
    """Its effective mass is J / r^2, here 0.02 / 0.1^2, wherever it stands."""
    resolved = spun(tmp_path, {"turn": {"start_rotation_rad": [0.3, 0.2, 1.0], **ROLLING}}, lateral_m=0.05)
    mesh = load_tool_mesh(resolved.directory, resolved.scene, "tool")
    (bound,) = coupling_bounds(resolved.scene, {"tool": mesh})
    assert bound.effective_mass_kg == pytest.approx(0.02 / (0.1**2), rel=1e-6)


HALF = {"times_s": [0.0, 1.0], "positions_m": [[0, 0, 0]] * 2, "rotations_rad": [[0, 0, 0], [0, 0, math.pi]]}


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ({"turn": SPUN, "start_angle_rad": 0.1}, "given 'turn' and start_angle_rad; with 'turn' give"),
        ({"poses": POSES, "start_x_m": 0.1}, "given 'poses' and start_x_m; 'poses' takes no other keys"),
        ({"poses": POSES | {"times_s": [0.0, 0.4, 0.9]}}, "ends at 0.9 s, before duration_s 1"),
        ({"poses": POSES | {"times_s": [0.1, 0.4, 1.0]}}, "times_s: must begin with 0 and increase"),
        ({"poses": POSES | {"positions_m": [[0, 0, 0]]}}, "positions_m: has 1 entries, times_s has 3"),
        ({"poses": HALF}, "half a turn from entry 0 to 1"),
        ({"turn": {"axis": [0, 1, 0]}}, "'axis' goes with 'speed_rad_per_s' or 'free'"),
        ({"turn": SPUN | {"axis": [0, 0, 0]}}, "axis: given (0, 0, 0), which has no direction"),
        ({"turn": SPUN | ROLLING}, "given both 'speed_rad_per_s' and 'free'"),
        ({"turn": ROLLING | {"free": {"inertia_kg_m2": 0.0}}}, "inertia_kg_m2"),
    ],
)
def test_a_path_in_space_that_cannot_be_is_refused(
    tmp_path: Path, path: dict[str, Any], message: str
) -> None:
    """With one message that names the key."""
    with pytest.raises(SceneError) as caught:
        spun(tmp_path, path)
    assert message in str(caught.value)


def test_soils_that_cannot_follow_refuse_paths_in_space(tmp_path: Path) -> None:
    """The wedge model takes no turned tools; poses have a y of their own."""
    with pytest.raises(SceneError, match=r"tools.tool.lateral_m: given 0.1 with path.poses"):
        spun(tmp_path, {"poses": POSES}, lateral_m=0.1)
    wedge = {
        "model": "wedge",
        "bin": {"length_m": 1.0, "width_m": 0.4, "depth_m": 0.3},
        "values": {
            "density_kg_per_m3": 1300.0, "cohesion_pa": 2e4, "friction_angle_rad": 0.4, "adhesion_pa": 5e3,
            "tool_friction_angle_rad": 0.3,
        },
    }  # fmt: skip
    with pytest.raises(SceneError, match=r"tools.tool.path: turn.axis: turns the tool.*wedge"):
        spun(tmp_path, {"turn": SPUN}, f"soil={json.dumps(wedge)}")
