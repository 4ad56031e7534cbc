"""From a scene file and overrides to a validated scene, ready to run."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..errors import SceneError
from ..limits.communication_steps import longest_exchange_ns
from ..limits.stable_steps import Timing, derive_timing
from ..scene.bed_kinds import SavedBed
from ..scene.material import Material
from ..scene.scene import Scene
from ..scene.tool_mesh import ToolMesh, load_tool_mesh
from ..schedule import Schedule
from ..yaml_document import Document, dump_yaml, merge
from .files import shipped_scene, with_absolute_files
from .fragments import with_base, with_initial_condition, with_preset
from .material_file import is_of, material_first, with_material, with_window
from .overrides import Override, apply_override, origin, overrides_of, parse_overrides
from .presets import (
    OF_MATERIALS,
    Preset,
    applies_to_particles,
    gives_size,
    is_spent,
    measured_presets,
    preset_changes,
    read_preset,
)
from .reference import Reference, read_reference
from .short_scene import Derived, comes_first, completed, is_short, with_one_time, with_stl_files
from .soil_file import check_wedge_soil
from .validation import CHOICES, validated, value_at

SIZE = ("soil", "particles", "radius_m")

ROW_NS = 2_000_000
"""Longest row of the series of a machine that predicts its motion, by default: means over 20 ms have ten."""

SHORT_PRESET = "standard"
"""Of a scene in short that gives neither a preset nor the size of its particles."""


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
    derived: tuple[Derived, ...] = ()  # what a scene in short did not give

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
    return _resolved(_Draft(with_base(file, shown, (), given), file, shown, changes))


@dataclass
class _Draft:
    """A scene between two passes."""

    document: Document
    path: Path
    shown: str  # the file in errors
    changes: Sequence[Override]
    presets: Mapping[str, Preset] = field(default_factory=dict)
    choices: Document = field(default_factory=dict)  # the loader's own keys
    derived: tuple[Derived, ...] = ()
    material: Material | None = None
    material_file: str | None = None

    def chosen(self, key: str) -> list[Override]:
        """The overrides that choose a fragment."""
        return [change for change in self.changes if change.path == key]


def _resolved(draft: _Draft) -> ResolvedScene:
    """The scene of a draft, its base merged in already."""
    for complete in (
        _complete_short,
        _read_presets,
        _lay_initial_condition,
        _add_material_preset,
        _lay_preset,
        _set_choices_aside,
        _apply_overrides,
        _read_cad_files,
        _fill_window,
    ):
        complete(draft)
    scene = validated(Scene, draft.document, draft.shown, lambda path: origin(path, draft.changes))
    if draft.material and (scene.particle_soil is None or not is_of(scene.particle_soil, draft.material)):
        draft.material = draft.material_file = None  # the soil is another one
    try:
        meshes = _meshes(scene, draft.path.parent)
        scene, timing = _with_timing(draft, scene, meshes)
        return ResolvedScene(
            scene=scene,
            path=draft.path,
            directory=draft.path.parent,
            document=json.loads(json.dumps({"name": scene.name, **draft.choices, **draft.document})),
            scene_hash=_scene_hash(scene),
            timing=timing,
            notes=_wedge_notes(scene, draft.path.parent),
            preset=draft.choices.get("preset"),
            presets=draft.presets or _presets_of(draft.material_file, scene),
            reference=_reference(scene),
            material=draft.material,
            material_file=draft.material_file,
            derived=draft.derived,
        )
    except SceneError as error:
        raise SceneError(f"{draft.shown}: {error}") from error


def _soil_in_full(change: Override) -> Override:
    by_name = change.path == "soil" and isinstance(change.value, str)
    return replace(change, path="soil.material") if by_name else change


def _complete_short(draft: _Draft) -> None:
    """Derive what a scene in short leaves out, and choose its preset."""
    draft.changes = [_soil_in_full(change) for change in draft.changes]
    if not is_short(draft.document, draft.changes):
        return
    draft.document = with_one_time(draft.document, draft.changes)
    _apply(draft, [change for change in draft.changes if comes_first(change.path)])
    draft.changes = [change for change in draft.changes if not comes_first(change.path)]
    sized = any(map(gives_size, draft.changes)) or value_at(draft.document, SIZE) is not None
    draft.document, draft.derived = completed(draft.document, draft.changes, draft.path, draft.shown)
    if not draft.derived or sized or not value_at(draft.document, ("soil", "material")):
        return
    if draft.document.get("preset") is None and not draft.chosen("preset"):
        draft.document = {**draft.document, "preset": SHORT_PRESET}
        chosen = Derived("preset", SHORT_PRESET, "the size of particles is not given")
        draft.derived = (chosen, *draft.derived)
    draft.derived = tuple(item for item in draft.derived if item.key != ".".join(SIZE))  # the preset's


def _read_presets(draft: _Draft) -> None:
    draft.presets = {
        name: read_preset(content, f"{draft.shown}: presets.{name}")
        for name, content in draft.document.get("presets", {}).items()
    }


def _lay_initial_condition(draft: _Draft) -> None:
    chosen = draft.chosen("initial_condition")
    draft.document = with_initial_condition(draft.document, draft.shown, chosen)


def _add_material_preset(draft: _Draft) -> None:
    """Add the chosen preset of the scene's material, which follows from the scene without a preset."""
    chosen, shown = draft.chosen("preset"), draft.shown
    name = chosen[-1].value if chosen else draft.document.get("preset")
    if not isinstance(name, str) or name not in OF_MATERIALS or name in draft.presets:
        return
    document = {key: value for key, value in draft.document.items() if key != "preset"}
    changes = [change for change in draft.changes if applies_to_particles(change.path, name)]
    without = _resolved(_Draft(document, draft.path, shown, changes))
    if without.material is None:
        where = chosen[-1].source if chosen else f"{shown}: preset"
        raise SceneError(
            f"{where}: '{name}' is for a soil.material as it was calibrated, and this scene has none, or "
            "another law, density, bed, layers or bonds than its material; leave the preset out, and set "
            "soil.particles.radius_m"
        )
    draft.presets = {**draft.presets, **measured_presets(without.material_file, without.scene)}
    meshes, sized = _meshes(without.scene, without.directory), any(map(gives_size, draft.changes))
    try:
        found = preset_changes(
            name, without.scene, meshes, without.material, without.material_file, sized=sized
        )
    except SceneError as error:
        raise SceneError(f"{shown}: {error}") from error
    measured = draft.presets[name].model_dump(mode="json", exclude_none=True)
    presets = {**draft.document.get("presets", {}), name: measured | {"changes": found}}
    draft.document = {**draft.document, "presets": presets}
    draft.changes = [change for change in draft.changes if not is_spent(change.path, name)]


