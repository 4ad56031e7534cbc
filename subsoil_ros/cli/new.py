"""subsoil new NAME: a folder with a commented scene that runs at once."""

import argparse
import os
import re
import shutil
import tempfile
from pathlib import Path

from ..errors import InputError
from ..loading.files import config_folder, shipped_names

SCHEMA = "scene.schema.json"
_MESH = re.compile(r"\bmeshes/([\w.-]+\.stl)")
_NAME = re.compile(r"[A-Za-z][\w-]*")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", type=Path, help="folder to make; its last part becomes the name of the scene")
    parser.add_argument(
        "--template",
        default="tine",
        metavar="T",
        help="tine: a tool on a prescribed path; machine: a sprung tine behind a trolley; wedge: a tine in "
        "soil without particles (default: tine)",
    )


def run(args: argparse.Namespace) -> int:
    """Make the folder; on an error, nothing is left of it."""
    folder: Path = args.name
    if not _NAME.fullmatch(folder.name):
        raise InputError(
            f"NAME: given '{folder.name}', allowed are letters, digits, _ and -, beginning with a letter"
        )
    config = config_folder()
    template = config / "templates" / f"{args.template}.yaml"
    if not template.is_file():
        raise InputError(
            f"--template: given '{args.template}', allowed are {', '.join(shipped_names('templates'))}"
        )
    text = template.read_text(encoding="utf-8").replace("NAME", folder.name)
    if folder.exists():
        raise InputError(f"{folder}: exists already; nothing is written over, give another name")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
        try:
            (part / "meshes").mkdir()
            for mesh in sorted(set(_MESH.findall(text))):
                shutil.copyfile(config / "meshes" / mesh, part / "meshes" / mesh)
            shutil.copyfile(config / SCHEMA, part / SCHEMA)
            (part / "scene.yaml").write_text(text, encoding="utf-8")
            part.chmod(0o755)
            os.rename(part, folder)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); name a folder that can") from error
    scene = folder / "scene.yaml"
    print(f"{scene}: look into it, then")
    print(f"  subsoil check {scene}")
    print(f"  subsoil run {scene} --out runs/{folder.name}")
    return 0
