"""From a scene file and overrides to a validated scene, ready to run.

A scene file may have five keys beside those of the model. `base: FILE` names a scene that this one is
laid over (mappings merge, anything else replaces, null removes). `initial_conditions` holds fragments by
name, and `initial_condition` names the one that is laid over the rest. `presets` holds more of them, each
with what a study measured of it, and `preset` names the one that is laid over all that, if any.
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import SceneError
from ..limits.communication_steps import longest_exchange_ns
from ..limits.stable_steps import Timing, derive_timing
from ..scene.bed_kinds import SavedBed
from ..scene.material import Material
from ..scene.scene import Scene
from ..scene.tool_mesh import load_tool_mesh
from ..schedule import Schedule
from ..yaml_document import Document, dump_yaml, merge, plain_value, read_document
from .files import with_absolute_files
from .keys import suggestion
from .material import is_of, material_first, with_material, with_window
from .material_presets import NAMES as MATERIAL_PRESETS
from .material_presets import (
    applies_to_particles,
    gives_size,
    is_spent,
    measured_presets,
    preset_changes,
)
from .overrides import CHOICES, Override, apply_override, overrides_of, parse_overrides
from .presets import Preset, read_preset
from .reference import Reference, read_reference
from .shipped import shipped_scene
from .soil_file import check_wedge_soil
from .validation_errors import validated


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
    preset: str | None = None  # the preset that was chosen
    presets: Mapping[str, Preset] = field(default_factory=dict)  # all that the scene file has
    reference: Reference | None = None  # what report.reference names
    material: Material | None = None  # what soil.material named; `document` has its particles instead
    material_file: str | None = None  # the file it was read from

    @property
    def schedule(self) -> Schedule:
        """What is due at each tick of a run of the scene."""
        return Schedule.of(self.scene, self.timing)

    def write(self, path: Path) -> None:
        """Write `document` as a scene file."""
        path.write_text(dump_yaml(self.document), encoding="utf-8")


def load_scene(
    path: str | Path | Document, overrides: Sequence[str] | Mapping[str, object] = ()
) -> ResolvedScene:
    """Read, merge and validate a scene: a file, the name of a shipped one, or a document.

    Files that a document names are seen from the working folder.

    overrides: "a.b.c=value" texts, the value in YAML, or values by dotted path; applied last. They may also
    choose the `initial_condition` and the `preset`.

    Raises:
        SceneError: whatever is wrong with file, overrides, meshes or time steps; every line names
            the file (or the override) and the place.
    """
    given = path if isinstance(path, dict) else None
    shown = "scene" if given is not None else str(path)
    file = Path("scene") if isinstance(path, dict) else shipped_scene(Path(path))
    changes = overrides_of(overrides) if isinstance(overrides, Mapping) else parse_overrides(overrides)
    return _resolved(_with_base(file, shown, (), given), file, shown, changes)


def _resolved(document: Document, path: Path, shown: str, changes: Sequence[Override]) -> ResolvedScene:
    """The scene of a file, its base merged in already."""
    presets = {
        name: read_preset(content, f"{shown}: presets.{name}")
        for name, content in document.get("presets", {}).items()
    }
    chosen = [c for c in changes if c.path == "preset"]
    name = chosen[-1].value if chosen else document.get("preset")
    plain = None
    if isinstance(name, str) and name in MATERIAL_PRESETS and name not in presets:
        own = {key: value for key, value in document.items() if key != "preset"}
        plain = _resolved(own, path, shown, [c for c in changes if applies_to_particles(c.path, name)])
    document = _with_initial_condition(document, shown, [c for c in changes if c.path == "initial_condition"])
    if plain is not None and plain.material is None:
        where = chosen[-1].source if chosen else f"{shown}: preset"
        raise SceneError(
            f"{where}: '{name}' is for a soil.material as it was calibrated, and this scene has none, or "
            "another law, density, bed, layers or bonds than its material; leave the preset out, and set "
            "soil.particles.radius_m"
        )
    if plain is not None and plain.material is not None:
        presets = {**presets, **measured_presets(plain.material_file, plain.scene)}
        sized = any(map(gives_size, changes))
        document = _with_material_preset(document, str(name), plain, presets, shown, sized=sized)
    document = _with_preset(document, shown, chosen)
    changes = [c for c in changes if c.path not in CHOICES and not (plain and is_spent(c.path, str(name)))]
    kept = {key: document.pop(key) for item in CHOICES.items() for key in item if key in document}

    def changed(changes: Sequence[Override]) -> None:
        nonlocal document
        for change in changes:
            document = with_absolute_files(apply_override(document, change), path.resolve().parent)

    first, rest = material_first(document, changes)
    changed(first)
    material_file = document["soil"].get("material") if isinstance(document.get("soil"), dict) else None
    document, material = with_material(document, shown)
    changed(rest)
    document = with_window(document, material, shown)
    scene = validated(Scene, document, shown, changes)
    if material is not None and (scene.particle_soil is None or not is_of(scene.particle_soil, material)):
        material = None  # the soil is another one
    try:
        meshes = {tool: load_tool_mesh(path.parent, scene, tool) for tool in scene.tools}
        timing = derive_timing(scene)
        if material is not None and scene.coupling.communication_step_ns == "auto":
            interval = longest_exchange_ns(scene, meshes, timing)
            document = merge(document, {"coupling": {"communication_step_ns": interval}}, shown)
            scene = validated(Scene, document, shown, changes)
            timing = derive_timing(scene)
        scene_hash = _scene_hash(scene)
        notes = _wedge_notes(scene, path.parent)
        named = scene.report.reference
        reference = None if named is None else read_reference(Path(named))
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
        preset=kept.get("preset"),
        presets=presets or ({} if material is None else measured_presets(material_file, scene)),
        reference=reference,
        material=material,
        material_file=material_file if material is not None else None,
    )


def _wedge_notes(scene: Scene, directory: Path) -> tuple[str, ...]:
    soil = scene.wedge_soil
    if soil is None:
        return ()
    likeness = None if soil.fitted_to is None else load_scene(soil.fitted_to).scene
    return check_wedge_soil(scene, directory, likeness)


def _with_base(path: Path, shown: str, above: tuple[Path, ...], given: Document | None = None) -> Document:
    """The document of a file, or a given one as if it stood there, laid over its base.

    An initial condition or a preset replaces the base's of the same name; `initial_conditions: null` and
    `presets: null` drop those of the base. What was measured of a preset holds for the scene it stands in, so
    it is not inherited.
    """
    resolved = path.resolve()
    if resolved in above:
        raise SceneError(f"{shown}: base: the files name each other as base; remove one 'base'")
    document = read_document(path, shown) if given is None else _plain(given, shown)
    own = {
        "initial_conditions": _fragments(
            document, "initial_conditions", shown, lambda s: with_absolute_files(s, resolved.parent)
        ),
        "presets": _fragments(document, "presets", shown, lambda s: _absolute_preset(s, resolved.parent)),
    }
    dropped = [section for section in own if section in document and not document[section]]
    base = document.pop("base", None)
    document = with_absolute_files(
        {key: value for key, value in document.items() if key not in own}, resolved.parent
    )
    merged = document
    inherited: dict[str, Document] = {"initial_conditions": {}, "presets": {}}
    if base is not None:
        if not isinstance(base, str):
            raise SceneError(f"{shown}: base: given {base!r}; it must be the name of another scene file")
        below = _with_base(path.parent / base, f"{shown}: base: {path.parent / base}", (*above, resolved))
        inherited = {section: below.pop(section, {}) for section in own}
        inherited["presets"] = {
            name: {key: value for key, value in preset.items() if key != "expected"}
            for name, preset in inherited["presets"].items()
        }
        merged = merge(below, document, shown)
    for section, fragments in own.items():
        together = {**({} if section in dropped else inherited[section]), **fragments}
        if together:
            merged = {**merged, section: together}
    return merged


def _plain(given: Document, shown: str) -> Document:
    document = plain_value(given, shown)
    assert isinstance(document, dict)
    return document


def _fragments(
    document: Document, section: str, shown: str, change: Callable[[Document], Document]
) -> dict[str, Document]:
    """The named fragments of `initial_conditions` or `presets`, each changed; empty ones are {}."""
    found = document.get(section) or {}
    if not isinstance(found, dict) or not all(
        fragment is None or isinstance(fragment, dict) for fragment in found.values()
    ):
        raise SceneError(f"{shown}: {section}: must be a mapping of names, each with the keys it changes")
    return {name: change(fragment or {}) for name, fragment in found.items()}


def _absolute_preset(preset: Document, directory: Path) -> Document:
    changes = preset.get("changes")
    if not isinstance(changes, dict):
        return preset
    return {**preset, "changes": with_absolute_files(changes, directory)}


def _with_initial_condition(document: Document, shown: str, changes: Sequence[Override]) -> Document:
    """The document with its chosen initial condition laid over it and no other one left in it."""
    known = document.get("initial_conditions", {})
    name = _chosen(document, shown, changes, "initial_condition", "initial_conditions")
    if name is None:
        if known:
            raise SceneError(f"{shown}: initial_condition: is missing; choose one of {', '.join(known)}")
        return document
    rest = {key: value for key, value in document.items() if key != "initial_conditions"}
    merged = merge(rest, known[name], f"{shown}: initial_conditions.{name}")
    return {**merged, "initial_condition": name, "initial_conditions": {name: {}}}


def _with_preset(document: Document, shown: str, changes: Sequence[Override]) -> Document:
    """The document with its chosen preset laid over it; without a choice it stays as it is written."""
    presets = document.get("presets", {})
    name = _chosen(document, shown, changes, "preset", "presets")
    rest = {key: value for key, value in document.items() if key != "presets"}
    if name is None:
        return rest
    merged = merge(rest, presets[name].get("changes") or {}, f"{shown}: presets.{name}.changes")
    left = {key: value for key, value in presets[name].items() if key != "changes"}
    return {**merged, "preset": name, "presets": {name: left}}


def _with_material_preset(
    document: Document,
    name: str,
    plain: ResolvedScene,
    presets: Mapping[str, Preset],
    shown: str,
    *,
    sized: bool,
) -> Document:
    """The document with a preset of its material among its presets; `plain`: the scene without it."""
    assert plain.material is not None
    meshes = {tool: load_tool_mesh(plain.directory, plain.scene, tool) for tool in plain.scene.tools}
    try:
        changes = preset_changes(name, plain.scene, meshes, plain.material, plain.material_file, sized=sized)
    except SceneError as error:
        raise SceneError(f"{shown}: {error}") from error
    measured = presets[name].model_dump(mode="json", exclude_none=True)
    return {**document, "presets": {**document.get("presets", {}), name: measured | {"changes": changes}}}


def _chosen(
    document: Document, shown: str, changes: Sequence[Override], key: str, section: str
) -> str | None:
    """The name that `key` gives, in the file or by --set, of a fragment in `section`."""
    named = dict(document.get(section, {}))
    soil = document.get("soil")
    if key == "preset" and isinstance(soil, dict) and soil.get("material"):
        named |= dict.fromkeys(MATERIAL_PRESETS)  # to name them; one of them that fits is in the section
    name = changes[-1].value if changes else document.get(key)
    where = changes[-1].source if changes else f"{shown}: {key}"
    if name is None:
        return None
    if not isinstance(name, str) or name not in named:
        known = f"; {suggestion(str(name), named)}" if named else f"; the scene has no '{section}'"
        raise SceneError(f"{where}: no {key.replace('_', ' ')} '{name}'{known}")
    return name


def _scene_hash(scene: Scene) -> str:
    """Hash of what is run: defaults filled in, order of bodies kept, meshes and bed file by content.

    The reference is left out: no number of a run depends on it.
    """
    content = scene.model_dump(mode="json")
    wedge, particles = scene.wedge_soil, scene.particle_soil
    content["report"].pop("reference")
    if scene.stop_when is None:
        content.pop("stop_when")  # scenes without it have the hash of versions without the key
    for name, tool in content["tools"].items():
        if tool["path"] is not None and not tool["path"]["external"]:
            tool["path"].pop("external")
        for group, part in tool["groups"].items():
            advice = "an .stl file"
            part["mesh"] = _file_hash(part["mesh"], f"tools.{name}.groups.{group}.mesh", advice)
    if wedge is not None and wedge.file is not None:
        content["soil"]["file"] = _file_hash(wedge.file, "soil.file", "a soil file")
        content["soil"].pop("fitted_to")
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
