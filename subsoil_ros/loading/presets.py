"""Accuracy presets: named changes of a scene, with what a study measured of their error and their time.

Every scene whose soil is a material has some: rules for the size of its particles.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..errors import SceneError
from ..limits.soil_at_work import deepest_vertices_m, lowest_m, speed_and_depth
from ..limits.stable_steps import PREDICTED_INTERVAL_NS
from ..scene.material import Material
from ..scene.scene import Scene
from ..scene.tool_mesh import ToolMesh
from ..scene.tool_shape import part_below
from ..strict_model import Finite, Fraction, Positive, StrictModel
from ..yaml_document import Document, read_document
from .files import config_folder
from .overrides import Override
from .validation import validated


class ErrorInterval(StrictModel):
    """Error of one metric relative to what counts as true, and the interval that holds it."""

    mean: Finite
    low: Finite
    high: Finite


class Expected(StrictModel):
    """What a study measured of a preset. `subsoil study` writes it; nothing here is estimated."""

    against: str  # the runs that count as true
    errors: dict[str, ErrorInterval]  # by name of the metric
    errors_against: dict[str, dict[str, ErrorInterval]] = {}  # of other references, by their names
    confidence: Fraction  # of the intervals
    notes: list[str] = []  # what no error says
    wall_s_per_simulated_s: Positive | None = None  # None where another scene was measured
    machine: str  # that took this time
    source: str  # table, command and version


class Preset(StrictModel):
    """One preset: a fragment that is laid over the scene, as a start is."""

    changes: Document = {}
    expected: Expected | None = None  # None: the study has not been run


def read_preset(content: Document, place: str) -> Preset:
    """A preset of a scene document; `place` names it in errors. Raises SceneError."""
    return validated(Preset, content, place)


LEAST_ACROSS = 1.5
"""Particle diameters across the narrowest tool, at least: a third of its width as radius, the largest size
that has been compared with smaller ones (validation/trade.md)."""

IN_DEPTH = {"fine": 10.0, "standard": 20.0 / 3.0, "coarse": 5.0}
"""Particle diameters in the depth of the tools, by preset. With ten, drafts are within 10 % of those at two
thirds of the radius (validation/blades.md); the others: validation/trade.md."""

SET_BACK = {"fine": 0.5, "standard": 2.0 / 3.0, "coarse": 2.0 / 3.0}
"""Setback of tools over the radius: particles then touch a tool where some of half or a third of their size
would, and draw nearly what very small ones do (validation/limit.md#setback). With three quarters, one was
pressed right through a shank."""

WALLED = (
    "measured in a field with held sides; in a bin with walls drafts differ, the more the nearer the walls "
    "are, as the bed is looser beside them"
)
"""Note to the errors of a scene whose bin has walls."""

WEDGE = "real_time"
"""The preset that takes the wedge model of the material in the place of its particles."""

WEDGE_GRACE_JOULE = 300.0
"""Work before the bound of the exchange's residual applies, some 0.2 m of travel: where the tool of a
machine meets its first wedge, the residual is 4 % of the first 10 J; over 6 m it is 0.3 % of the work."""

WEDGE_ROW_NS = 10_000_000
"""Row of the series, as with 0.5 ms and the default of `record.series_ticks`."""

WEDGE_TRAVEL_M = 0.005
"""Furthest travel in a communication step of tools on paths, whose motion no force changes: the mean draft is
1 % higher than at 0.5 ms, its deviation some 7 % smaller (validation/wedge.md)."""

WEDGE_FASTEST_M_PER_S = 4.0
"""Speed where the law of a path does not tell its largest: the highest that wedge models were fitted to
(validation/wedge.md)."""

WEDGE_TICKS = (1, 2, 4, 5, 8, 10, 16, 20, 25, 32, 40, 50)
"""Communication steps of whole nanoseconds in such a row, of which the least that will do is taken."""

OF_MATERIALS = (*IN_DEPTH, WEDGE)
"""Names of the presets of a material."""


OF_THE_RESULT = ("preset", "soil.time_step_s", "coupling.communication_step_ns", "allow")
"""Overrides that are meant for the scene with its preset, and may not fit the one without it."""


def applies_to_particles(key: str, preset: str) -> bool:
    """Whether an override changes the scene that a preset is derived from: keys of the soil that are set
    beside the wedge preset are those of the wedge model."""
    if key in OF_THE_RESULT or key.endswith(".setback_m"):
        return False
    return preset != WEDGE or not key.startswith("soil.") or key == "soil.material"


def gives_size(override: Override) -> bool:
    """Whether an override gives the size of the particles, by whatever path."""
    keys = override.path.split(".")
    value: object = override.value
    for key in reversed(keys):
        value = {key: value}
    for key in ("soil", "particles"):
        value = value.get(key) if isinstance(value, dict) else None
    if not isinstance(value, dict):
        return False
    sizes = value.get("sizes")
    return "radius_m" in value or (isinstance(sizes, dict) and bool(sizes.keys() - {"seed"}))


def is_spent(key: str, preset: str) -> bool:
    """Whether the preset has applied an override: `soil.material` selects the file of the wedge preset."""
    return preset == WEDGE and key == "soil.material"


def measured_presets(material_file: str | None, scene: Scene) -> dict[str, Preset]:
    """Presets of a material, WEDGE where a wedge model comes with it, and what a study measured of them in
    a shipped one; their changes depend on the scene and are left out."""
    path = _beside(material_file, "presets", "")
    document = read_document(path, str(path)) if path is not None else {}
    names = OF_MATERIALS if _beside(material_file, "soils", "_wedge") is not None else tuple(IN_DEPTH)
    found = {name: read_preset(document.get(name, {}), f"{path}: {name}") for name in names}
    soil = scene.particle_soil
    if soil is not None and soil.bin.sides == "walls":
        for preset in found.values():
            if preset.expected is not None:
                preset.expected.notes.append(WALLED)
    return found


def preset_changes(
    name: str,
    scene: Scene,
    meshes: Mapping[str, ToolMesh],
    material: Material,
    material_file: str | None,
    *,
    sized: bool,
) -> Document:
    """The changes that a preset makes in a scene, which is given without preset.

    sized: an override gives the particles of the scene; the setback then follows from their size.

    Raises:
        SceneError: the preset needs a tool in the soil, or a wedge model that does not exist.
    """
    soil = scene.particle_soil
    assert soil is not None  # a material has particles
    if name == WEDGE:
        wedge = _beside(material_file, "soils", "_wedge")
        if wedge is None:
            raise SceneError(
                f"preset {name}: no wedge model comes with material {material_file}; choose one of "
                f"{', '.join(IN_DEPTH)}, or calibrate one (docs/calibrate.md) and give soil.model: wedge "
                "with its soil.file"
            )
        if soil.surface is not None and any(soil.surface.z_m):
            raise SceneError(
                f"preset {name}: the wedge model has its surface at z = 0, the scene has soil.surface; "
                f"remove it from the scene and raise the tools, or choose one of {', '.join(IN_DEPTH)}"
            )
        whole = {key: {"setback_m": 0.0} for key, tool in scene.tools.items() if tool.setback_m}
        changes: Document = {"soil": {"model": "wedge", "file": str(wedge)}} | (
            {"tools": whole} if whole else {}
        )
        if scene.mechanism is not None:
            row = {"series_ticks": WEDGE_ROW_NS // PREDICTED_INTERVAL_NS}
            return changes | {"coupling": {"residual_grace_joule": WEDGE_GRACE_JOULE}, "record": row}
        fastest = max((speed_and_depth(scene, key, meshes[key])[0] for key in _tillage(scene)), default=0.0)
        travel_m = 1e-9 * WEDGE_ROW_NS * (fastest or WEDGE_FASTEST_M_PER_S)
        ticks = next((n for n in WEDGE_TICKS if travel_m <= n * WEDGE_TRAVEL_M), WEDGE_TICKS[-1])
        step = {"communication_step_ns": WEDGE_ROW_NS // ticks}
        return changes | {"coupling": step, "record": {"series_ticks": ticks}}
    depth = max((_depth_m(scene, key, meshes[key]) for key in _tillage(scene)), default=0.0)
    if depth <= 0.0:
        raise SceneError(
            f"preset {name}: its particles follow from the depth of the tillage tools, and none is below the "
            "surface at the start; set soil.particles.radius_m instead"
        )
    width = min(_width_m(scene, key, meshes[key]) for key in _tillage(scene))
    low, high = material.radii_m
    radius = min(max(round(0.5 * min(depth / IN_DEPTH[name], width / LEAST_ACROSS), 4), low), high)
    particles: Document = {"soil": {"particles": {"radius_m": radius}}}
    setback_m = round(SET_BACK[name] * (0.5 * sum(soil.particles.bounds_m) if sized else radius), 5)
    tools = {
        tool: {"setback_m": setback_m}
        for tool in _tillage(scene)
        if "setback_m" not in scene.tools[tool].model_fields_set
    }
    return particles | {"tools": tools}


def _tillage(scene: Scene) -> list[str]:
    """Names of the tools that cut."""
    return [name for name, tool in scene.tools.items() if tool.is_tillage]


def _depth_m(scene: Scene, name: str, mesh: ToolMesh) -> float:
    """Depth of a tool's lowest vertex below the surface where it starts; for a path in space the place of
    the tool's origin counts, and for given poses the deepest of them."""
    tool, soil = scene.tools[name], scene.particle_soil
    depth = speed_and_depth(scene, name, mesh)[1]
    if soil is None or soil.surface is None:
        return depth
    path = tool.path
    x = path.start_m(0.0)[0] if path is not None and path.is_spatial else lowest_m(scene, name, mesh)[0]
    return depth + float(np.interp(x, soil.surface.x_m, soil.surface.z_m))


def _width_m(scene: Scene, name: str, mesh: ToolMesh) -> float:
    """Width of what a tool has in the soil where its depth is measured; of all of it, if that is above."""
    path, depth = scene.tools[name].path, _depth_m(scene, name, mesh)
    vertices = mesh.vertices_m if path is None else deepest_vertices_m(path, mesh.about_body())
    surface = float(vertices[:, 2].min()) + depth if depth > 0.0 else math.inf
    return float(np.ptp(part_below(vertices, mesh.facets, surface)[:, 1]))


def _beside(material_file: str | None, folder: str, suffix: str) -> Path | None:
    """The file of a shipped material in another folder of config/; None for other materials, and without."""
    if material_file is None or Path(material_file).resolve().parent != config_folder() / "materials":
        return None
    path = config_folder() / folder / f"{Path(material_file).stem}{suffix}.yaml"
    return path if path.is_file() else None
