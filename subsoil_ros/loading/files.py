"""File names in a scene document, and the files that come with the package."""

import copy
import os.path
from collections.abc import Callable
from pathlib import Path

from ..errors import InputError
from ..yaml_document import Document


def map_files(document: Document, change: Callable[[str], str]) -> Document:
    """Return a copy of a document, or of a fragment of one, with `change` applied to every file name."""
    copied = copy.deepcopy(document)
    soil = copied.get("soil")
    for key in ("file", "fitted_to", "material"):
        _change(soil, key, change)
    if isinstance(soil, dict):
        _change(soil.get("bed"), "file", change)
    _change(copied.get("report"), "reference", change)
    tools = copied.get("tools")
    for tool in tools.values() if isinstance(tools, dict) else ():
        _change(tool, "mesh", change)
        groups = tool.get("groups") if isinstance(tool, dict) else None
        for part in groups.values() if isinstance(groups, dict) else ():
            _change(part, "mesh", change)
    return copied


def _change(holder: object, key: str, change: Callable[[str], str]) -> None:
    if isinstance(holder, dict) and isinstance(holder.get(key), str):
        holder[key] = change(holder[key])


def with_absolute_files(document: Document, directory: Path) -> Document:
    """Return a copy with absolute file paths; relative ones start at the folder of the document.

    A bare name without a file there may be the name of a shipped reference or material.
    """

    def absolute(name: str) -> str:
        shipped = shipped_material(shipped_reference(Path(name)))
        path = directory / name
        return str((path if os.path.isfile(path) else directory / shipped).resolve())

    return map_files(document, absolute)


_PACKAGE = Path(__file__).resolve().parents[1]


def config_folder() -> Path:
    """The folder `config` of the source tree, or that of the installation, in share/subsoil_ros.

    Raises:
        InputError: the package was copied without its data files.
    """
    if (_PACKAGE.parent / "package.xml").is_file():
        return _PACKAGE.parent / "config"
    for prefix in _PACKAGE.parents:  # an installed package stands some folders below its prefix
        found = prefix / "share" / "subsoil_ros" / "config"
        if found.is_dir():
            return found
    raise InputError(
        f"{_PACKAGE}: the files that come with it (share/subsoil_ros) are not there; install the package "
        "with pip or colcon instead of copying it"
    )


def shipped_scene(path: Path) -> Path:
    """Return `path`, or the shipped scene of that name if `path` is a bare name without a file."""
    return _shipped(path, "scenes")


def shipped_reference(path: Path) -> Path:
    """As shipped_scene, for reference files."""
    return _shipped(path, "references")


def shipped_material(path: Path) -> Path:
    """As shipped_scene, for material files."""
    return _shipped(path, "materials")


def shipped_soil(path: Path) -> Path:
    """As shipped_scene, for soils of laboratories."""
    return _shipped(path, "soils")


def shipped_names(kind: str) -> list[str]:
    """Names of the shipped scenes, materials, templates etc.: the folder of `config` that holds them."""
    return sorted(path.stem for path in (config_folder() / kind).glob("*.yaml"))


def _shipped(path: Path, kind: str) -> Path:
    if os.path.isfile(path) or path.suffix or path.parent != Path():
        return path
    try:
        found = config_folder() / kind / f"{path}.yaml"
    except InputError:
        return path
    return found if os.path.isfile(found) else path
