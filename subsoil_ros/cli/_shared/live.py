"""The port of a live view: fixed before anything starts, so that every mode of a run uses the same one."""

import argparse
import socket

from ...errors import InputError
from ...extras import require

DEFAULT_PORT = 8765
"""Default port of Foxglove's dialog for a connection."""


def add_live(parser: argparse.ArgumentParser) -> None:
    """Declare `--live`."""
    parser.add_argument(
        "--live",
        nargs="?",
        const=str(DEFAULT_PORT),
        metavar="PORT",
        help="show the run in Foxglove while it goes on, over a WebSocket on this machine "
        f"(default port: {DEFAULT_PORT}; 0: any that is free)",
    )


def live_port(wanted: str | None) -> int:
    """Return a port that is free now; 0 without a live view.

    Raises:
        InputError: the value is no port, the port is in use, or foxglove-sdk is not installed.
    """
    if wanted is None:
        return 0
    require("--live", "foxglove")
    from ...recording.live_view import HOST

    if not wanted.isdecimal() or int(wanted) > 65535:
        raise InputError(f"live view: given '{wanted}'; it must be a port from 1024 to 65535, or 0 for any")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, int(wanted)))
        except OSError as error:
            raise InputError(
                f"live view: port {wanted} cannot be used ({error.strerror}); name another, or 0 for any "
                "that is free"
            ) from error
        return int(probe.getsockname()[1])


def say_where(port: int) -> None:
    """Print the address of the live view, if there is one."""
    if port:
        from ...recording.live_view import HOST

        print(f"live view: ws://{HOST}:{port} (Foxglove: Open connection, Foxglove WebSocket)", flush=True)
