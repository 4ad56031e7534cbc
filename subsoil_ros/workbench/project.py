"""A project folder: scenes, tool files and runs by name. Nothing outside the folder has a name."""

import re
from collections.abc import Container
from dataclasses import dataclass
from io import StringIO
from itertools import count
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from ..errors import InputError
from ..loading.files import shipped_names
from ..whole_files import write_whole
from ..yaml_document import Document, parse_yaml

TOOL_SUFFIXES = (".stl", ".step", ".stp", ".obj", ".3mf")
LARGEST_TOOL_BYTES = 64_000_000
"""Of an uploaded file: a hundred times the largest mesh of the examples."""

MATERIAL = "_material.yaml"
"""How files of calibrated soils end; that of the laboratory's values has the rest of the name."""

FOLDERS = ("runs", "comparisons", "searches", "soils")
"""Of results."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}")

FLAT_BLADE = "flat blade"
"""In the place of a tool file."""

BLADE = {"rake_deg": 30.0, "width_m": 0.06}
"""A flat blade as it is when chosen: as wide as the shipped share, in the range of the preset real_time."""

TOOL_KEYS = ("unit", "up", "depth_m", "speed_m_per_s")
NUMBERS = ("depth_m", "speed_m_per_s", "travel_m", "turn_deg", *BLADE)
"""Keys of the form: of the tool beside its mesh, and those that are numbers."""

CAD_KEYS = ("unit", "up", "rotation_deg")
"""Keys of a tool that a flat blade does not have."""

CAUSES = {
    "unit": r"'unit'|unit",
    "up": r"'up",
    "depth_m": r"depth",
    "speed_m_per_s": r"speed|m/s",
    "travel_m": r"travel_m|duration_s",
    "rake_deg": r"rake",
    "width_m": r"blade\.width_m",
    "mesh": r"mesh",
    "preset": r"preset",
    "soil": r"soil",
}
"""Words of a message of `subsoil check` by the field of the form that it is about, the first that fits."""

PRESETS = ("real_time", "coarse", "standard", "fine")


@dataclass(frozen=True)
class Project:
    """A folder of scenes (NAME.yaml), tool files and runs (runs/NAME)."""

    folder: Path

    @property
    def runs(self) -> Path:
        """The folder of the runs."""
        return self.folder / "runs"

    def scenes(self) -> list[str]:
        """Names of the scenes."""
        return sorted(path.stem for path in self.folder.glob("*.yaml") if is_name(path.stem))

    def tools(self) -> list[str]:
        """Names of the tool files, with suffix."""
        return sorted(path.name for path in self.folder.iterdir() if path.suffix.lower() in TOOL_SUFFIXES)

    def soils(self) -> list[str]:
        """The shipped soils by name, and those of the project by file."""
        own = sorted(f"soils/{path.name}" for path in (self.folder / "soils").glob(f"*{MATERIAL}"))
        return [*own, *shipped_names("materials")]

    def scene_file(self, name: str) -> Path:
        """The file of a scene. Raises InputError for a name that is none."""
        return self.folder / f"{checked(name)}.yaml"

    def run_folder(self, name: str) -> Path:
        """The folder of a run. Raises InputError for a name that is none."""
        return self.runs / checked(name)

    def write_scene(self, name: str, text: str) -> Path:
        """Write a scene file, whole or not at all; return it. Raises InputError for a name that is none."""
        file = self.scene_file(name)
        write(file, text.encode())
        return file

    def served(self, path: str) -> Path | None:
        """A file that a browser may read: a scene, a tool, one in a folder of results; none hidden."""
        parts = Path(path).parts
        if not parts or any(part.startswith(".") or "\0" in part for part in parts):
            return None
        if len(parts) > 1 and parts[0] not in FOLDERS:
            return None
        file = (self.folder / path).resolve()
        if len(parts) == 1 and file.suffix.lower() not in (".yaml", *TOOL_SUFFIXES):
            return None
        return file if file.is_relative_to(self.folder.resolve()) and file.is_file() else None

    def add_tool(self, name: str, content: bytes) -> str:
        """Keep an uploaded tool file, and return its name in the folder.

        Raises:
            InputError: its name or kind cannot be used, it is too large, or there is another one.
        """
        stem, suffix = Path(name).stem, Path(name).suffix.lower()
        if suffix not in TOOL_SUFFIXES:
            raise InputError(f"{name}: is of no kind that is read; {', '.join(TOOL_SUFFIXES)} are")
        if len(content) > LARGEST_TOOL_BYTES:
            raise InputError(f"{name}: has {len(content):,} bytes; {LARGEST_TOOL_BYTES:,} are allowed")
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", stem).strip("_")
        path = self.folder / f"{checked(stem)}{suffix}"
        if path.exists() and path.read_bytes() != content:
            raise InputError(f"{path.name}: there is another file of this name; rename yours")
        write(path, content)
        return path.name


def is_name(name: str) -> bool:
    """Whether it is 1 to 60 letters, digits, - and _, and begins with one of the first two."""
    return _NAME.fullmatch(name) is not None


def checked(name: str) -> str:
    """The name itself. Raises InputError unless it is letters, digits, - and _ alone, 60 at most."""
    if not is_name(name):
        raise InputError(f"name: given '{name[:80]}'; it must be 1 to 60 letters, digits, - and _")
    return name


def free_name(stem: str, taken: Container[str]) -> str:
    """The first of STEM-1, STEM-2 ... that is not taken; a long stem is cut."""
    return next(name for k in count(1) if (name := f"{stem[:50]}-{k}") not in taken)


def cause_of(message: str) -> str | None:
    """The field of the form that a message of `subsoil check` is about, by its words; None: of no one."""
    words = re.sub(r"\S*/\S+\.\w+", "", re.sub(r"\btools\.\w+", "", message))  # names of files and tools
    return next((key for key, pattern in CAUSES.items() if re.search(pattern, words)), None)


def first_scene(tool: str) -> Document:
    """A scene in short around a tool file."""
    return {
        "soil": "loam",
        "tools": {"tool": {"mesh": tool, "depth_m": 0.2, "speed_m_per_s": 0.5}},
        "travel_m": 2.0,
        "preset": "real_time",
    }


def form_of(text: str) -> Document | None:
    """What the form shows of a scene in short with one tool; None for any other text."""
    try:
        document: Any = parse_yaml(text, "scene")
        ((_, tool),) = document["tools"].items()
        blade, (*others, turn) = tool.get("blade"), tool.get("rotation_deg") or (0, 0, None)
        if others != [0, 0]:
            return None
        shown: Document = {"mesh": FLAT_BLADE if blade else tool.get("mesh"), "turn_deg": turn}
        shown |= {key: tool.get(key) for key in TOOL_KEYS} | {key: (blade or {}).get(key) for key in BLADE}
        shown |= {key: document.get(key) for key in ("soil", "travel_m", "preset")}
    except (InputError, KeyError, TypeError, ValueError, AttributeError):
        return None
    fits = all(
        value is None or isinstance(value, (int, float) if key in NUMBERS else str)
        for key, value in shown.items()
    )
    return shown if fits and shown["mesh"] and shown["soil"] else None


def with_form(text: str, changes: Document) -> str:
    """The text of a scene in short with other values of the form, its comments kept; None removes a key."""
    yaml = YAML(typ="rt")
    yaml.width = 1000
    document = yaml.load(text)
    ((_, tool),) = document["tools"].items()
    for key, value in changes.items():
        owner, name = tool if key in TOOL_KEYS else document, key
        if key in BLADE:
            owner = tool["blade"]
        elif key == "turn_deg":
            owner, name, value = tool, "rotation_deg", [0, 0, value] if value else None
        elif key == "mesh":
            for other in ("blade", "mesh", *(CAD_KEYS if value == FLAT_BLADE else ())):
                tool.pop(other, None)
            owner, name = tool, "blade" if value == FLAT_BLADE else "mesh"
            value = dict(BLADE) if value == FLAT_BLADE else value
        if value is None:
            owner.pop(name, None)
        else:
            owner[name] = value
    out = StringIO()
    yaml.dump(document, out)
    return out.getvalue()


def write(path: Path, content: bytes) -> None:
    """Write a file whole, so that a reader never sees a half."""
    write_whole(path, lambda part: part.write_bytes(content))
