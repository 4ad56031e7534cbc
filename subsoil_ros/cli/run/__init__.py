"""subsoil run SCENE --out DIR: simulates a scene and leaves a bag, a series and a summary."""

import argparse
from pathlib import Path

from .._shared.arguments import add_overrides

DEFAULT_PORT = 8765
"""Default port of Foxglove's dialog for a connection."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `subsoil run`."""
    parser.add_argument("scene", help="scene file (.yaml)")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for the results; must not exist")
    parser.add_argument(
        "--mode",
        choices=("nodes", "composed", "direct"),
        default="nodes",
        help="nodes: one process per node over DDS; composed: the same nodes in one process; "
        "direct: no ROS (default: nodes; the results are the same bits)",
    )
    add_overrides(parser)
    parser.add_argument(
        "--threads",
        type=_thread_count,
        default=1,
        metavar="N",
        help="threads of the soil engine (default: 1)",
    )
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
    parser.add_argument(
        "--paused",
        action="store_true",
        help="nodes and composed: stand before the first tick until the coupler's services resume or step "
        "are called",
    )
    parser.add_argument(
        "--namespace",
        default="",
        metavar="NAME",
        help="nodes and composed: ROS namespace of all nodes and topics, /clock and /tf too, so that several "
        "runs share a domain (ROS_DOMAIN_ID)",
    )


def _thread_count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no number of threads; give 1 or more")
    return int(text)


def run(args: argparse.Namespace) -> int:
    """Run the scene.

    Raises:
        InputError: the scene or the folder cannot be used; nothing was written.
        RunError: the run failed; what was recorded before is in the folder.
    """
    from .simulation import simulate

    return simulate(args)
