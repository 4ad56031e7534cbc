"""subsoil urdf SCENE: the machine as URDF, as it is published and recorded on /robot_description."""

import argparse
from pathlib import Path

from ._shared.arguments import add_overrides
from ._shared.output import write_out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `subsoil urdf`."""
    parser.add_argument("scene", help="scene file (.yaml)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write; standard output without it")
    add_overrides(parser)


def run(args: argparse.Namespace) -> int:
    """Write the URDF.

    Raises:
        InputError: the scene cannot be used, or the file cannot be written.
    """
    from ..loading.loader import load_scene
    from ..recording.robot_description import robot_description

    write_out(robot_description(load_scene(args.scene, args.overrides).scene), args.out)
    return 0
