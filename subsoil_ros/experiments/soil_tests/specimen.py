"""A specimen of a scene's soil, and the scenes that test it.

The bed is prepared between walls where the box will stand; then the walls of the bin are moved away and the
box takes their place, so that no particle is cut off and nothing but the box holds the soil.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats.qmc import Sobol

from ...dem.bed import Bed
from ...dem.beds.bed_file import write_bed
from ...dem.beds.in_reach import pairs_in_reach, radii_of
from ...dem.beds.report import masses_kg
from ...dem.engine import SoilEngine
from ...errors import InputError
from ...loading.loader import ResolvedScene, load_scene
from ...scene.beds import SavedBed, TiledBed
from ...scene.pairs import pair_values
from ...scene.soil import Soil
from ...yaml_document import Document, dump_yaml
from .shear_box import ShearBox, cemented_layers, gripping_law, write_meshes

Size = tuple[float, float, float]
"""Length, width and height [m]."""

TOUCH_M = 1e-6
"""Gap between the box and the outermost particles, so that the start removes none: above the round-off of the
float32 of an STL file."""

CORE_DIAMETERS = 1.5
"""Distance from the faces, in largest diameters, within which a wall orders or loosens particles. A larger
one needs larger specimens, a smaller one biases the density."""

POINTS_LOG2 = 18
"""Points of a Sobol sequence, as power of 2, that measure the cells of the core: the density is right to
0.1 % (against exact Voronoi cells of equal spheres, in the tests)."""

CELL_NEIGHBOURS = 16
"""Nearest centres among which the cell of a point is searched: the cell of a large sphere reaches past small
ones, but not past so many."""

DENSITY_TOLERANCE, LONGEST_SEARCH = 0.01, 3
"""Tolerance of the density of a tiled specimen's core, and most beds prepared to meet it: dry soil fills the
gaps that the walls of so small a box cut open, and its core is then looser than the tile."""

SAMPLES = 400
"""Rows of the series of one test; moving means are over SMOOTHED_ROWS (runs.py) of them."""


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
        """Mass of all particles."""
        return float(masses_kg(self.bed, self.soil).sum())

    @property
    def diameter_m(self) -> float:
        """Diameter of the largest particle, the unit of lengths of specimen and box."""
        return 2.0 * self.soil.particles.bounds_m[1]


def prepare_specimen(
    resolved: ResolvedScene, size_m: Size, folder: Path, threads: int = 1, like: Specimen | None = None
) -> Specimen:
    """The bed of a scene's soil in a bin of `size_m`, level; `folder` takes the scene that describes it.

    Of a tiled bed the box has the floor, the tile is as large as the specimen asks for, and its solid
    fraction is changed, within what beds may have, until the core has the density of the scene's bed. like: a
    larger specimen of this soil, whose core stands for that of one that is too low to have its own.

    Raises:
        InputError: no soil, a saved bed, or a size that leaves no core.
    """
    if resolved.scene.particle_soil is None:
        raise InputError(f"{resolved.path}: has no 'soil', so there is nothing to test")
    if isinstance(resolved.scene.particle_soil.bed, SavedBed):
        raise InputError(
            f"{resolved.path}: soil.bed.kind: a saved bed fits no specimen; let it be prepared: "
            "--set soil.bed='{kind: tiled}', or the same with dense_random or grid"
        )
    length, width, depth = size_m
    soil = {
        key: value for key, value in resolved.document["soil"].items() if key not in ("surface", "window")
    }
    soil["bin"] = {"length_m": length, "width_m": width, "depth_m": depth}
    document = {
        "name": "specimen",
        "duration_s": 1.0,
        "gravity_m_per_s2": resolved.scene.gravity_m_per_s2,
        "allow": list(resolved.scene.allow),
        "soil": soil,
    }
    path = folder / "specimen.yaml"

    def prepared() -> tuple[ResolvedScene, Bed]:
        path.write_text(dump_yaml(document), encoding="utf-8")
        alone = load_scene(path)
        return alone, SoilEngine(alone, threads).bed

    bed = resolved.scene.particle_soil.bed
    if isinstance(bed, TiledBed):
        soil["bed"] = bed.model_copy(update={"tile_m": None, "floor": "plane"}).model_dump(mode="json")
    if like is not None:
        soil["bed"] = like.resolved.document["soil"]["bed"]
        alone, found = prepared()
        return replace(like, resolved=alone, bed=found)
    if not isinstance(bed, TiledBed):
        return _with_core(*prepared())
    wanted = bed.solid_fraction * resolved.scene.particle_soil.particles.density_kg_per_m3
    tried: list[Specimen] = []
    for _ in range(LONGEST_SEARCH):
        tried.append(_with_core(*prepared()))
        missing = wanted / tried[-1].density_kg_per_m3
        if abs(missing - 1.0) <= DENSITY_TOLERANCE:
            break
        soil["bed"]["solid_fraction"] = min(max(missing * soil["bed"]["solid_fraction"], 0.55), 0.64)
    return min(tried, key=lambda one: abs(one.density_kg_per_m3 - wanted))


def _with_core(alone: ResolvedScene, bed: Bed) -> Specimen:
    assert alone.scene.particle_soil is not None
    density, coordination = _core(bed, alone.scene.particle_soil)
    pair, _ = pair_values(alone.scene.particle_soil)
    particles = alone.scene.particle_soil.particles
    rest = 1.0 - 0.5 * pair.rest_overlap / particles.mean_volume_radius_m
    fraction = density / particles.density_kg_per_m3 * rest**3
    return Specimen(alone, bed, density, fraction, coordination)


def _core(bed: Bed, soil: Soil) -> tuple[float, float]:
    """Density [kg/m3] and coordination of the particles away from the faces.

    Their mass over the volume of their cells in the power diagram: a point belongs to the sphere with the
    least distance^2 - radius^2, so spheres are parted where they touch; with equal ones it is Voronoi's.
    Source: F. Aurenhammer, SIAM J. Comput. 16 (1987) 78-96.
    """
    x, radii, diameter = bed.positions_m, radii_of(bed, soil), 2.0 * soil.particles.bounds_m[1]
    away = CORE_DIAMETERS * diameter
    core = ((x > x.min(axis=0) + away) & (x < x.max(axis=0) - away)).all(axis=1)
    if not core.any():
        raise InputError(
            f"size: {np.ptp(x, axis=0) + diameter} m leaves no particle {CORE_DIAMETERS:g} diameters of "
            f"{diameter:g} m away from the walls; take at least 5 diameters along every axis"
        )
    lower, upper = x[core].min(axis=0) - away, x[core].max(axis=0) + away  # no cell reaches farther
    points = lower + (upper - lower) * Sobol(3, scramble=False).random_base2(POINTS_LOG2)
    distance, near = cKDTree(x).query(points, k=min(CELL_NEIGHBOURS, len(x)))
    nearest = np.argmin(distance**2 - radii[near] ** 2, axis=1)
    cells = core[near[np.arange(len(points)), nearest]].mean() * np.prod(upper - lower)
    bonds = np.bincount(pairs_in_reach(bed, soil).pair.ravel(), minlength=len(x))
    return float(masses_kg(bed, soil)[core].sum() / cells), float(bonds[core].mean())


def box_around(specimen: Specimen, room_m: float, gap_m: float | None) -> tuple[ShearBox, Bed]:
    """The box, and the bed in a bin whose walls stand `room_m` beyond the outside of the box.

    gap_m: between the frames; None: over a plate. The upper frame then reaches half a diameter through the
    plate, without contact to it, so that no particle slips out below it.
    """
    rest = pair_values(specimen.soil)[1].rest_overlap - TOUCH_M
    wall, radii = room_m, radii_of(specimen.bed, specimen.soil)[:, None]
    shift = room_m + wall - rest - float((specimen.bed.positions_m - radii)[:, 0].min())
    x = specimen.bed.positions_m + np.array([shift, 0.0, 0.0])
    low, high = ((x - radii).min(axis=0) + rest).tolist(), ((x + radii).max(axis=0) - rest).tolist()
    gap = low[2] - high[2] - specimen.diameter_m if gap_m is None else gap_m
    box = ShearBox((low[0], low[1], low[2]), (high[0], high[1], high[2]), wall, gap)
    beyond = room_m + wall
    bed = replace(
        specimen.bed,
        positions_m=x,
        lower_m=(0.0, low[1] - beyond, low[2] - beyond),
        upper_m=(high[0] + beyond, high[1] + beyond),
    )
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
    cap_m: float = 0.0,
) -> ResolvedScene:
    """Write a test as a scene with its meshes and bed into `folder`, and load it.

    machine: keys `mechanism`, `tools`, and more of a scene. glued: the box grips the soil. cap_m: this much
    of the soil at the lid and at the floor is cemented, layers of GLUE times the adhesion.
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
    if cap_m > 0.0:
        soil["layers"] = cemented_layers(specimen.soil, bed.lower_m[2], cap_m)
        z = bed.positions_m[:, 2]
        bed = replace(bed, materials=(z < z.max() - cap_m).astype(np.int64) + (z < z.min() + cap_m))
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