def _lay_preset(draft: _Draft) -> None:
    draft.document = with_preset(draft.document, draft.shown, draft.chosen("preset"), OF_MATERIALS)


def _set_choices_aside(draft: _Draft) -> None:
    draft.changes = [change for change in draft.changes if change.path not in CHOICES]
    keys = [key for item in CHOICES.items() for key in item if key in draft.document]
    draft.choices = {key: draft.document.pop(key) for key in keys}


def _apply_overrides(draft: _Draft) -> None:
    """Apply the overrides; particles take the place of a soil.material once they have chosen both."""
    first, rest = material_first(draft.document, draft.changes)
    _apply(draft, first)
    soil = draft.document.get("soil")
    draft.material_file = soil.get("material") if isinstance(soil, dict) else None
    draft.document, draft.material = with_material(draft.document, draft.shown)
    if draft.material is None:
        draft.material_file = None  # of a terrain, which has taken its values
    _apply(draft, rest)


def _apply(draft: _Draft, changes: Sequence[Override]) -> None:
    for change in changes:
        changed = apply_override(draft.document, change)
        draft.document = with_absolute_files(changed, draft.path.resolve().parent)


def _read_cad_files(draft: _Draft) -> None:
    draft.document = with_stl_files(draft.document, draft.path.parent, draft.shown)


def _fill_window(draft: _Draft) -> None:
    draft.document = with_window(draft.document, draft.material, draft.shown)


def _meshes(scene: Scene, directory: Path) -> dict[str, ToolMesh]:
    return {tool: load_tool_mesh(directory, scene, tool) for tool in scene.tools}


def _with_timing(draft: _Draft, scene: Scene, meshes: dict[str, ToolMesh]) -> tuple[Scene, Timing]:
    """The scene with its communication step, where that follows from a material, and its steps; and with
    rows of the series that suit a long step, where it has none of its own."""
    timing, changes = derive_timing(scene), dict[str, Document]()
    step_ns = timing.communication_step_ns
    if draft.material is not None and scene.coupling.communication_step_ns == "auto":
        step_ns = longest_exchange_ns(scene, meshes, timing)
        changes["coupling"] = {"communication_step_ns": step_ns}
    rows = "series_ticks" in scene.record.model_fields_set or scene.controller is not None
    if (
        scene.particle_soil is not None
        and scene.predicts_motion
        and not rows
        and step_ns * scene.record.series_ticks > ROW_NS
    ):
        changes["record"] = {"series_ticks": max(1, ROW_NS // step_ns)}
    draft.document = merge(draft.document, changes, draft.shown)
    parts = {key: getattr(scene, key).model_copy(update=part) for key, part in changes.items()}
    scene = scene.model_copy(update=parts)
    return scene, derive_timing(scene)


def _wedge_notes(scene: Scene, directory: Path) -> tuple[str, ...]:
    soil = scene.wedge_soil
    if soil is None:
        return ()
    fitted_to = None if soil.fitted_to is None else load_scene(soil.fitted_to).scene
    return check_wedge_soil(scene, directory, fitted_to)


def _reference(scene: Scene) -> Reference | None:
    named = scene.report.reference
    return None if named is None else read_reference(Path(named))


def _presets_of(material_file: str | None, scene: Scene) -> Mapping[str, Preset]:
    return {} if material_file is None else measured_presets(material_file, scene)


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
            part["mesh"] = _file_hash(part["mesh"], f"tools.{name}.groups.{group}.mesh", "an .stl file")
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
