"""Order of the time limits, and the one place where rclpy is entered behind its public names."""

import re
from pathlib import Path

from subsoil_ros.coupling.time_limits import (
    BATCH_S,
    CLOSE_S,
    CUT_PATIENCE_S,
    CUT_S,
    DEADLINE_S,
    END_S,
    END_WORD_S,
    FAILED_END_S,
    FAULT_S,
    GRANTED_S,
    HEARTBEAT_S,
    KEEP_S,
    LAST_WORD_S,
    LATE_S,
    LAUNCH_PATIENCE_S,
    POLL_S,
    RETURN_S,
    SILENCE_S,
    STALL_S,
    STARTUP_GRACE_S,
    STARTUP_S,
    VERDICT_S,
)

ROS = Path(__file__).parents[3] / "subsoil_ros" / "ros"


def test_a_node_polls_between_heartbeats_and_several_heartbeats_pass_before_it_counts_as_dead() -> None:
    """From the sleep of a node to the start-up of all; a dead node is named before a tick is late."""
    assert BATCH_S < POLL_S < GRANTED_S < KEEP_S
    assert 2.0 * POLL_S < FAULT_S
    assert FAULT_S + LAST_WORD_S <= VERDICT_S
    assert POLL_S < HEARTBEAT_S < SILENCE_S / 2.0 < SILENCE_S < STALL_S
    assert STALL_S < LATE_S < DEADLINE_S < STARTUP_S


def test_a_process_ends_by_itself_before_the_one_that_waits_for_it_loses_patience() -> None:
    """Recorder, nodes, coupler, supervisor, launch: the inner limits are the shorter ones."""
    assert CUT_S < CUT_PATIENCE_S < FAILED_END_S  # the recorder cuts before it is asked to end
    assert LAST_WORD_S < VERDICT_S < FAILED_END_S  # the coupler's fault arrives, and its reason is told
    assert RETURN_S + LAST_WORD_S < FAILED_END_S  # a node whose engine hangs ends itself, and is not killed
    assert RETURN_S + LAST_WORD_S + KEEP_S < FAILED_END_S + KEEP_S < STARTUP_GRACE_S
    assert CLOSE_S < END_WORD_S <= END_S < LAUNCH_PATIENCE_S < STARTUP_GRACE_S
    assert STALL_S < LAUNCH_PATIENCE_S  # the others notice a silent node before the launch ends them


def test_time_limits_stand_in_one_file() -> None:
    """No module of ros gives a limit of its own, but for how often names and files are looked at again."""
    own = {
        (path.name, name)
        for path in ROS.rglob("*.py")
        for name in re.findall(r"^(\w+_S)(?:, \w+)* = [\d.]", path.read_text(encoding="utf-8"), re.M)
    }
    assert own == {
        ("supervisor.py", "_POLL_S"),
        ("shared_memory.py", "SETTLED_S"),
    }


def test_what_is_private_in_rclpy_stands_in_one_file() -> None:
    """Its implementation, and the C handles of its entities."""
    private = re.compile(r"rclpy\.impl|(?<![a-z])_rclpy\b|\.handle\.(pointer|take|get|service)")
    users = {path.name for path in ROS.rglob("*.py") if private.search(path.read_text(encoding="utf-8"))}
    assert users == {"private_rclpy.py"}
