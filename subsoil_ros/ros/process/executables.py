"""Programs of the nodes: each checks the room in shared memory before it imports rclpy."""

import sys
from functools import partial
from importlib import import_module

from ...coupling.protocol import CONTROLLER, COUPLER, MECHANISM, RECORDER, SOIL
from ...errors import InputError
from ..transport.shared_memory import avoid_full_memory


def _run(name: str) -> int:
    try:
        notice = avoid_full_memory()
    except InputError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_status
    if notice:
        print(f"{name}: {notice}", file=sys.stderr)
    return import_module(f"subsoil_ros.ros.nodes.{name}_node").main()


soil, mechanism, coupler, recorder, controller = (
    partial(_run, name) for name in (SOIL, MECHANISM, COUPLER, RECORDER, CONTROLLER)
)
"""Each runs the node of its name and returns the exit status."""
