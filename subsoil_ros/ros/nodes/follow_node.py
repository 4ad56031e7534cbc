"""The node of `subsoil follow`: poses of the machine in, forces on its tools and the soil's surface out."""

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from ...coupling.follow.follower import Follower
from ...coupling.follow.poses import FrameTree, Pose
from ...coupling.time_limits import STALE_S
from ...errors import InputError
from ...extras import require
from ...loading.loader import ResolvedScene
from ...messages import RunRecord, SoilCloud, ToolMotions, ToolWrench, ToolWrenches
from ...recording.message_codec import standard_bytes
from ...recording.soil_clouds import height_map, point_cloud
from ...recording.standard_messages import WORLD_FRAME, time_ns_of, tool_messages
from ...recording.topics import HEIGHT_MAP, TOPIC_OF, TRANSFORMS, tool_topics
from ...recording.types import serialize
from ...schedule import Schedule
from ..process.node_process import OWN_TIME
from ..transport.qos import CLOUD_QOS, VISUALIZATION_QOS, RosMessage, rclpy_class
from .diagnostics import Diagnostics, Health, Level
from .run_control import Result
from .run_services import dialect

_POSES_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Matches every publisher; a pose that is lost lies between two that came."""

_FIXED_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(frozen=True)
class PoseSources:
    """Where the poses of the tools come from; a tool that is in none of the maps is a frame."""

    poses: Mapping[str, str] = field(default_factory=dict)  # topic of PoseStamped by tool
    odometry: Mapping[str, str] = field(default_factory=dict)  # topic of Odometry by tool
    frames: Mapping[str, str] = field(default_factory=dict)  # frame by tool; default: of the tool's name
    joints: str = ""  # topic of JointState, which moves the frames of `urdf`
    urdf: Path | None = None  # its root stands in the world's origin; None: the frames are those of /tf
    world: str = WORLD_FRAME


class FollowNode:
    """Hands poses to a follower, and publishes for it: a sink of the records of its run.

    Raises:
        InputError: the package of a message type, or yourdfpy, is not installed; or the URDF cannot be used.
    """

    def __init__(
        self, resolved: ResolvedScene, run_id: str, follower: Follower, sources: PoseSources
    ) -> None:
        self._scene, self._sources, self._follower = resolved.scene, sources, follower
        self._context = Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = node = Node("follower", context=self._context, parameter_overrides=OWN_TIME)
        self._schedule = Schedule.of(resolved.scene, resolved.timing)
        self._publishers = {
            topic: node.create_publisher(rclpy_class(kind), topic, VISUALIZATION_QOS)
            for topic, kind in tool_topics(resolved.scene).items()
        }
        if resolved.scene.has_clouds and resolved.scene.record.cloud_hz > 0.0:
            cloud = rclpy_class("sensor_msgs/msg/PointCloud2")
            for topic in (TOPIC_OF[SoilCloud], HEIGHT_MAP):
                self._publishers[topic] = node.create_publisher(cloud, topic, CLOUD_QOS)
        self._motions: ToolMotions | None = None
        self._sums: dict[str, np.ndarray] = {}  # forces and moments since the last message
        self._ticks = 0
        self._tick, self._skips = -1, 0
        try:
            self._subscribe()
        except InvalidTopicNameException as error:
            rclpy.shutdown(context=self._context)
            raise InputError(
                f"topic of poses: {' '.join(str(error).split())}; give the name of one"
            ) from error
        except InputError:
            rclpy.shutdown(context=self._context)
            raise
        step_ns = resolved.timing.communication_step_ns
        self._diagnostics = Diagnostics(node, run_id, step_ns, task="follow")
        node.create_timer(1.0, self._report)
        self._dialect = dialect()
        node.create_service(self._dialect.service("ResetSimulation"), "reset_simulation", self._reset)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, name="poses", daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except Exception as error:  # of a callback: the run would wait for ever
            self._follower.fail(error)

    def close(self) -> None:
        """Stop listening."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    # poses

    def _subscribe(self) -> None:
        node, sources = self._node, self._sources
        for tool, topic in sources.poses.items():
            kind = rclpy_class("geometry_msgs/msg/PoseStamped")
            take = partial(self._take_pose, tool, lambda message: message.pose)
            node.create_subscription(kind, topic, take, _POSES_QOS)
        for tool, topic in sources.odometry.items():
            take = partial(self._take_pose, tool, lambda message: message.pose.pose)
            node.create_subscription(_class("nav_msgs/msg/Odometry", "--odometry"), topic, take, _POSES_QOS)
        framed = [tool for tool in self._scene.tools if tool not in {*sources.poses, *sources.odometry}]
        self._tool_of = {sources.frames.get(tool, tool): tool for tool in framed}
        if framed and sources.urdf is not None:
            self._robot = _Robot(sources.urdf, self._tool_of)
            kind = rclpy_class("sensor_msgs/msg/JointState")
            node.create_subscription(kind, sources.joints, self._take_joints, _POSES_QOS)
        elif framed:
            kind = _class("tf2_msgs/msg/TFMessage", "TF frames")
            self._tree = FrameTree(sources.world, self._tool_of, self._follower.fastest_m_per_s)
            take = partial(self._take_transforms, fixed=False)
            node.create_subscription(kind, TRANSFORMS, take, _POSES_QOS)
            fixed = partial(self._take_transforms, fixed=True)
            node.create_subscription(kind, f"{TRANSFORMS}_static", fixed, _FIXED_QOS)

    def _take_pose(self, tool: str, pose_of: Callable[[RosMessage], RosMessage], message: RosMessage) -> None:
        if message.header.frame_id != self._sources.world:
            self._follower.refuse(f"in the frame '{message.header.frame_id}'")
            return
        pose = pose_of(message)
        self._follower.receive(tool, _pose(time_ns_of(message.header.stamp), pose.position, pose.orientation))

    def _take_transforms(self, message: RosMessage, *, fixed: bool) -> None:
        for item in message.transforms:
            way = item.transform
            pose = _pose(time_ns_of(item.header.stamp), way.translation, way.rotation)
            if cause := self._tree.add(item.header.frame_id, item.child_frame_id, pose, fixed=fixed):
                self._follower.refuse(cause)
        for frame, pose in self._tree.poses():
            self._follower.receive(self._tool_of[frame], pose)

    def _take_joints(self, message: RosMessage) -> None:
        angles = dict(zip(message.name, message.position, strict=False))
        if not self._robot.joints <= angles.keys():
            self._follower.refuse("without all joints")
            return
        for frame, pose in self._robot.poses(time_ns_of(message.header.stamp), angles):
            self._follower.receive(self._tool_of[frame], pose)

    def _reset(self, request: RosMessage, response: RosMessage) -> RosMessage:
        self._follower.reset()
        return self._dialect.fill_result(response, Result.OK, "")

    # what the run gives

    def write(self, record: RunRecord) -> None:
        """Publish what listeners need of a record; forces are means since the last message."""
        if isinstance(record, ToolMotions):
            self._motions = record
        elif isinstance(record, ToolWrenches) and record.tick >= 0:
            if self._skips != self._follower.skips:  # forces from before a skip are of another place
                self._skips, self._sums, self._ticks = self._follower.skips, {}, 0
            self._add(record.tools)
            self._tick = record.tick
            if self._schedule.series_due(record.tick):
                self._publish_tools(record.tools)
        elif isinstance(record, SoilCloud):
            soil = self._scene.particle_soil or self._scene.terrain_soil
            cloud = replace(record, end_time_ns=self._follower.stamp_ns)
            if soil is not None:
                self._publishers[TOPIC_OF[SoilCloud]].publish(serialize(point_cloud(cloud)))
                self._publishers[HEIGHT_MAP].publish(serialize(height_map(cloud, soil)))

    def _add(self, wrenches: Iterable[ToolWrench]) -> None:
        self._ticks += 1
        for wrench in wrenches:
            self._sums[wrench.tool] = self._sums.get(wrench.tool, 0.0) + np.array(
                [
                    wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton,
                    wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m,
                ]
            )  # fmt: skip

    def _publish_tools(self, wrenches: Iterable[ToolWrench]) -> None:
        assert self._motions is not None
        means = []
        for wrench in wrenches:
            fx, fy, fz, tx, ty, tz = (self._sums[wrench.tool] / self._ticks).tolist()
            means.append(ToolWrench(wrench.tool, fx, fy, fz, tx, ty, tz, 0.0, wrench.contact_count, ()))
        self._sums, self._ticks = {}, 0
        stamp_ns = self._follower.stamp_ns
        for topic, record in tool_messages(self._scene, self._motions.tools, means, stamp_ns):
            self._publishers[topic].publish(standard_bytes(topic, record))

    def _report(self) -> None:
        follower = self._follower
        still_s, behind_s = follower.still_s, follower.behind_s
        level, words = Level.OK, f"{behind_s:.3f} s behind"
        if follower.awaited:
            level, words = Level.WARN, f"waits for a pose of {', '.join(follower.awaited)}"
        elif still_s > STALE_S:
            level, words = Level.WARN, f"no new pose for {still_s:.1f} s"
        elif follower.skips:
            level, words = Level.WARN, f"{behind_s:.3f} s behind; skipped {1e-9 * follower.skipped_ns:.3g} s"
        values = {
            "behind_s": behind_s,
            "skipped_s": 1e-9 * follower.skipped_ns,
            "skips": follower.skips,
            "no_pose_for_s": still_s,
        }
        refused = {f"refused: {cause}": count for cause, count in follower.refused.items()}
        self._diagnostics.publish(Health(level, words, {**values, **refused}), self._tick)


