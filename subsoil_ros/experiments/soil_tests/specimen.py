"""A specimen of a scene's soil, and the scenes that test it.

The bed is prepared between walls where the box will stand; then the walls of the bin are moved away and the
box takes their place, so that no particle is cut off and nothing but the box holds the soil.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, Voronoi, cKDTree

from ...dem.bed import Bed
from ...dem.beds.bed_file import write_bed
from ...dem.engine import SoilEngine
from ...errors import InputError
from ...loading.loader import ResolvedScene, load_scene
from ...scene.beds import SavedBed
from ...scene.pairs import pair_values, particle_mass_kg
from ...scene.soil import Soil
from ...yaml_document import Document, dump_yaml
from .shear_box import ShearBox, gripping_law, write_meshes

Size = tuple[float, float, float]
"""Length, width and height [m]."""

TOUCH_M = 1e-6
"""The box stands off the outermost particles by this, so that the start removes none (over the round-off of
the float32 of an STL file)."""

CORE_DIAMETERS = 1.5
"""Distance from the faces within which a wall orders or loosens the particles (chosen)."""

SAMPLES = 400
"""Rows of the series of one test (chosen)."""


@dataclass(frozen=True)
class Specimen:
    """Prepared soil, ready to be put into a box."""

    resolved: ResolvedScene  # the soil alone in a bin of the specimen's size
    bed: Bed
    density_kg_per_m3: float  # of the core, away from the faces
    solid_fraction: float  # of spheres of the rest distance, likewise
    coordination: float  # particles in reach of one of the core

    @property
    def soil(self) -> Soil:
        """The soil of the specimen."""
        assert self.resolved.scene.particle_soil is not None
        return self.resolved.scene.particle_soil

    @property
    def mass_kg(self) -> float:
        """Of all particles."""
        return len(self.bed.positions_m) * particle_mass_kg(self.soil)


def prepare_specimen(resolved: ResolvedScene, size_m: Size, folder: Path, threads: int = 1) -> Specimen:
    """The bed of a scene's soil in a bin of `size_m`, level; `folder` takes the scene that describes it.

    Raises:
        InputError: no soil, a saved bed, or a size that leaves no core.
    """
    if resolved.scene.particle_soil is None:
        raise InputError(f"{resolved.path}: has no 'soil', so there is nothing to test")
    if isinstance(resolved.scene.particle_soil.bed, SavedBed):
        raise InputError(
            f"{resolved.path}: soil.bed.kind: a saved bed fits no specimen; let it be prepared: "
            "--set soil.bed='{kind: dense_random}', or the same with grid"
        )
    length, width, depth = size_m
    soil = {key: value for key, value in resolved.document["soil"].items() if key != "surface"}
    document = {
        "name": "specimen",
        "duration_s": 1.0,
        "gravity_m_per_s2": resolved.scene.gravity_m_per_s2,
        "allow": list(resolved.scene.allow),
        "soil": soil | {"bin": {"length_m": length, "width_m": width, "depth_m": depth}},
    }
    path = folder / "specimen.yaml"
    path.write_text(dump_yaml(document), encoding="utf-8")
    alone = load_scene(path)
    bed = SoilEngine(alone, threads).bed
    assert alone.scene.particle_soil is not None
    density, coordination = _core(bed, alone.scene.particle_soil)
    pair, _ = pair_values(alone.scene.particle_soil)
    particles = alone.scene.particle_soil.particles
    rest = 1.0 - 0.5 * pair.rest_overlap / particles.mean_volume_radius_m
    fraction = density / particles.density_kg_per_m3 * rest**3
    return Specimen(alone, bed, density, fraction, coordination)


def _core(bed: Bed, soil: Soil) -> tuple[float, float]:
    """Density [kg/m3] and coordination of the particles away from the faces, by their Voronoi cells."""
    x, diameter = bed.positions_m, 2.0 * soil.particles.mean_volume_radius_m
    away = CORE_DIAMETERS * diameter
    core = np.flatnonzero(((x > x.min(axis=0) + away) & (x < x.max(axis=0) - away)).all(axis=1))
    if len(core) == 0:
        raise InputError(
            f"size: {np.ptp(x, axis=0) + diameter} m leaves no particle {CORE_DIAMETERS:g} diameters of "
            f"{diameter:g} m away from the walls; take at least 5 diameters along every axis"
        )
    cells = Voronoi(x)
    volumes = [ConvexHull(cells.vertices[cells.regions[cells.point_region[k]]]).volume for k in core]
    neighbours = cKDTree(x).query_ball_point(x[core], diameter + pair_values(soil)[0].reach)
    mean_neighbours = float(np.mean([len(found) - 1 for found in neighbours]))
    return particle_mass_kg(soil) / float(np.mean(volumes)), mean_neighbours


def box_around(specimen: Specimen, room_m: float, gap_m: float) -> tuple[ShearBox, Bed]:
    """The box, and the bed in a bin whose walls stand `room_m` beyond the outside of the box."""
    boundary = pair_values(specimen.soil)[1]
    off = specimen.soil.particles.mean_volume_radius_m - boundary.rest_overlap + TOUCH_M
    wall = room_m
    shift = room_m + wall + off - float(specimen.bed.positions_m[:, 0].min())
    x = specimen.bed.positions_m + np.array([shift, 0.0, 0.0])
    low, high = (x.min(axis=0) - off).tolist(), (x.max(axis=0) + off).tolist()
    box = ShearBox((low[0], low[1], low[2]), (high[0], high[1], high[2]), wall, gap_m)
    beyond = room_m + wall
    bed = Bed(x, (0.0, low[1] - beyond, low[2] - beyond), (high[0] + beyond, high[1] + beyond))
    return box, bed


def write_scene(
    specimen: Specimen,
    name: str,
    folder: Path,
    box: ShearBox,
    bed: Bed,
    duration_s: float,
    machine: Document,
    *,
    glued: bool = True,
) -> ResolvedScene:
    """Writes a test as a scene with its meshes and bed into `folder`, and loads it.

    machine: keys `mechanism`, `tools`, and more of a scene. glued: the box grips the soil.
    """
    write_meshes(box, folder)
    soil = specimen.resolved.document["soil"] | {
        "bin": {
            "length_m": bed.upper_m[0],
            "width_m": bed.upper_m[1] - bed.lower_m[1],
            "depth_m": -bed.lower_m[2],
        },
        "bed": {"kind": "saved", "file": "bed.npz"},
        "law": gripping_law(specimen.soil) if glued else specimen.soil.law.model_dump(mode="json"),
    }
    write_bed(folder / "bed.npz", bed, Soil.model_validate_json(json.dumps(soil), strict=True))
    document: Document = {
        "name": name,
        "duration_s": duration_s,
        "gravity_m_per_s2": specimen.resolved.scene.gravity_m_per_s2,
        "allow": list(specimen.resolved.scene.allow),
        "soil": soil,
        **machine,
        "record": {"cloud_hz": 0.0},
    }
    path = folder / "scene.yaml"
    path.write_text(dump_yaml(document), encoding="utf-8")
    ticks = load_scene(path).timing.tick_count
    document["record"]["series_ticks"] = max(1, ticks // SAMPLES)
    path.write_text(dump_yaml(document), encoding="utf-8")
    return load_scene(path)
