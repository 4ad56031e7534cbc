"""From a scene file and overrides to a validated scene, ready to run.

A scene file may have three keys beside those of the model. `base: FILE` names a scene that this one is
laid over (mappings merge, anything else replaces, null removes). `starts` holds fragments by name, and
`start` names the one that is laid over the rest.
"""

import copy
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from ..errors import SceneError
from .beds import SavedBed
from .complaints import describe
from .document import Document, dump_yaml, merge, read_document
from .keys import suggestion
from .limits import Timing, derive_timing
from .meshes import load_tool_mesh
from .model import Scene
from .overrides import Override, apply_override, parse_overrides
from .shipped import shipped_scene
from .soil_file import check_reduced_soil


@dataclass(frozen=True)
class ResolvedScene:
    """A scene that can be run: validated, its meshes checked, its time steps derived."""

    scene: Scene
    path: Path  # the scene file
    directory: Path  # of the scene file
    document: Document  # merged, as run; files by absolute path; loads to the same scene and hash
    scene_hash: str  # sha256 hex of the validated scene with the bytes of its files, without paths
    timing: Timing
    notes: tuple[str, ...] = ()  # what a run must say before it begins

    def write(self, path: Path) -> None:
        """Write `document` as a scene file."""
        path.write_text(dump_yaml(self.document), encoding="utf-8")


def load_scene(path: str | Path, overrides: Sequence[str] = ()) -> ResolvedScene:
    """Read, merge and validate a scene, a file or the name of a shipped one.

    overrides: "a.b.c=value" texts, the value in YAML, applied last; "start=NAME" chooses the start.

    Raises:
        SceneError: whatever is wrong with file, overrides, meshes or time steps; every line names
            the file (or the override) and the place.
    """
    shown = str(path)
    path = shipped_scene(Path(path))
    changes = parse_overrides(overrides)
    document = _with_base(path, shown, ())
    document = _with_start(document, shown, [c for c in changes if c.path == "start"])
    changes = [c for c in changes if c.path != "start"]
    kept = {key: document.pop(key) for key in ("start", "starts") if key in document}
    for change in changes:
        document = _with_absolute_files(apply_override(document, change), path.resolve().parent)
    scene = _validated(document, shown, changes)
    try:
        timing = derive_timing(scene)
        scene_hash = _scene_hash(scene)
        for tool in scene.tools:
            load_tool_mesh(path.parent, scene, tool)
        notes = _reduced_notes(scene, path.parent)
    except SceneError as error:
        raise SceneError(f"{shown}: {error}") from error
    return ResolvedScene(
        scene=scene,
        path=path,
        directory=path.parent,
        document=json.loads(json.dumps({"name": scene.name, **kept, **document})),  # shares nothing
        scene_hash=scene_hash,
        timing=timing,
        notes=notes,
    )


def _reduced_notes(scene: Scene, directory: Path) -> tuple[str, ...]:
    soil = scene.reduced_soil
    if soil is None:
        return ()
    likeness = None if soil.stands_for is None else load_scene(soil.stands_for).scene
    return check_reduced_soil(scene, directory, likeness)


def _with_base(path: Path, shown: str, above: tuple[Path, ...]) -> Document:
    """The document of a file laid over its base.

    A start replaces the base's start of the same name; `starts: null` drops those of the base.
    """
    resolved = path.resolve()
    if resolved in above:
        raise SceneError(f"{shown}: base: the files name each other as base; remove one 'base'")
    document = read_document(path, shown)
    starts = document.get("starts") or {}
    if not isinstance(starts, dict) or not all(
        fragment is None or isinstance(fragment, dict) for fragment in starts.values()
    ):
        raise SceneError(f"{shown}: starts: needed is a mapping of names, each with the keys it changes")
    base = document.pop("base", None)
    own_starts = {name: _with_absolute_files(s or {}, resolved.parent) for name, s in starts.items()}
    drops_starts = "starts" in document and not starts
    document = _with_absolute_files(
        {key: value for key, value in document.items() if key != "starts"}, resolved.parent
    )
    merged = document
    inherited: dict[str, Document] = {}
    if base is not None:
        if not isinstance(base, str):
            raise SceneError(f"{shown}: base: given {base!r}, needed is the name of another scene file")
        below = _with_base(path.parent / base, f"{shown}: base: {path.parent / base}", (*above, resolved))
        inherited = {} if drops_starts else below.pop("starts", {})
        below.pop("starts", None)
        merged = merge(below, document, shown)
    all_starts = {**inherited, **own_starts}
    return {**merged, "starts": all_starts} if all_starts else merged