class _Robot:
    """Forward kinematics of a URDF by yourdfpy."""

    def __init__(self, urdf: Path, frames: Iterable[str]) -> None:
        require("--urdf", "yourdfpy")
        import yourdfpy  # slow to import, and rarely used

        try:
            self._urdf = yourdfpy.URDF.load(str(urdf), load_meshes=False, build_scene_graph=True)
        except Exception as error:  # of a library that names none
            raise InputError(f"--urdf {urdf}: cannot be read ({error})") from error
        links = list(self._urdf.link_map)
        missing = [frame for frame in frames if frame not in links]
        if missing:
            raise InputError(
                f"--urdf {urdf}: has no link {', '.join(missing)}; links are {', '.join(links)}: name one by "
                "--frame TOOL=LINK"
            )
        self._frames = tuple(frames)
        carries = {joint.child: joint for joint in self._urdf.joint_map.values()}
        self.joints: set[str] = set()
        """Names of those that move the frames."""
        for frame in frames:
            while frame in carries:
                joint = carries[frame]
                if joint.type != "fixed":
                    self.joints.add(joint.mimic.joint if joint.mimic is not None else joint.name)
                frame = joint.parent

    def poses(self, stamp_ns: int, angles: Mapping[str, float]) -> Iterable[tuple[str, Pose]]:
        """Poses of the frames; angles: of `joints` at least."""
        from scipy.spatial.transform import Rotation

        self._urdf.update_cfg({name: float(angles[name]) for name in self.joints})
        for frame in self._frames:
            matrix = self._urdf.get_transform(frame)
            if np.isfinite(matrix).all():
                x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()
            else:
                x = y = z = w = float("nan")
            yield frame, Pose(stamp_ns, tuple(matrix[:3, 3].tolist()), (x, y, z, w))


def _class(kind: str, what: str) -> RosMessage:
    try:
        return rclpy_class(kind)
    except ImportError as error:
        package = kind.partition("/")[0]
        raise InputError(
            f"{what}: needs the messages of {package}, which are not installed here; source a ROS 2 "
            "installation, or give poses by --pose or --joints"
        ) from error


def _pose(time_ns: int, place: RosMessage, orientation: RosMessage) -> Pose:
    turn = (orientation.x, orientation.y, orientation.z, orientation.w)
    return Pose(time_ns, (place.x, place.y, place.z), turn)
