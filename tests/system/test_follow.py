"""`subsoil follow` beside programs that do not wait: poses over DDS, forces back, and a replay."""

import itertools
import json
import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped, WrenchStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState, PointCloud2

from subsoil_ros.cli.main import main
from subsoil_ros.ros.nodes.run_services import dialect
from subsoil_ros.ros.transport.ros_domain import run_domain
from subsoil_ros.yaml_document import dump_yaml

ROOT = Path(__file__).parents[2]
LIMIT_S = 300.0
SPEED = 0.5
SCENE: dict[str, Any] = {
    "name": "followed",
    "duration_s": 1.0,
    "tools": {
        "tine": {
            "path": {"external": True, "start_z_m": 0.6},
            "groups": {"tine": {"mesh": str(ROOT / "config" / "meshes" / "share.stl")}},
        }
    },
    "soil": {
        "model": "wedge",
        "bin": {"length_m": 10.0, "width_m": 0.6, "depth_m": 0.3},
        "values": {
            "density_kg_per_m3": 1300.0, "cohesion_pa": 2e4, "friction_angle_rad": 0.4, "adhesion_pa": 5e3,
            "tool_friction_angle_rad": 0.3,
        },
    },
}  # fmt: skip
TERRAIN: dict[str, Any] = {
    **SCENE["soil"],
    "model": "terrain",
    "bin": {
        "length_m": 60.0,
        "width_m": 0.6,
        "depth_m": 0.3,
    },  # as long as the robot drives while kernels load
    "cell_m": 0.05,
    "values": SCENE["soil"]["values"] | {"loose_friction_angle_rad": 0.35},
}
PARTICLES: dict[str, Any] = {
    "bin": {"length_m": 0.4, "width_m": 0.2, "depth_m": 0.1},
    "particles": {"radius_m": 0.015, "density_kg_per_m3": 2570.0},
    "bed": {"kind": "grid", "spacing_m": 0.029},
    "law": {
        "kind": "linear",
        **{
            row: {
                "stiffness_newton_per_m": 8e4, "tangential_stiffness_newton_per_m": 6e4,
                "damping_newton_s_per_m": 6.0, "tangential_damping_newton_s_per_m": 3.0,
                "static_friction": 0.4, "sliding_friction": 0.4, "rolling_friction": 0.1,
            }
            for row in ("particle", "boundary")
        },
    },
}  # fmt: skip
URDF = """<robot name="slide">
  <link name="base"/> <link name="tine"/>
  <joint name="slide" type="prismatic">
    <parent link="base"/> <child link="tine"/>
    <origin xyz="0 0 0.2"/> <axis xyz="1 0 0"/> <limit lower="-9" upper="9" effort="1" velocity="9"/>
  </joint>
</robot>
"""


class Robot:
    """A node that publishes at 100 Hz until it is closed, and keeps what comes back."""

    def __init__(
        self,
        domain: int,
        publish: Callable[["Robot", float, int], None],
        begin: Callable[["Robot"], None] = lambda robot: None,
    ) -> None:
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = Node("robot", context=self.context)
        self.poses = self.node.create_publisher(PoseStamped, "/tine_pose", 10)
        self.joints = self.node.create_publisher(JointState, "/joint_states", 10)
        self.wrenches: list[WrenchStamped] = []
        self.clouds: list[PointCloud2] = []
        keep = qos_profile_sensor_data
        self.node.create_subscription(WrenchStamped, "/tool/tine/wrench", self.wrenches.append, keep)
        self.node.create_subscription(PointCloud2, "/soil/height_map", self.clouds.append, keep)
        self.start_ns = time.time_ns()
        self.moved: Any = None
        self.fixed: Any = None
        begin(self)
        self.node.create_timer(0.01, lambda: publish(self, *self.now()))
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin, daemon=True)
        self.thread.start()

    def now(self) -> tuple[float, int]:
        """Seconds since the start, and the stamp."""
        stamp = time.time_ns()
        return 1e-9 * (stamp - self.start_ns), stamp

    def pose(self, x_m: float, stamp: int, frame: str = "world") -> None:
        """Publish a pose 0.1 m deep."""
        message = PoseStamped()
        message.header.frame_id = frame
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.pose.position.x, message.pose.position.z = x_m, 0.2
        message.pose.orientation.w = 1.0
        self.poses.publish(message)

    def close(self) -> None:
        self.executor.shutdown()
        self.thread.join()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A free domain on this host."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with run_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        yield number


