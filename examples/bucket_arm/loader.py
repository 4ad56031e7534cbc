"""A loader in PyBullet runs free, in wall time: it publishes its joints, and feels what soil answers.

python examples/bucket_arm/loader.py
"""

import argparse
import time
from pathlib import Path

import numpy as np
import pybullet as bullet
import rclpy
from bucket import TIMES_S, pose_at
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

STEP_S, PERIOD_S = 0.001, 0.01
"""Of PyBullet, and of the joint states."""

FORGET_S = 0.5
"""A wrench is felt no longer than that: soil that is not there any more must not pull."""


class FreeLoader:
    """The loader in PyBullet, as a node."""

    def __init__(self) -> None:
        self.node = Node("loader")
        self._states = self.node.create_publisher(JointState, "/joint_states", 10)
        self.node.create_subscription(WrenchStamped, "/tool/bucket/wrench", self._feel, 10)
        bullet.connect(bullet.DIRECT)
        bullet.setTimeStep(STEP_S)
        bullet.setGravity(0.0, 0.0, -9.81)
        self._body = bullet.loadURDF(str(Path(__file__).parent / "loader.urdf"), useFixedBase=True)
        joints = [bullet.getJointInfo(self._body, k) for k in range(bullet.getNumJoints(self._body))]
        self._joints, self._names = range(len(joints)), [joint[1].decode() for joint in joints]
        self._efforts = [joint[10] for joint in joints]
        for joint, target in zip(self._joints, self._targets(0.0), strict=True):
            bullet.resetJointState(self._body, joint, target)
        self._load, self._felt_s = np.zeros((2, 3)), 0.0
        self.time_s, self.wrenches = 0.0, 0

    @staticmethod
    def _targets(time_s: float) -> list[float]:
        """Drive, lift and curl: the waypoints of the arm, without its yaw."""
        return pose_at(min(time_s, TIMES_S[-1]))[:3]

    def _feel(self, message: WrenchStamped) -> None:
        """Keep a wrench: about the bucket's origin, along the bucket's axes."""
        force, torque = message.wrench.force, message.wrench.torque
        self._load = np.array(((force.x, force.y, force.z), (torque.x, torque.y, torque.z)))
        self._felt_s = time.monotonic()
        self.wrenches += 1

    def wait(self) -> None:
        """Until the soil listens."""
        while not self._states.get_subscription_count():
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def advance(self, duration_s: float) -> list[float]:
        """Move for a time, publish the joints, and return their positions [m, m, rad]."""
        if time.monotonic() - self._felt_s > FORGET_S:
            self._load[:] = 0.0
        bucket = self._joints[-1]
        for _ in range(round(duration_s / STEP_S)):
            bullet.setJointMotorControlArray(
                self._body, self._joints, bullet.POSITION_CONTROL, self._targets(self.time_s),
                forces=self._efforts,
            )  # fmt: skip
            origin, turn = bullet.getLinkState(self._body, bucket, computeForwardKinematics=True)[4:6]
            force, torque = self._load @ np.reshape(bullet.getMatrixFromQuaternion(turn), (3, 3)).T
            frame = bullet.WORLD_FRAME
            bullet.applyExternalForce(self._body, bucket, force.tolist(), origin, frame)
            bullet.applyExternalTorque(self._body, bucket, torque.tolist(), frame)
            bullet.stepSimulation()
            self.time_s += STEP_S
        message = JointState(name=self._names)
        message.header.stamp = self.node.get_clock().now().to_msg()
        message.position = [bullet.getJointState(self._body, joint)[0] for joint in self._joints]
        self._states.publish(message)
        return list(message.position)


def main() -> None:
    """Dig once, in wall time."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    rclpy.init()
    loader = FreeLoader()
    loader.wait()
    start = time.monotonic()
    for k in range(round(TIMES_S[-1] / PERIOD_S)):
        loader.advance(PERIOD_S)
        while (left := start + (k + 1) * PERIOD_S - time.monotonic()) > 0.0:
            rclpy.spin_once(loader.node, timeout_sec=left)
    print(f"{loader.wrenches} wrenches came back")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
