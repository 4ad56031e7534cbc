"""Scenes in short: a soil by name, tools by mesh, depth and speed, and a travel; the rest is derived.

What a scene gives itself stays as it is. A tool with `depth_m` makes a scene one in short; files of CAD
programs, `mesh` on a tool and `soil: NAME` are read in every scene.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import SceneError
from ..scene.cad_mesh import blade_mesh, metres_per_unit, read_cad, refuse_absurd, turned_upright, write_stl
from ..scene.soil import rupture_distance_m
from ..scene.tool_shape import ToolShape, tool_shape
from ..scene.tools import Blade, CadKeys, MeshPart, Tool
from ..yaml_document import Document, leaves, merge
from .material_file import read_material
from .overrides import Override
from .presets import IN_DEPTH, LEAST_ACROSS
from .validation import validated, value_at

CAD_KEYS = tuple(CadKeys.model_fields)
TIMES = ("travel_m", "duration_s")
"""Two ways to give the time of a run."""

START_M = 0.05
"""Way of the foremost point to the soil: the first contact is within the run, at any depth."""

DEPTHS_BESIDE, DEPTHS_DEEP = 1.0, 1.5
"""Soil to each side of the tools and in all, in depths: nearly twice the width, or half as much soil more
below, changes the mean draft in loam by less than is resolved, 4 to 6 % (validation/field.md)."""

ROUND_M = 0.05
"""Sizes of fields are whole multiples of it."""

COUPLING: Document = {"communication_step_ns": 500_000, "force": "tick_mean"}
"""A tool on a path is moved by no force, so rows need no soil step each: means over half a millisecond."""


TOO_LATE = (
    "given in an initial condition or preset, from which nothing is derived; give it in the scene itself, or "
    "there what it stands for"
)

Fill = Callable[[str, Any, str], None]
"""Gives a key of the scene its value, for a reason, unless it has one."""


class Derived(NamedTuple):
    """One value that the scene did not give."""

    key: str
    value: str
    reason: str


@dataclass
class _Placed:
    """A tool with its file read."""

    name: str
    depth_m: float
    speed_m_per_s: float
    lateral_m: float
    shape: ToolShape
    is_tillage: bool


def is_short(document: Document, changes: Sequence[Override]) -> bool:
    """Whether a tool of the scene has a depth or speed, or a travel is given, by the file or an override."""
    tools = _mappings(document.get("tools"))
    given = [document.get("travel_m"), *(change.value for change in changes if change.path == "travel_m")]
    for change in changes:
        keys = change.path.split(".")
        if keys == ["tools"]:
            tools += _mappings(change.value)
        elif keys[0] == "tools" and len(keys) == 2:
            tools += _mappings({keys[1]: change.value})
        elif keys[0] == "tools" and keys[2:] in (["depth_m"], ["speed_m_per_s"]):
            given.append(change.value)
    given += [tool.get(key) for tool in tools for key in ("depth_m", "speed_m_per_s")]
    return any(value is not None for value in given)


def comes_first(path: str) -> bool:
    """Whether an override changes what is derived from: time, soil, and tools but for their paths."""
    keys = path.split(".")
    return path in (*TIMES, "soil.material") or (keys[0] == "tools" and "path" not in keys[2:3])


def with_one_time(document: Document, changes: Sequence[Override]) -> Document:
    """The document without the time that an override replaces by the other way to give one."""
    given = {change.path for change in changes} & set(TIMES)
    return {k: v for k, v in document.items() if k not in TIMES or len(given) != 1 or k in given}


def _leaves_out(document: object, keys: Sequence[str]) -> bool:
    """Whether a key is missing; null, and another value where a mapping is needed, are given."""
    for key in keys:
        if not isinstance(document, dict):
            return False
        if key not in document:
            return True
        document = document[key]
    return False


def _mappings(value: object) -> list[Document]:
    items = value.values() if isinstance(value, dict) else ()
    return [item for item in items if isinstance(item, dict)]


def with_stl_files(document: Document, folder: Path, shown: str) -> Document:
    """The document with STL files in metres in the place of all others; `mesh` of a tool is a group.

    Raises:
        SceneError: a mesh that cannot be used, or a key in short that came too late to derive from.
    """
    if document.get("travel_m") is not None:
        raise SceneError(f"{shown}: travel_m: {TOO_LATE}")
    tools = document.get("tools")
    if not isinstance(tools, dict):
        return document
    done = {}
    for name, tool in tools.items():
        where = f"{shown}: tools.{name}"
        done[name] = _with_files(name, tool, folder, where) if isinstance(tool, dict) else tool
        for key in ("depth_m", "speed_m_per_s"):
            if value_at(tool, (key,)) is not None:
                raise SceneError(f"{where}: {key}: {TOO_LATE}")
    return {**document, "tools": done}


def completed(
    document: Document, changes: Sequence[Override], path: Path, shown: str
) -> tuple[Document, tuple[Derived, ...]]:
    """The document without keys in short, and what was derived for them.

    changes: overrides that are applied later; what they give is not listed.

    Raises:
        SceneError: a mesh that cannot be used, or values from which nothing can be derived.
    """
    tools = document.get("tools")
    placed: list[_Placed] = []
    done: dict[str, object] = {}
    if isinstance(tools, dict):
        for name, tool in tools.items():
            done[name] = _in_full(name, tool, path.parent, f"{shown}: tools.{name}", placed)
        document = {**document, "tools": done}
    travel = document.get("travel_m")
    if travel is not None and not placed:
        raise SceneError(
            f"{shown}: travel_m: given without a tool in short, which has depth_m and speed_m_per_s; give "
            "duration_s"
        )
    if not placed:
        return document, ()
    derived: list[Derived] = []
    document = {key: value for key, value in document.items() if key != "travel_m"}
    later = [f"{path}." for change in changes for path, _ in leaves(change.value, change.path)]

    def fill(key: str, value: Any, reason: str) -> None:
        nonlocal document
        keys = key.split(".")
        if _leaves_out(document, keys):
            if not any(path.startswith(f"{key}.") or f"{key}.".startswith(path) for path in later):
                derived.append(Derived(key, _words(value), reason))
            for inner in reversed(keys[1:]):
                value = {inner: value}
            document = merge(document, {keys[0]: value}, shown)

    fill("name", path.stem, "the file's name")
    if travel is not None and document.get("duration_s") is not None:
        raise SceneError(f"{shown}: given both travel_m and duration_s; give one of them")
    _fill_time(travel, placed, fill, shown)
    first = next((name for name, tool in done.items() if value_at(tool, ("role",)) != "wheel"), None)
    tip = next((tool.shape.tip_m for tool in placed if tool.name == first), None)  # that metrics follow
    behind_m = 0.0 if tip is None else round(max(tip[0] - tool.shape.tip_m[0] for tool in placed), 6)
    _fill_soil(document, placed, behind_m, fill, shown)
    start_x_m = round(-START_M - max(tool.shape.foremost_m for tool in placed), 6)
    for tool in placed:
        key, z = f"tools.{tool.name}.path", tool.shape.tip_m[1]
        if any(change.path == key for change in changes):
            continue  # another path, as a whole
        fill(f"{key}.start_x_m", start_x_m, f"foremost point of all {START_M * 1e3:g} mm before the soil")
        fill(f"{key}.start_z_m", round(-tool.depth_m - z, 6), f"lowest point {tool.depth_m:g} m deep")
        fill(f"{key}.speed_x_m_per_s", tool.speed_m_per_s, f"speed_m_per_s of {tool.name}")
    if tip is not None:
        fill("report.tip_m", [round(at, 6) for at in tip], f"foremost of the lowest edge of {first}")
    for name, value in COUPLING.items():
        fill(f"coupling.{name}", value, "forces are means over half a millisecond")
    return document, tuple(derived)


def _with_files(name: str, tool: Document, folder: Path, where: str) -> Document:
    """A tool with groups of STL files in metres; depth and speed stay."""
    short = {key: tool[key] for key in (*CAD_KEYS, "mesh") if tool.get(key) is not None}
    rest = {key: value for key, value in tool.items() if key not in (*CAD_KEYS, "mesh")}
    own, groups = "mesh" in short, rest.get("groups")
    if own and groups:
        raise SceneError(f"{where}: given both 'mesh' and 'groups'; give 'mesh' for one file")
    if short and not own:
        raise SceneError(
            f"{where}: {', '.join(short)}: given without 'mesh'; give it with the file of a group"
        )
    if own:
        groups = {name: short}
    if (blade := rest.pop("blade", None)) is not None:
        if own or groups:
            raise SceneError(f"{where}: given both 'blade' and a mesh; give one of them")
        groups = {name: {"mesh": str(_blade_file(blade, rest.get("depth_m"), f"{where}.blade"))}}
    if isinstance(groups, dict):
        rest["groups"] = {
            group: _usable(part, folder, where if own else f"{where}.groups.{group}", own)
            for group, part in groups.items()
        }
    return rest


def _blade_file(given: Any, depth_m: object, where: str) -> Path:
    blade = validated(Blade, given, where)
    if blade.height_m is not None:
        height_m = blade.height_m
    elif isinstance(depth_m, int | float) and depth_m > 0.0:
        height_m = 2.0 * depth_m
    else:
        raise SceneError(f"{where}: height_m: is missing; a tool without depth_m needs it")
    return write_stl(*blade_mesh(blade, height_m), "blade")


def _in_full(name: str, tool: object, folder: Path, where: str, placed: list[_Placed]) -> object:
    """A tool with its files read and its keys in short taken out; one with a depth is added to `placed`."""
    if not isinstance(tool, dict):
        return tool
    full = _with_files(name, tool, folder, where)
    rest = {key: value for key, value in full.items() if key not in ("depth_m", "speed_m_per_s")}
    if full.get("depth_m") is None and full.get("speed_m_per_s") is None:
        return rest
    if rest.get("path") is not None or rest.get("body") is not None:
        raise SceneError(
            f"{where}: depth_m and speed_m_per_s stand for a path, and 'path' or 'body' is given too; "
            "give one of them"
        )
    checked = validated(Tool, {**full, "path": {}}, where)
    if checked.depth_m is None or checked.speed_m_per_s is None:
        raise SceneError(f"{where}: give both depth_m and speed_m_per_s")
    if checked.speed_m_per_s <= 0.0:
        raise SceneError(
            f"{where}: speed_m_per_s: given {checked.speed_m_per_s:g}, must be above 0; turn the mesh by "
            "rotation_deg: [0, 0, 180] if it looks backward"
        )
    vertices, facets = _assembled(checked, folder, where)
    shape = tool_shape(vertices, facets, checked.depth_m)
    speed_m_per_s, lateral_m = checked.speed_m_per_s, checked.lateral_m
    placed.append(_Placed(name, checked.depth_m, speed_m_per_s, lateral_m, shape, checked.is_tillage))
    return rest


def _usable(part: object, folder: Path, where: str, own: bool) -> object:
    """A part with an STL file that stands upright, and its scale.

    own: the file of a tool in short, whose size must be that of a tool.
    """
    if not isinstance(part, dict) or not isinstance(part.get("mesh"), str):
        return part
    path = folder / part["mesh"]
    plain = path.suffix.lower() == ".stl" and not any(part.get(key) for key in CAD_KEYS)
    if plain and not own:
        return part
    keys = validated(MeshPart, part, where)
    place = f"{where}.mesh: {path}"
    mesh, metres = read_cad(path, place)
    if keys.unit is not None and (metres is not None or "scale" in part):
        named = "the file names its unit" if metres is not None else "scale is given too"
        raise SceneError(f"{where}: unit: given, and {named}; leave it out")
    if metres is None:
        metres = 1.0 if "scale" in part else metres_per_unit(mesh, keys.unit, place)
    if own:
        refuse_absurd(mesh, metres * keys.scale, place)
    rest = {key: value for key, value in part.items() if key not in CAD_KEYS}
    if path.suffix.lower() == ".stl" and keys.up == "z" and not any(keys.rotation_deg):
        return rest if metres == 1.0 else rest | {"scale": metres}
    vertices = turned_upright(mesh, keys.up, keys.rotation_deg) * metres
    return rest | {"mesh": str(write_stl(vertices, mesh.faces, path.stem))}


def _assembled(tool: Tool, folder: Path, where: str) -> tuple[np.ndarray, np.ndarray]:
    vertices, facets, count = [], [], 0
    for group, part in tool.groups.items():
        mesh, _ = read_cad(folder / part.mesh, f"{where}.groups.{group}.mesh: {folder / part.mesh}")
        vertices.append(np.asarray(mesh.vertices) * part.scale + part.position_m)
        facets.append(np.asarray(mesh.faces) + count)
        count += len(mesh.vertices)
    return np.concatenate(vertices), np.concatenate(facets)


def _fill_time(travel: object, placed: list[_Placed], fill: Fill, shown: str) -> None:
    if travel is None:
        return
    if isinstance(travel, bool) or not isinstance(travel, int | float) or not 0.0 < travel < math.inf:
        raise SceneError(f"{shown}: travel_m: given {travel!r}; it must be a number above 0")
    speeds = {tool.speed_m_per_s for tool in placed}
    if len(speeds) > 1:
        raise SceneError(
            f"{shown}: travel_m: tools move at {', '.join(f'{v:g}' for v in sorted(speeds))} m/s and need "
            "different times for it; give duration_s"
        )
    speed = speeds.pop()
    fill("duration_s", round(travel / speed, 6), f"{travel:g} m at {speed:g} m/s")


def _fill_soil(document: Document, placed: list[_Placed], behind_m: float, fill: Fill, shown: str) -> None:
    """Size of the field, of the particles, and where means begin; behind_m: of the last tip behind the first
    tillage tool's."""
    soil, depth = document.get("soil"), max(tool.depth_m for tool in placed)
    material = None
    if isinstance(soil, dict) and isinstance(soil.get("material"), str):
        material = read_material(Path(soil["material"]), f"{shown}: soil.material")
    duration = document.get("duration_s")
    ends = [abs(tool.lateral_m + side) for tool in placed for side in tool.shape.sides_m]
    travel = max(tool.speed_m_per_s for tool in placed) * (
        duration if isinstance(duration, int | float) else 0.0
    )
    ahead = depth if material is None else rupture_distance_m(depth, material.soil.friction_angle_deg)
    fill(
        "report.window_inside_m",
        math.ceil(100.0 * ahead) / 100.0,
        "ahead of the tip the soil fails within it",
    )
    if material is None or not isinstance(soil, dict):
        return
    deep = _rounded(DEPTHS_DEEP * depth)
    window = rupture_distance_m(deep, material.soil.friction_angle_deg)
    length = _rounded(travel + 2.0 * window + behind_m)  # so that it never shows the end
    beside = _rounded(2.0 * (max(ends) + DEPTHS_BESIDE * depth))
    fill("soil.bin.length_m", length, "longer than the travel by two windows")
    fill("soil.bin.width_m", beside, "a depth to each side of the tools")
    fill("soil.bin.depth_m", deep, "half a depth below the tools")
    fill("soil.bin.sides", "held", "the field goes on beside it")
    fill("soil.window", {}, "soil exists near the tools only: a longer field costs nothing")
    if value_at(soil, ("bed", "kind")) in (None, "tiled"):
        fill("soil.bed.seed", 1, "another seed is another sample of the soil")
    working = [tool for tool in placed if tool.is_tillage] or placed
    across = max(tool.depth_m for tool in working) / IN_DEPTH["standard"]
    wanted = 0.5 * min(across, min(tool.shape.width_m for tool in working) / LEAST_ACROSS)
    low, high = material.radii_m
    fill(
        "soil.particles.radius_m",
        min(max(round(wanted, 4), low), high),
        "of the preset standard: the size by depth and width of the tools",
    )


def _rounded(length_m: float) -> float:
    return round(math.ceil(length_m / ROUND_M - 1e-9) * ROUND_M, 6)


def _words(value: object) -> str:
    if value == {}:
        return "as the soil needs"
    if isinstance(value, list):
        return ", ".join(map(_words, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
