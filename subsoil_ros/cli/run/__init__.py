"""subsoil run SCENE [--out DIR]: simulates a scene and leaves a bag, a series and a summary."""

import argparse
from functools import partial
from pathlib import Path

from ...coupling.run_options import OPTIONS
from ...errors import InputError
from ..arguments import add_overrides

DEFAULT_PORT = 8765
"""Default port of Foxglove's dialog for a connection."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="scene file (.yaml)")
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="folder for the results; must not exist (default: runs/SCENE-TIME, TIME as 20260131-120000)",
    )
    parser.add_argument(
        "--mode",
        choices=("nodes", "composed", "direct"),
        default="nodes",
        help="nodes: one process per node over DDS; composed: the same nodes in one process; "
        "direct: no ROS (default: nodes; the results are the same bits)",
    )
    add_overrides(parser)
    parser.add_argument(
        "--resume",
        type=Path,
        metavar="RUN",
        help="go on from the newest checkpoint in the folder of an earlier run of the same scene",
    )
    parser.add_argument(
        "--live",
        nargs="?",
        const=str(DEFAULT_PORT),
        metavar="PORT",
        help="show the run in Foxglove while it goes on, over a WebSocket on this machine "
        f"(default port: {DEFAULT_PORT}; 0: any that is free)",
    )
    for name, option in OPTIONS.items():
        if option.limits is None:
            parser.add_argument(f"--{name}", action="store_true", help=option.description)
        else:
            words = f"{option.description} (default: {option.default})"
            parser.add_argument(
                f"--{name}", type=partial(_number, name), default=option.default, metavar="N", help=words
            )
    parser.add_argument(
        "--namespace",
        default="",
        metavar="NAME",
        help="nodes and composed: ROS namespace of all nodes and topics, /clock and /tf too, so that several "
        "runs share a domain (ROS_DOMAIN_ID)",
    )


def _number(name: str, text: str) -> int:
    try:
        return OPTIONS[name].parsed(name, text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def run(args: argparse.Namespace) -> int:
    """Run the scene."""
    from .simulation import simulate

    return simulate(args)