def _with_start(document: Document, shown: str, changes: Sequence[Override]) -> Document:
    """The document with its chosen start laid over it and no other start left in it."""
    starts = document.get("starts", {})
    name = changes[-1].value if changes else document.get("start")
    where = changes[-1].source if changes else f"{shown}: start"
    if name is None:
        if starts:
            raise SceneError(f"{shown}: start: is missing; choose one of {', '.join(starts)}")
        return document
    if not isinstance(name, str) or name not in starts:
        known = f"; {suggestion(str(name), starts)}" if starts else "; the scene has no 'starts'"
        raise SceneError(f"{where}: no start '{name}'{known}")
    rest = {key: value for key, value in document.items() if key != "starts"}
    merged = merge(rest, starts[name], f"{shown}: starts.{name}")
    return {**merged, "start": name, "starts": {name: {}}}


def _with_absolute_files(document: Document, directory: Path) -> Document:
    """A copy with meshes and the soil's files by absolute path, seen from the folder it was written in."""
    copied = copy.deepcopy(document)
    soil = copied.get("soil")
    for key in ("file", "stands_for"):
        if isinstance(soil, dict) and isinstance(soil.get(key), str):
            soil[key] = str((directory / soil[key]).resolve())
    bed = soil.get("bed") if isinstance(soil, dict) else None
    if isinstance(bed, dict) and isinstance(bed.get("file"), str):
        bed["file"] = str((directory / bed["file"]).resolve())
    tools = copied.get("tools")
    for tool in tools.values() if isinstance(tools, dict) else ():
        groups = tool.get("groups") if isinstance(tool, dict) else None
        for part in groups.values() if isinstance(groups, dict) else ():
            if isinstance(part, dict) and isinstance(part.get("mesh"), str):
                part["mesh"] = str((directory / part["mesh"]).resolve())
    return copied


def _validated(document: Document, shown: str, changes: Sequence[Override]) -> Scene:
    try:
        # Strict JSON: lists may stand for tuples, but neither text nor booleans for numbers.
        return Scene.model_validate_json(json.dumps(document), strict=True)
    except ValidationError as error:
        raise SceneError(describe(error, document, shown, changes)) from error


def _scene_hash(scene: Scene) -> str:
    """Hash of what is run: defaults filled in, order of bodies kept, meshes and bed file by content."""
    content = scene.model_dump(mode="json")
    for name, tool in content["tools"].items():
        for group, part in tool["groups"].items():
            advice = "an .stl file"
            part["mesh"] = _file_hash(part["mesh"], f"tools.{name}.groups.{group}.mesh", advice)
    reduced, particles = scene.reduced_soil, scene.particle_soil
    if reduced is not None and reduced.file is not None:
        content["soil"]["file"] = _file_hash(reduced.file, "soil.file", "a soil file")
        content["soil"].pop("stands_for")
    if particles is not None and isinstance(particles.bed, SavedBed):
        bed = content["soil"]["bed"]
        bed["file"] = _file_hash(bed["file"], "soil.bed.file", "a bed file")
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _file_hash(path: str, place: str, needed: str) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise SceneError(
            f"{place}: {path}: {error.strerror}; give the path of {needed}, seen from the folder of the "
            "scene file"
        ) from error
