"""How a passage of the tools left the soil: what moved, how far the surface rose, where it was fast.

Particles keep their place in every cloud, so displacements are differences of two clouds: the first of the
bag and the last. They are evaluated in a slab across the bin that all tools have passed: from the metrics
margin behind the place where they enter the soil to the rearmost of them, or to the margin before the end. A
particle has moved if it is displaced by more than a radius. The loosened cross-section is the moved part of
the slab times its section; the width at the surface is that of the columns of the uppermost layer of which
half or more moved.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..loading.loader import ResolvedScene
from ..messages import SoilCloud, ToolMotions
from ..recording.joined import open_record
from ..recording.soil_clouds import CELL_DIAMETERS, HeightGrid, height_grid
from ..scene.bed_kinds import GridBed, SurfaceProfile
from ..scene.pair_laws import particle_spacing_m
from ..scene.soil import Soil, SoilWindow
from ..scene.tool_mesh import load_tool_mesh, posed_vertices_m, reference_angle
from .columns import TIME
from .metrics_window import Window, named_tool, tip_path_m, tip_paths_m, window_span_s
from .series import Series, write_table_csv
from .stationarity import stationarity

Values = NDArray[np.float64]

LEAST_SLAB_DIAMETERS = 5.0
"""Least length of the slab: five particles along the way; a shorter slab averages over too few."""

ZONE_M = 0.1
"""Length of a zone ahead of or beside the tip in which speeds are averaged: five particles of the paper."""

ZONES = 4

TIP_REACH_M = 0.08
"""Distance from the tip up to which soil belongs to the zone of the tip: a share width and a particle."""

LEAST_IN_ZONE = 5

SLICE_DIAMETERS = 2.0
"""Length of a slice of the slab: each holds hundreds of particles."""

SEEN_PART = 0.5
"""Part of a window that tools may travel between two clouds: soil is then recorded before it is within half
the rupture distance of them, and again before it leaves."""

SPEED_CLOUDS = 5
"""Most clouds of the window whose speeds are averaged, spread evenly; more cost time to read."""


@dataclass(frozen=True)
class SpeedZones:
    """Mean speeds of the soil [m/s] about the tip, over clouds of the window; NaN where no particle was."""

    tip: float
    blade: float  # over the tip, about the edge of the blade
    ahead: tuple[float, ...]  # k-th: k to k + 1 times ZONE_M ahead of the tip
    aside: tuple[float, ...]  # beside the tip, both sides


@dataclass(frozen=True)
class Disturbance:
    """Disturbance of a slab of the bed by one passage. Lengths [m]."""

    slab_m: tuple[float, float]  # along x
    particle_count: int  # in the slab at first
    moved_fraction: float  # of them, displaced by more than a radius
    bed_section_m2: float  # of the slab, across
    area_m2: float  # loosened cross-section
    surface_width_m: float
    slice_m2: Values  # (slices,) loosened cross-section of slices of the slab, evenly from its start on
    lift: HeightGrid  # change of the surface's height over the slab, NaN where no soil is
    moved_map: Values  # (cells in z from below, cells in y): moved part of each, NaN where empty
    cell_m: float
    origin_m: tuple[float, float]  # y and z of the corner of moved_map
    speeds: SpeedZones | None

    @property
    def slices_m(self) -> Values:
        """(slices,) x of the middle of each slice."""
        start, end = self.slab_m
        return start + (np.arange(len(self.slice_m2)) + 0.5) * (end - start) / len(self.slice_m2)

    @property
    def max_lift_m(self) -> float:
        """Largest rise of the surface in one cell."""
        return float(np.nanmax(self.lift.height_m))

    @property
    def lifted_area_m2(self) -> float:
        """Mean cross-section of soil above the first surface."""
        lift = self.lift.height_m
        risen = np.where(np.isfinite(lift) & (lift > 0.0), lift, 0.0)
        return float(risen.sum(axis=0).mean() * self.lift.cell_m)

    def metrics(self) -> dict[str, float]:
        """Return the metrics for summary.json, units in the names."""
        found = {
            "slab_start_m": self.slab_m[0],
            "slab_end_m": self.slab_m[1],
            "moved_fraction": self.moved_fraction,
            "area_m2": self.area_m2,
            "surface_width_m": self.surface_width_m,
            "lift_max_m": self.max_lift_m,
            "lifted_area_m2": self.lifted_area_m2,
        }
        along = stationarity(self.slices_m, self.slice_m2)
        if along is not None:
            found["area_half_width_m2"] = along.mean_half_width
        if self.speeds is not None:
            found["tip_speed_m_per_s"] = self.speeds.tip
            found["blade_speed_m_per_s"] = self.speeds.blade
            for k in range(ZONES):
                found[f"ahead_{k}_speed_m_per_s"] = self.speeds.ahead[k]
                found[f"aside_{k}_speed_m_per_s"] = self.speeds.aside[k]
        return found


def read_disturbance(
    bag: Path, resolved: ResolvedScene, series: Series, window: Window
) -> Disturbance | None:
    """Disturbance from the clouds of a bag. None without particles, with fewer than two clouds, with a cloud
    region, or where the tools have passed too short a slab.

    With a soil window, each particle is compared between the first and the last cloud that contain it; None
    where clouds are too rare to contain the soil before the tools move it.

    Raises:
        InputError, RecordingError: as open_record.
    """
    soil = resolved.scene.particle_soil
    if soil is None or resolved.scene.record.cloud_region is not None:
        return None
    reader = open_record(bag)
    times = reader.cloud_times_ns()
    if len(times) < 2 or (
        soil.window is not None and not _seen_in_time(times, series, resolved, soil.window)
    ):
        return None
    start_s, end_s = window_span_s(series, window)
    inside = [time for time in times if start_s <= 1e-9 * time <= end_s]
    looked = (
        {inside[k] for k in np.linspace(0, len(inside) - 1, SPEED_CLOUDS).round().astype(int)}
        if inside
        else set()
    )
    wanted = {times[0], times[-1]} | looked
    clouds, places = {}, Places()
    for cloud in reader.clouds(
        resolved.timing.communication_step_ns,
        at=lambda time_ns: time_ns in wanted or soil.window is not None,
    ):
        if soil.window is not None or cloud.end_time_ns in (times[0], times[-1]):
            places.see(cloud)
        if cloud.end_time_ns in wanted:
            clouds[cloud.end_time_ns] = cloud
    seen = {time for time in (*np.rint(1e9 * series[TIME]).astype(int), times[-1]) if time <= times[-1]}
    slab = passed_slab_m(series, resolved, reader.records(ToolMotions, at=seen.__contains__), times[-1])
    radius = soil.particles.mean_volume_radius_m
    if slab[1] - slab[0] < LEAST_SLAB_DIAMETERS * 2.0 * radius:
        return None
    first, last = places.first_m, places.last_m
    speeds = _speed_zones([clouds[time] for time in sorted(looked)], series, resolved)
    return disturbance_between(first, last, slab, radius, speeds, _period_m(soil, first), soil.surface)


def _seen_in_time(times_ns: list[int], series: Series, resolved: ResolvedScene, window: SoilWindow) -> bool:
    """Whether the tip travels less between two clouds than half of the window ahead or behind."""
    path = tip_path_m(series, resolved.scene)
    if path is None:
        return False
    tip = np.interp(1e-9 * np.array(times_ns), series[TIME], path[0])
    return bool(np.diff(tip).max() < SEEN_PART * min(window.ahead_m, window.behind_m))


class Places:
    """First and last positions of the particles of several clouds, in one order."""

    def __init__(self) -> None:
        self.first_m, self.last_m = np.empty((0, 3)), np.empty((0, 3))
        self._row_of = np.empty(0, np.int64)  # of an identity

    def see(self, cloud: SoilCloud) -> None:
        """Add a cloud; clouds come in order of time."""
        places = np.asarray(cloud.positions_m, np.float64)
        if cloud.identities is None:
            identity = np.arange(len(places))
        else:
            identity = np.asarray(cloud.identities, np.int64)
        missing = int(identity.max(initial=-1)) + 1 - len(self._row_of)
        if missing > 0:
            self._row_of = np.append(self._row_of, np.full(max(missing, len(self._row_of)), -1))
        new = self._row_of[identity] < 0
        if new.any():
            self._row_of[identity[new]] = len(self.first_m) + np.arange(new.sum())
            self.first_m = np.concatenate((self.first_m, places[new]))
            self.last_m = np.concatenate((self.last_m, places[new]))
        self.last_m[self._row_of[identity]] = places


def disturbance_between(
    first_m: Values,
    last_m: Values,
    slab_m: tuple[float, float],
    radius_m: float,
    speeds: SpeedZones | None = None,
    period_m: float | None = None,
    surface: SurfaceProfile | None = None,
) -> Disturbance | None:
    """Disturbance from particles (n, 3) [m] before and after, in the same order; None for an empty slab.

    period_m: in y, of a bed without side walls: particles that leave on one side enter on the other.
    surface: that the bed was trimmed to; None: a level bed.
    """
    within = (first_m[:, 0] >= slab_m[0]) & (first_m[:, 0] < slab_m[1])
    if not within.any():
        return None
    before, after = first_m[within], last_m[within]
    way = after - before
    if period_m is not None:
        way[:, 1] -= period_m * np.round(way[:, 1] / period_m)
    moved = np.linalg.norm(way, axis=1) > radius_m
    cell = CELL_DIAMETERS * 2.0 * radius_m
    low, high = before.min(axis=0) - radius_m, before.max(axis=0) + radius_m
    if period_m is not None:  # the bed has no sides that its outermost particles touch
        low[1], high[1] = 0.5 * (low[1] + high[1]) + np.array((-0.5, 0.5)) * period_m
    shape = np.maximum(1, np.round((high[1:] - low[1:]) / cell).astype(int))
    step = (high[1:] - low[1:]) / shape  # whole cells across
    place = np.minimum(((before[:, 1:] - low[1:]) / step).astype(int), shape - 1)
    count = np.zeros(shape[::-1])
    hits = np.zeros(shape[::-1])
    np.add.at(count, (place[:, 1], place[:, 0]), 1.0)
    np.add.at(hits, (place[:, 1], place[:, 0]), moved)
    part = np.divide(hits, count, out=np.full(count.shape, np.nan), where=count > 0.0)
    moved_fraction = float(moved.mean())
    slices = max(1, int((slab_m[1] - slab_m[0]) / (SLICE_DIAMETERS * 2.0 * radius_m)))
    middles = slab_m[0] + (np.arange(slices) + 0.5) * (slab_m[1] - slab_m[0]) / slices
    levelled = before[:, 2] - _surface_m(surface, before[:, 0])
    rise, crest = _surface_m(surface, middles), levelled.max() + radius_m
    sections = (high[1] - low[1]) * (crest + rise - low[2])  # of the bed, in each slice
    section = float((high[1] - low[1]) * (crest + rise.mean() - low[2]))
    place_x = ((before[:, 0] - slab_m[0]) / (slab_m[1] - slab_m[0]) * slices).astype(int)
    of_slice = np.bincount(np.minimum(place_x, slices - 1), minlength=slices)
    moved_of = np.bincount(np.minimum(place_x, slices - 1), weights=moved, minlength=slices)
    # whole cells about the middle: one that hangs over a wall would compare single particles
    half = 0.5 * cell * max(1, int((high[1] - low[1]) / cell + 1e-9))
    middle = 0.5 * float(low[1] + high[1])
    box = ((slab_m[0], middle - half), (slab_m[1], middle + half))
    there_after = (last_m[:, 0] >= slab_m[0]) & (last_m[:, 0] < slab_m[1])
    surface_before = height_grid(first_m, radius_m, box)
    surface_after = height_grid(last_m[there_after], radius_m, box)
    lift = HeightGrid(
        surface_before.origin_m, surface_before.cell_m, surface_after.height_m - surface_before.height_m
    )
    return Disturbance(
        slab_m=slab_m,
        particle_count=int(within.sum()),
        moved_fraction=moved_fraction,
        bed_section_m2=section,
        area_m2=moved_fraction * section,
        slice_m2=sections * moved_of / np.where(of_slice > 0.0, of_slice, 1.0),
        surface_width_m=_surface_width_m(before[:, 1], levelled, moved, (low[1], high[1]), cell, radius_m),
        lift=lift,
        moved_map=part,
        cell_m=float(step[0]),
        origin_m=(float(low[1]), float(low[2])),
        speeds=speeds,
    )


def _surface_width_m(
    y: Values,
    levelled: Values,
    moved: NDArray[np.bool_],
    sides: tuple[float, float],
    cell: float,
    radius: float,
) -> float:
    """Width of the columns in y of which half or more of the uppermost layer moved; levelled: heights (n,)
    over the surface."""
    low, high = sides
    top = levelled > levelled.max() - 1.5 * radius
    columns = max(1, round((high - low) / cell))
    place = np.minimum(((y[top] - low) / (high - low) * columns).astype(int), columns - 1)
    count = np.bincount(place, minlength=columns)
    hits = np.bincount(place, weights=moved[top], minlength=columns)
    return float(((hits >= 0.5 * count) & (count > 0)).sum() * (high - low) / columns)


def write_section_csv(found: Disturbance, path: Path) -> None:
    """Write one row for each slice of the slab: its x and its loosened cross-section."""
    write_table_csv({"x_m": found.slices_m, "area_m2": found.slice_m2}, path, ".6g")


def write_height_map_csv(lift: HeightGrid, path: Path) -> None:
    """Write one row for each cell: its centre and the rise of its surface; empty where there is no soil."""
    x, y = np.meshgrid(*lift.centres_m())
    columns = {"x_m": x.ravel(), "y_m": y.ravel(), "lift_m": lift.height_m.ravel()}
    write_table_csv(columns, path, ".6g")


def _period_m(soil: Soil, first_m: Values) -> float | None:
    """Width of a bed without side walls, from its particles; the width of the bin only approximates it."""
    if soil.bin.sides != "periodic":
        return None
    gap = particle_spacing_m(soil) if isinstance(soil.bed, GridBed) else 0.0  # a random bed fills its width
    return float(np.ptp(first_m[:, 1])) + gap


def _surface_m(surface: SurfaceProfile | None, x_m: Values) -> Values:
    """Height of the bed's surface at places along it."""
    return np.zeros_like(x_m) if surface is None else np.interp(x_m, surface.x_m, surface.z_m)


