"""Shipped scenes, changed at random, loaded and checked.

Each case changes one to three places of a scene file: other values, types and names, missing, misspelt and
repeated keys, huge and tiny numbers. It must pass, or end in one message (InputError); no bed is prepared and
nothing is run.
"""

import json
import math
import re
import tempfile
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from dev.fuzz import outcome
from subsoil_ros import check, load_scene
from subsoil_ros.loading.files import config_folder, with_absolute_files
from subsoil_ros.yaml_document import read_document

SCENES = tuple(sorted(path.stem for path in (config_folder() / "scenes").glob("*.yaml")))

VALUES: tuple[Any, ...] = (
    0, 1, -1, 2, 10**9, 10**18, 10**40, 0.0, -0.0, 0.5, -1.0, math.pi, 1e-9, 1e-30, 1e-31, 5e-324, 1e9, 1e15,
    1e30, 1e31, 1.7e308, -1e30, math.nan, math.inf, -math.inf, True, False, None, "", "auto", "rest",
    "ground", "constant", "1e-3", "x", "none.stl", [], [0.0], [0.0, 0.0], [1e30, -1e30], {}, {"": 1},
    {"kind": "constant"}, {"kind": "constant", "value": 1.0},
)  # fmt: skip
"""In the place of any other value."""

_WORDS = {"NaN": ".nan", "Infinity": ".inf"}

Place = tuple[str | int, ...]


@cache
def _document(name: str, *, merged: bool) -> dict[str, Any]:
    """A shipped scene as its file has it, or with its base; files by absolute path."""
    path = config_folder() / "scenes" / f"{name}.yaml"
    if merged:
        return load_scene(path).document
    document = with_absolute_files(read_document(path, name), path.parent)
    return document | ({"base": str(path.parent / document["base"])} if "base" in document else {})


def _places(value: Any, place: Place = ()) -> list[Place]:
    """Every key and item of a document."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [found for key, item in items for found in ((*place, key), *_places(item, (*place, key)))]


def _changed(draw: st.DrawFn, document: dict[str, Any]) -> None:
    """One change, in place."""
    *above, key = draw(st.sampled_from(_places(document)))
    parent: Any = document
    for step in above:
        parent = parent[step]
    value = parent[key]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    ways = ["replace", "remove", "rename", "twice", "take"] + (
        ["scale"] * 4 + ["negate"] if is_number else []
    )
    way = draw(st.sampled_from(ways))
    if way == "scale":
        parent[key] = value * 10.0 ** draw(st.integers(-40, 40))
    elif way == "negate":
        parent[key] = -value
    elif way == "replace":
        parent[key] = deepcopy(draw(st.sampled_from(VALUES)))
    elif way == "take":  # what stands elsewhere
        *other, last = draw(st.sampled_from(_places(document)))
        found: Any = document
        for step in other:
            found = found[step]
        parent[key] = deepcopy(found[last])
    elif isinstance(parent, list):
        if way == "remove":
            del parent[key]
        else:
            parent.append(deepcopy(value))
    elif way == "remove":
        del parent[key]
    elif way == "rename":
        parent[f"{key}x"] = parent.pop(key)
    else:
        parent[_Twice(key)] = value


class _Twice(str):
    """A key that equals no other, and is written as another is."""

    __slots__ = ()

    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other


@st.composite
def cases(draw: st.DrawFn) -> str:
    """The text of a shipped scene with one to three changes."""
    document = deepcopy(_document(draw(st.sampled_from(SCENES)), merged=draw(st.booleans())))
    for _ in range(draw(st.integers(1, 3))):
        if _places(document):
            _changed(draw, document)
    text = json.dumps(document)  # YAML holds JSON, but for the numbers that JSON has not
    return re.sub(r"(?<=[ \[])(-?)(NaN|Infinity)(?=[,\]}])", lambda m: m[1] + _WORDS[m[2]], text)


def judge(text: str) -> str:
    """Load and check a scene of this text. Raises what is not a message."""
    with tempfile.TemporaryDirectory(prefix="subsoil_fuzz_") as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(text, encoding="utf-8")
        return outcome(lambda: str(check(load_scene(path))))
