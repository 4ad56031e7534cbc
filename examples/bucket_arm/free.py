"""The arm of bucket.py runs free, in wall time: it says where its bucket is, and feels what soil answers.

python examples/bucket_arm/free.py
"""

import argparse
import time

import mujoco
import numpy as np
import rclpy
from bucket import TIMES_S, control, model
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node

PERIOD_S = 0.01
"""Of poses: ten times shorter than the arm takes to move by a particle."""

FORGET_S = 0.5
"""A wrench is felt no longer than that: soil that is not there any more must not pull."""


class FreeArm:
    """The arm in MuJoCo, as a node."""

    def __init__(self) -> None:
        self.node = Node("arm")
        self._pose = self.node.create_publisher(PoseStamped, "/bucket_pose", 10)
        self.node.create_subscription(WrenchStamped, "/tool/bucket/wrench", self._feel, 10)
        self._model = mujoco.MjModel.from_xml_string(model())
        self._data = mujoco.MjData(self._model)
        mujoco.mj_resetDataKeyframe(self._model, self._data, 0)
        mujoco.mj_forward(self._model, self._data)
        self._load, self._felt_s = np.zeros(6), 0.0
        self.wrenches = 0

    def _feel(self, message: WrenchStamped) -> None:
        """Keep a wrench: about the bucket's origin, along the bucket's axes."""
        force, torque = message.wrench.force, message.wrench.torque
        self._load = np.array((force.x, force.y, force.z, torque.x, torque.y, torque.z))
        self._felt_s = time.monotonic()
        self.wrenches += 1

    def wait(self) -> None:
        """Until the soil listens."""
        while not self._pose.get_subscription_count():
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def advance(self, duration_s: float) -> None:
        """Move for a time, and say where the bucket is."""
        data, site = self._data, self._data.site("bucket")
        end_s = data.time + duration_s
        if time.monotonic() - self._felt_s > FORGET_S:
            self._load[:] = 0.0
        while data.time < end_s:
            control(self._model, data, min(data.time, TIMES_S[-1]))
            turn = site.xmat.reshape(3, 3)
            data.qfrc_applied[:] = 0.0
            mujoco.mj_applyFT(
                self._model, data, turn @ self._load[:3], turn @ self._load[3:], site.xpos,
                self._model.site("bucket").bodyid[0], data.qfrc_applied,
            )  # fmt: skip
            mujoco.mj_step(self._model, data)
        message, quaternion = PoseStamped(), np.empty(4)
        message.header.frame_id = "world"
        message.header.stamp = self.node.get_clock().now().to_msg()
        mujoco.mju_mat2Quat(quaternion, site.xmat)
        at, turn = message.pose.position, message.pose.orientation
        at.x, at.y, at.z = site.xpos.tolist()
        turn.w, turn.x, turn.y, turn.z = quaternion.tolist()
        self._pose.publish(message)


def main() -> None:
    """Dig once, in wall time."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, default=TIMES_S[-1], help="wall time [s]")
    args = parser.parse_args()
    rclpy.init()
    arm = FreeArm()
    arm.wait()
    start = time.monotonic()
    for k in range(round(args.duration / PERIOD_S)):
        arm.advance(PERIOD_S)
        while (left := start + (k + 1) * PERIOD_S - time.monotonic()) > 0.0:
            rclpy.spin_once(arm.node, timeout_sec=left)
    print(f"{arm.wrenches} wrenches came back")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
