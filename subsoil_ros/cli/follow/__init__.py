"""subsoil follow SCENE: soil under a machine that does not wait, by its poses over ROS or in a record."""

import argparse
from pathlib import Path

from ...coupling.follow import BEHIND_S, FASTEST_M_PER_S
from ..arguments import add_overrides, positive_count


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="scene file (.yaml) whose tools have path.external: true")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for the results; must not exist")
    parser.add_argument(
        "--pose",
        action="append",
        default=[],
        metavar="TOOL=TOPIC",
        help="topic of a tool's PoseStamped; a tool without --pose and --odometry is a TF frame of its name",
    )
    parser.add_argument(
        "--odometry", action="append", default=[], metavar="TOOL=TOPIC", help="topic of a tool's Odometry"
    )
    parser.add_argument(
        "--joints", default="", metavar="TOPIC", help="topic of the JointState that moves the links of --urdf"
    )
    parser.add_argument(
        "--urdf", type=Path, metavar="FILE", help="robot whose links are the frames; its root is the world"
    )
    parser.add_argument(
        "--frame",
        action="append",
        default=[],
        metavar="TOOL=FRAME",
        help="TF frame or link of a tool (default: of the tool's name)",
    )
    parser.add_argument("--world", default="world", metavar="FRAME", help="of the poses (default: world)")
    parser.add_argument(
        "--behind",
        type=float,
        default=BEHIND_S,
        metavar="S",
        help="how far the soil may fall behind the newest pose before it skips to it (default: %(default)s)",
    )
    parser.add_argument(
        "--fastest",
        type=float,
        default=FASTEST_M_PER_S,
        metavar="M_PER_S",
        help="speed between two poses beyond which a tool leaps into the soil anew (default: %(default)s)",
    )
    parser.add_argument(
        "--replay", type=Path, metavar="RUN", help="move the tools as in an earlier run, without ROS"
    )
    parser.add_argument(
        "--seeds", metavar="A,B,C", help="of the soil: after each reset the next, and again from the first"
    )
    parser.add_argument("--threads", type=positive_count, default=1, metavar="N", help="of the soil engine")
    add_overrides(parser)


def run(args: argparse.Namespace) -> int:
    """Follow poses until the scene's duration is over, or Ctrl-C."""
    from .following import follow

    return follow(args)
