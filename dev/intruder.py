"""A node that does not belong to a run: python -m dev.intruder KIND [RUN_ID]

KIND: foreign_run, foreign_tick, foreign_nan, foreign_tools (publishes wrenches of another run, of a wrong
tick, with NaN, or of too few tools), slow (subscribes to all topics, but does not process them).
"""

import math
import os
import signal
import sys
import time

import rclpy
from subsoil_msgs.msg import Grant, ToolMotions, ToolWrench, ToolWrenches

from subsoil_ros.ros.transport.qos import LOCKSTEP_QOS

LIMIT_S = 60.0


def publish(kind: str, run_id: str) -> None:
    """Follows the ticks of the run and answers one of them in a wrong way."""
    node = rclpy.create_node("intruder")
    last: list[ToolWrenches] = []
    node.create_subscription(ToolWrenches, "tool_wrenches", last.append, LOCKSTEP_QOS)
    deadline = time.monotonic() + LIMIT_S
    while not last and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.1)
    publisher = node.create_publisher(ToolWrenches, "tool_wrenches", LOCKSTEP_QOS)
    while publisher.get_subscription_count() < 2 and time.monotonic() < deadline:  # mechanism and itself
        rclpy.spin_once(node, timeout_sec=0.01)
    message = last[-1]
    if kind == "foreign_run":
        message.run_id = "other"
    elif kind == "foreign_tick":
        message.tick += 1000
    elif kind == "foreign_nan":
        message.tick += 1
        message.tools[0].wrench.force.x = math.nan
    elif kind == "foreign_tools":
        message.tick += 1
        message.tools = [ToolWrench(tool="spoon")]
    publisher.publish(message)
    time.sleep(1.0)


def listen_slowly() -> None:
    """Takes some messages, then stops without a word."""
    node = rclpy.create_node("slow")
    for topic, kind in (("grant", Grant), ("tool_motions", ToolMotions), ("tool_wrenches", ToolWrenches)):
        node.create_subscription(kind, topic, lambda message: time.sleep(0.2), LOCKSTEP_QOS)
    for _ in range(5):
        rclpy.spin_once(node, timeout_sec=1.0)
    os.kill(os.getpid(), signal.SIGSTOP)


def main() -> int:
    """Does it."""
    kind, *rest = sys.argv[1:]
    rclpy.init()
    if kind == "slow":
        listen_slowly()
    else:
        publish(kind, *rest)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
