"""subsoil workbench [FOLDER]: scenes, runs and comparisons in the browser."""

import argparse
import socket
from pathlib import Path

from ..errors import InputError
from ..extras import require

PORT = 8080


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folder",
        nargs="?",
        default=".",
        help="project: scenes (.yaml), tool files, runs/; made if missing (default: this one)",
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen at; another one needs the token that is printed",
    )
    parser.add_argument("--port", type=int, default=PORT, help="(default: %(default)s)")


def run(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    require("subsoil workbench", "nicegui")
    folder = Path(args.folder)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: is no folder, and cannot be made ({error.strerror}); give another"
        ) from error
    try:
        with socket.create_server((args.host, args.port)):
            pass
    except (OSError, OverflowError) as error:
        raise InputError(
            f"--port {args.port}: cannot be used at {args.host} ({error}); give another"
        ) from error
    from ..workbench.server import serve

    serve(folder.resolve(), args.host, args.port)
    return 0
