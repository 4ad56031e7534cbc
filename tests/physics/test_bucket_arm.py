"""The example examples/bucket_arm: the arm follows its waypoints and the sand resists."""

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import subsoil_ros as subsoil

pytest.importorskip("mujoco", reason="needs the extra mujoco")

EXAMPLE = Path(__file__).parents[2] / "examples" / "bucket_arm"


@pytest.fixture(scope="module")
def bucket() -> ModuleType:
    """The example's module."""
    spec = importlib.util.spec_from_file_location("bucket_arm", EXAMPLE / "bucket.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("time_s", [0.0, 0.3, 1.0, 1.7, 2.6, 3.0])
def test_the_angles_reach_the_waypoints(bucket: ModuleType, time_s: float) -> None:
    """Forward kinematics of the inverse gives back the pin and the pitch."""
    x, z, pitch, yaw = bucket.pose_at(time_s)
    turn, shoulder, elbow, wrist = bucket.angles_of(x, z, pitch, yaw)
    fore = shoulder + elbow
    along = bucket.UPPER_M * math.cos(shoulder) + bucket.FORE_M * math.cos(fore)
    down = bucket.UPPER_M * math.sin(shoulder) + bucket.FORE_M * math.sin(fore)
    np.testing.assert_allclose(
        (bucket.SHOULDER_M[0] + along, bucket.SHOULDER_M[1] - down, fore + wrist, turn), (x, z, pitch, yaw)
    )


def test_the_bucket_goes_into_the_sand(bucket: ModuleType) -> None:
    """On its way within the compliance of the servos, pushed up by the sand, energy balanced."""
    scene = subsoil.load_scene(EXAMPLE / "bucket.yaml", {"duration_s": 0.5})
    run = subsoil.run(scene, machine=bucket.machine_of(scene))
    series = run.series
    asked = np.array([bucket.pose_at(time) for time in series["time_s"]])
    assert np.abs(series["tool.bucket.x_m"] - asked[:, 0]).max() < 0.02
    assert np.abs(series["tool.bucket.z_m"] - asked[:, 1]).max() < 0.02
    inside = series["time_s"] > 0.4
    assert series["tool.bucket.force_z_newton"][inside].mean() > 5.0
    assert series["tool.bucket.force_z_newton"][series["time_s"] < 0.1].abs().max() == 0.0
    assert run.summary["energy"]["residual_ratio"] < 0.05


def test_the_free_arm_says_where_it_is_and_feels_a_wrench(
    bucket: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the waypoints within the compliance of the servos; pushed up by 200 N for as long as that is new."""
    rclpy = pytest.importorskip("rclpy", reason="needs ROS")
    from geometry_msgs.msg import PoseStamped, WrenchStamped

    monkeypatch.syspath_prepend(str(EXAMPLE))
    free = importlib.import_module("free")
    heights = {}
    rclpy.init()
    try:
        for newton in (0.0, 200.0):
            arm, poses = free.FreeArm(), list[PoseStamped]()
            monkeypatch.setattr(arm._pose, "publish", poses.append)
            push = WrenchStamped()
            x, z = math.sin(-0.7), math.cos(-0.7)  # the bucket is pitched by -0.7 rad
            push.wrench.force.x, push.wrench.force.z = -newton * x, newton * z
            arm._feel(push)
            arm.advance(0.2)
            heights[newton] = poses[-1].pose.position.z
            assert heights[newton] == pytest.approx(bucket.pose_at(0.2)[1], abs=0.02)
            assert poses[-1].pose.orientation.y == pytest.approx(math.sin(-0.35), abs=0.01)
            arm._felt_s -= 1.0
            arm.advance(0.01)
            assert not arm._load.any()
            arm.node.destroy_node()
    finally:
        rclpy.shutdown()
    assert heights[200.0] > heights[0.0] + 1e-4


def test_the_free_loader_feels_a_wrench_as_the_arm_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """The joints are at the waypoints; lift and curl carry less by the force and the moment of the soil."""
    bullet = pytest.importorskip("pybullet", reason="needs PyBullet")
    rclpy = pytest.importorskip("rclpy", reason="needs ROS")
    from geometry_msgs.msg import WrenchStamped

    monkeypatch.syspath_prepend(str(EXAMPLE))
    module = importlib.import_module("loader")
    carried = []
    rclpy.init()
    try:
        for newton, newton_m in ((0.0, 0.0), (200.0, 0.0), (0.0, 50.0)):
            loader, push = module.FreeLoader(), WrenchStamped()
            x, z = math.sin(-0.7), math.cos(-0.7)  # the bucket is pitched by -0.7 rad
            push.wrench.force.x, push.wrench.force.z = -newton * x, newton * z
            push.wrench.torque.y = newton_m
            loader._feel(push)
            assert loader.advance(0.2) == pytest.approx(module.pose_at(0.2)[:3], abs=0.005)
            carried.append([bullet.getJointState(loader._body, joint)[3] for joint in loader._joints])
            loader.node.destroy_node()
            bullet.disconnect()
    finally:
        rclpy.shutdown()
    (_, lift, curl), (_, lifted, _), (_, _, curled) = carried
    assert lift - lifted == pytest.approx(200.0, abs=1.0)
    assert curl - curled == pytest.approx(50.0, abs=0.5)