def passed_slab_m(
    series: Series, resolved: ResolvedScene, motions: Iterable[ToolMotions], until_ns: int
) -> tuple[float, float]:
    """The part of the bin along x [m] that all tillage tools have passed in the soil up to a time; its end is
    before its start where there is none.

    It starts the metrics margin behind the place where the tip of the last of them entered the soil. It ends
    at the largest x that the rear of each of them reached in the soil, or the margin before the end of the
    bin.
    """
    scene = resolved.scene
    soil = scene.particle_soil
    assert soil is not None
    tools = [name for name, tool in scene.tools.items() if tool.is_tillage]
    starts = [np.inf] * (not tools)
    for x, z in tip_paths_m(series, resolved).values():
        within = (z < _surface_m(soil.surface, x)) & (1e9 * series[TIME] < until_ns + 0.5)
        starts.append(max(0.0, float(x[np.argmax(within)])) if within.any() else np.inf)
    meshes = {name: load_tool_mesh(resolved.directory, scene, name) for name in tools}
    ends = dict.fromkeys(tools, -np.inf)
    for record in motions:
        for motion in record.tools:
            if motion.tool in meshes:
                vertices = posed_vertices_m(meshes[motion.tool], motion, reference_angle(scene, motion.tool))
                under = vertices[vertices[:, 2] < _surface_m(soil.surface, vertices[:, 0]), 0]
                if len(under):
                    ends[motion.tool] = max(ends[motion.tool], float(under.min()))
    margin = scene.report.window_inside_m
    return max(starts) + margin, min([*ends.values(), soil.bin.length_m - margin])


