"""File names in a scene document: meshes, a saved bed, a soil or material file, a reference file."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..yaml_document import Document
from .shipped import shipped_material, shipped_reference


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
        groups = tool.get("groups") if isinstance(tool, dict) else None
        for part in groups.values() if isinstance(groups, dict) else ():
            _change(part, "mesh", change)
    return copied


def _change(holder: Any, key: str, change: Callable[[str], str]) -> None:
    if isinstance(holder, dict) and isinstance(holder.get(key), str):
        holder[key] = change(holder[key])


def with_absolute_files(document: Document, directory: Path) -> Document:
    """Return a copy with absolute file paths; relative ones start at the folder of the document.

    A bare name without a file there may be the name of a shipped reference or material.
    """

    def absolute(name: str) -> str:
        shipped = shipped_material(shipped_reference(Path(name)))
        path = directory / name
        return str((path if path.is_file() else directory / shipped).resolve())

    return map_files(document, absolute)
