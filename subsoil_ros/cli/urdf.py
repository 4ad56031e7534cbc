"""subsoil urdf SCENE: the machine as URDF, as it is published and recorded on /robot_description."""

import argparse
from pathlib import Path

from .arguments import add_overrides
from .output import write_out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="scene file (.yaml)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write; standard output without it")
    add_overrides(parser)


def run(args: argparse.Namespace) -> int:
    """Write the URDF."""
    from ..loading.loader import load_scene
    from ..recording.robot_description import robot_description

    write_out(robot_description(load_scene(args.scene, args.overrides).scene), args.out)
    return 0