def _speed_zones(clouds: list[SoilCloud], series: Series, resolved: ResolvedScene) -> SpeedZones | None:
    path = tip_path_m(series, resolved.scene)
    if path is None or not clouds:
        return None
    named = named_tool(resolved.scene)
    lateral = resolved.scene.tools[named].lateral_m if named is not None else 0.0
    sums = []
    for cloud in clouds:
        tip_x, tip_z = (np.interp(1e-9 * cloud.end_time_ns, series[TIME], places) for places in path)
        sums.append(_zones_of(cloud, float(tip_x), float(tip_z), lateral))
    total = np.sum(sums, axis=0)  # (zones, 2): sum of speeds, particles
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(total[:, 1] >= LEAST_IN_ZONE, total[:, 0] / total[:, 1], np.nan).tolist()
    return SpeedZones(mean[0], mean[1], tuple(mean[2 : 2 + ZONES]), tuple(mean[2 + ZONES :]))


def _zones_of(cloud: SoilCloud, tip_x: float, tip_z: float, lateral: float) -> Values:
    """Sum of speeds and number of particles (2 + 2 ZONES, 2): tip, blade, ahead, aside."""
    x, y, z = (np.asarray(cloud.positions_m, np.float64) - (tip_x, lateral, tip_z)).T
    speed = np.asarray(cloud.speeds_m_per_s, np.float64)
    near, beside = np.abs(x) < ZONE_M, np.abs(y)
    zones = [
        x**2 + y**2 + z**2 < TIP_REACH_M**2,
        near & (beside < TIP_REACH_M) & (z >= TIP_REACH_M) & (z < -tip_z),
        *((x >= k * ZONE_M) & (x < (k + 1) * ZONE_M) & (beside < ZONE_M) for k in range(ZONES)),
        *(near & (beside >= k * ZONE_M) & (beside < (k + 1) * ZONE_M) for k in range(ZONES)),
    ]
    return np.array([(speed[zone].sum(), zone.sum()) for zone in zones], np.float64)