def follow(folder: Path, *words: str, **changes: Any) -> subprocess.Popen[str]:
    """The command, with results in folder/out."""
    scene = folder / "scene.yaml"
    scene.write_text(dump_yaml(SCENE | changes), encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "subsoil_ros.cli.main",
        "follow",
        str(scene),
        "--out",
        str(folder / "out"),
    ]
    return subprocess.Popen([*command, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def followed(folder: Path) -> dict[str, Any]:
    """What summary.json says of it."""
    found: dict[str, Any] = json.loads((folder / "out" / "summary.json").read_text())["run"]["followed"]
    return found


def same_again(folder: Path) -> None:
    """The record, replayed, gives the same series; of an interrupted run, a row of its last tick as well."""
    run = folder / "out"
    again = folder / "again"
    assert main(["follow", str(run / "scene.yaml"), "--replay", str(run), "--out", str(again)]) == 0
    assert (again / "series.csv").read_bytes().startswith((run / "series.csv").read_bytes())


@pytest.mark.parametrize("soil", [SCENE["soil"], TERRAIN], ids=["wedge", "terrain"])
def test_wedges_and_terrains_follow_poses_in_real_time(
    tmp_path: Path, domain: int, soil: dict[str, Any]
) -> None:
    """Forces have the stamps of poses; late poses and other frames change nothing; a replay is equal."""

    def publish(robot: Robot, t: float, stamp: int) -> None:
        robot.pose(SPEED * t, stamp)
        robot.pose(9.0, stamp - 10**9)
        robot.pose(9.0, stamp + 1, "map")

    robot = Robot(domain, publish)
    try:
        process = follow(tmp_path, "--pose", "tine=/tine_pose", soil=soil, record={"cloud_hz": 10.0})
        _, err = process.communicate(timeout=LIMIT_S)
    finally:
        robot.close()
    assert process.returncode == 0, err
    assert (len(robot.clouds) > 0) == (soil is TERRAIN)
    facts = followed(tmp_path)
    assert set(facts["refused"]) == {"late", "in the frame 'map'"}
    assert (facts["end_ns"] - facts["start_ns"]) * 1e-9 == pytest.approx(1.0 + facts["skipped_s"], abs=0.05)
    head, *rows = (tmp_path / "out" / "series.csv").read_text().splitlines()
    columns = dict(zip(head.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))
    last_m = SPEED * 1e-9 * (facts["end_ns"] - robot.start_ns)
    assert columns["tool.tine.x_m"][-1] == pytest.approx(last_m, abs=1e-6)
    assert columns["draft_newton"][-100:].mean() > 50.0
    stamps = [10**9 * m.header.stamp.sec + m.header.stamp.nanosec for m in robot.wrenches]
    assert stamps == sorted(stamps)
    assert facts["start_ns"] <= stamps[0] < stamps[-1] <= facts["end_ns"]
    assert min(message.wrench.force.x for message in robot.wrenches) < -50.0
    same_again(tmp_path)


def test_particles_follow_joints_and_skip_what_they_must(tmp_path: Path, domain: int) -> None:
    """A bin of 600 spheres behind a robot that leaps once a second; a bag that ends by Ctrl-C."""
    pytest.importorskip("yourdfpy", reason="yourdfpy is not installed")
    urdf = tmp_path / "slide.urdf"
    urdf.write_text(URDF, encoding="utf-8")

    def publish(robot: Robot, t: float, stamp: int) -> None:
        message = JointState(name=["slide"], position=[0.05 + 0.2 * math.fmod(t, 1.0)])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        robot.joints.publish(message)

    robot = Robot(domain, publish)
    words = ("--joints", "/joint_states", "--urdf", str(urdf), "--fastest", "5")
    tools = {"tine": SCENE["tools"]["tine"] | {"path": {"external": True, "start_z_m": 0.6, "turn": {}}}}
    process = follow(
        tmp_path, *words, soil=PARTICLES, tools=tools, record={"cloud_hz": 20.0}, duration_s=60.0
    )
    try:
        deadline = time.monotonic() + LIMIT_S
        while len(robot.clouds) < 8 and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
        robot.close()
    assert process.returncode == 130, err
    facts = followed(tmp_path)
    assert facts["leaps"] >= 1
    assert facts["removed_particles"] >= 1
    same_again(tmp_path)


def test_frames_of_tf_are_followed(tmp_path: Path, domain: int) -> None:
    """A base that drives at 100 Hz, a mast on it that is fixed, and a tine that is let down at 25 Hz."""
    kinds = pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs is in no package registry")
    count = itertools.count()

    def transform(parent: str, child: str, x_m: float, z_m: float, stamp: int) -> TransformStamped:
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.transform.translation.x, message.transform.translation.z = x_m, z_m
        message.transform.rotation.w = 1.0
        return message

    def publish(robot: Robot, t: float, stamp: int) -> None:
        moved = [transform("odom", "base", SPEED * t, 0.0, stamp)]
        if next(count) % 4 == 0:
            moved.append(transform("mast", "tip", 0.0, -0.8 + 0.01 * t, stamp))
        robot.moved.publish(kinds.TFMessage(transforms=moved))

    def begin(robot: Robot) -> None:
        robot.moved = robot.node.create_publisher(kinds.TFMessage, "/tf", 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        robot.fixed = robot.node.create_publisher(kinds.TFMessage, "/tf_static", latched)
        robot.fixed.publish(kinds.TFMessage(transforms=[transform("base", "mast", 0.0, 1.0, 0)]))

    robot = Robot(domain, publish, begin)
    try:
        process = follow(tmp_path, "--world", "odom", "--frame", "tine=tip")
        _, err = process.communicate(timeout=LIMIT_S)
    finally:
        robot.close()
    assert process.returncode == 0, err
    head, *_, last = (tmp_path / "out" / "series.csv").read_text().splitlines()
    row = dict(zip(head.split(","), map(float, last.split(",")), strict=True))
    end_s = 1e-9 * (followed(tmp_path)["end_ns"] - robot.start_ns)
    assert row["tool.tine.x_m"] == pytest.approx(SPEED * end_s, abs=1e-6)
    assert row["tool.tine.z_m"] == pytest.approx(0.2 + 0.01 * end_s, abs=1e-6)


def test_a_reset_begins_again(tmp_path: Path, domain: int) -> None:
    """By the service, in a folder of its own and fresh soil of the next seed; the same process."""
    resets = dialect().service("ResetSimulation")
    robot = Robot(domain, lambda robot, t, stamp: robot.pose(SPEED * t, stamp))
    process = follow(tmp_path, "--pose", "tine=/tine_pose", "--seeds", "3,7", duration_s=60.0)
    client = robot.node.create_client(resets, "/reset_simulation")
    try:
        for episode in range(2):
            count, deadline = len(robot.wrenches), time.monotonic() + LIMIT_S
            while (
                len(robot.wrenches) < count + 100 and process.poll() is None and time.monotonic() < deadline
            ):
                time.sleep(0.01)
            if episode == 0:
                assert client.wait_for_service(LIMIT_S)
                client.call(resets.Request())
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
        robot.close()
    assert process.returncode == 130, err
    for name, seed, why in (("out", 3, "ended by reset_simulation"), ("out-2", 7, "ended by SIGINT")):
        assert f"seed: {seed}\n" in (tmp_path / name / "scene.yaml").read_text()
        run = json.loads((tmp_path / name / "summary.json").read_text())["run"]
        assert run["failure"] == why
        assert (tmp_path / name / "series.csv").read_text().splitlines()[1].startswith("0.0,")
        assert run["simulated_s"] > 0.05


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--pose", "share=/p"), "--pose: given 'share=/p'; it must be TOOL=TOPIC, tools are tine"),
        (("--pose", "tine"), "--pose: given 'tine'; it must be TOOL=TOPIC"),
        (("--behind", "0"), "--behind: given 0.0; it must be a positive number"),
        (("--fastest", "nan"), "--fastest: given nan; it must be a positive number"),
        (("--joints", "/j"), "--joints and --urdf: one is given without the other"),
        (("--pose", "tine=/a", "--pose", "tine=/b"), "--pose: given twice for tine"),
        (("--pose", "tine=/a", "--odometry", "tine=/b"), "--odometry tine: has a --pose too"),
        (("--pose", "tine=/a", "--frame", "tine=b"), "--frame tine: has a topic of its own"),
        (("--pose", "tine=/a b"), "topic of poses: Invalid topic name"),
        (("--replay", ".", "--pose", "tine=/a"), "--replay: given with --pose"),
        (("--replay", ".", "--seeds", "1,2"), "--replay: given with --seeds"),
        (("--seeds", "1,1"), "--seeds 1,1: must be different whole numbers"),
        (("--set", f"soil={json.dumps(TERRAIN)}", "--seeds", "1"), "nothing in its soil is random"),
        (("--joints", "/j", "--urdf", "none.urdf"), "--urdf none.urdf: cannot be read"),
        (("--replay", "none"), "none/bag"),
        (("--set", "tools.tine.path.external=false"), "`subsoil follow` moves the tools"),
    ],
)
def test_what_cannot_be_followed(tmp_path, capsys, domain, words, told):
    scene = tmp_path / "scene.yaml"
    scene.write_text(dump_yaml(SCENE), encoding="utf-8")
    assert main(["follow", str(scene), "--out", str(tmp_path / "out"), *words]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
