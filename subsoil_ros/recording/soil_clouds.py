"""Clouds of the soil: the part that is recorded, as point clouds and back, and the height map of each."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..messages import SoilCloud
from ..scene.record import SPEED_BITS, Record, position_step_m
from ..scene.soil import Soil
from ..scene.terrain_soil import TerrainSoil
from .standard_messages import header, time_ns_of
from .types import Message, message_class

POINT_FIELDS = ("x", "y", "z", "speed")
_MORE = {
    "identity": "identities",
    "broken_part": "broken_parts",
    "radius": "radii_m",
    "material": "materials",
}
"""Optional fields of a point cloud, and the corresponding ones of SoilCloud."""

_WHOLE = ("identity", "material")
"""The fields that are uint32."""

Values = dict[str, Any]
"""Arrays of a cloud by name, one number of each particle; None: the cloud has none."""

Positions = NDArray[np.floating]
"""World positions (n, 3) [m]."""

_FLOAT32, _UINT32 = 7, 6  # sensor_msgs/PointField


def point_cloud(cloud: SoilCloud) -> Message:
    """sensor_msgs/PointCloud2 of the particles: x, y, z [m] and speed [m/s], float32, little-endian. With a
    window also their identity, uint32; with bonds, the part of the bonds that broke; with several sizes,
    their radius [m]; with layers, their material, uint32."""
    positions = np.asarray(cloud.positions_m)
    more: Values = {name: getattr(cloud, key) for name, key in _MORE.items()}
    names = (*POINT_FIELDS, *(name for name, values in more.items() if values is not None))
    points = np.empty((len(positions), len(names)), dtype="<f4")
    points[:, :3] = positions
    points[:, 3] = cloud.speeds_m_per_s
    for k, name in enumerate(names[4:], 4):
        points.view("<u4" if name in _WHOLE else "<f4")[:, k] = more[name]
    return points_message(cloud.end_time_ns, points[None], names, is_dense=True)


def points_message(
    time_ns: int, points: NDArray[np.float32], names: Sequence[str], *, is_dense: bool
) -> Message:
    """sensor_msgs/PointCloud2 of points (rows, columns, fields) with named fields, little-endian: float32,
    and uint32 of _WHOLE.

    is_dense: no value is NaN.
    """
    rows, columns, _ = points.shape
    return message_class("sensor_msgs/msg/PointCloud2")(
        header=header(time_ns),
        height=rows,
        width=columns,
        fields=[
            message_class("sensor_msgs/msg/PointField")(
                name=name, offset=4 * i, datatype=_UINT32 if name in _WHOLE else _FLOAT32, count=1
            )
            for i, name in enumerate(names)
        ],
        is_bigendian=False,
        point_step=4 * len(names),
        row_step=4 * len(names) * columns,
        data=points.reshape(-1).view(np.uint8),
        is_dense=is_dense,
    )


def cloud_from_message(message: Message, communication_step_ns: int) -> SoilCloud:
    """The SoilCloud of a PointCloud2 made by `point_cloud`."""
    words = message.point_step // 4
    points = np.frombuffer(memoryview(message.data), dtype="<f4").reshape(-1, words)
    places = {field.name: field.offset // 4 for field in message.fields}
    more = {
        key: points.view("<u4" if name in _WHOLE else "<f4")[:, places[name]]
        for name, key in _MORE.items()
        if name in places
    }
    time_ns = time_ns_of(message.header.stamp)
    tick = time_ns // communication_step_ns - 1
    return SoilCloud(tick, time_ns, points[:, :3], points[:, 3], **more)


_SIGNIFICANT_BITS = 24  # of a float32


def recorded_cloud(cloud: SoilCloud, record: Record) -> SoilCloud:
    """The part of `cloud` that the scene records; `cloud` itself without region and resolution."""
    if record.cloud_region is None and record.cloud_resolution_m == 0.0:
        return cloud
    positions = np.asarray(cloud.positions_m, dtype=np.float32)
    speeds = np.asarray(cloud.speeds_m_per_s, dtype=np.float32)
    more: Values = {name: getattr(cloud, name) for name in _MORE.values()}
    if record.cloud_region is not None:
        inside = np.ones(len(positions), dtype=bool)
        for axis, span in enumerate(record.cloud_region.spans_m):
            if span is not None:
                inside &= (positions[:, axis] >= span[0]) & (positions[:, axis] <= span[1])
        positions, speeds = positions[inside], speeds[inside]
        more = {name: None if values is None else values[inside] for name, values in more.items()}
    if record.cloud_resolution_m > 0.0:
        positions = _rounded(positions, position_step_m(record.cloud_resolution_m))
        speeds = _shortened(speeds, SPEED_BITS)
    return SoilCloud(cloud.tick, cloud.end_time_ns, positions, speeds, **more)


def _rounded(values: NDArray[np.float32], step: float) -> NDArray[np.float32]:
    """The nearest multiples of a power of two, by exact operations: the same bits on every machine."""
    scale = np.float32(step)
    return np.rint(values / scale) * scale


def _shortened(values: NDArray[np.float32], bits: int) -> NDArray[np.float32]:
    """The nearest float32 with `bits` significant bits; `values` must not be negative."""
    dropped = _SIGNIFICANT_BITS - bits
    words: NDArray[np.uint32] = values.view(np.uint32) + np.uint32(
        1 << (dropped - 1)
    )  # carries into the exponent
    return (words & np.uint32(0xFFFFFFFF ^ ((1 << dropped) - 1))).view(np.float32)


CELL_DIAMETERS = 1.0
"""Size of a cell in particle diameters: every column of a settled bed then has particles. Smaller
cells may be empty, larger ones smooth the surface."""

FIELDS = ("x", "y", "z", "lift")


@dataclass(frozen=True)
class HeightGrid:
    """Top of the soil, column by column."""

    origin_m: tuple[float, float]  # x, y of the grid's corner
    cell_m: float
    height_m: NDArray[np.float64]  # (rows in y, columns in x), NaN where no particle is

    def centres_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x of the columns and y of the rows."""
        rows, columns = self.height_m.shape
        x, y = self.origin_m
        half = 0.5 * self.cell_m
        across = y + half + self.cell_m * np.arange(rows, dtype=np.float64)
        return x + half + self.cell_m * np.arange(columns, dtype=np.float64), across


def height_grid(
    positions_m: Positions,
    radius_m: float,
    box_m: tuple[tuple[float, float], tuple[float, float]],
    radii_m: Positions | None = None,
) -> HeightGrid:
    """Highest top of a particle in every cell of a box ((x, y) of its corners); positions (n, 3), radii (n,),
    None where all are radius_m, of which cells have the size [m]."""
    cell = CELL_DIAMETERS * 2.0 * radius_m
    (x_low, y_low), (x_high, y_high) = box_m
    columns = max(1, round((x_high - x_low) / cell))
    rows = max(1, round((y_high - y_low) / cell))
    column = np.floor((positions_m[:, 0] - x_low) / cell).astype(np.int64)
    row = np.floor((positions_m[:, 1] - y_low) / cell).astype(np.int64)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    height = np.full((rows, columns), -np.inf)
    top = positions_m[:, 2] + (radius_m if radii_m is None else radii_m)
    np.maximum.at(height, (row[inside], column[inside]), top[inside])
    return HeightGrid((x_low, y_low), cell, np.where(np.isfinite(height), height, np.nan))


def soil_span_m(positions_m: Positions, soil: Soil) -> tuple[float, float]:
    """Extent of the soil along x [m]: the bin or, with a window, whole cells around the particles (n, 3)."""
    if soil.window is None or len(positions_m) == 0:
        return 0.0, soil.bin.length_m
    cell = CELL_DIAMETERS * 2.0 * soil.particles.mean_volume_radius_m
    low, high = float(positions_m[:, 0].min()), float(positions_m[:, 0].max())
    return cell * math.floor(low / cell), cell * math.ceil(high / cell)


def height_map(cloud: SoilCloud, soil: Soil | TerrainSoil) -> Message:
    """sensor_msgs/PointCloud2 in rows and columns: centre and height of every cell, and its lift, float32.

    lift [m] is the height over the surface that the scene describes (z = 0, or its profile), NaN where no
    particle is. It depends only on the cloud and the soil, so a resumed run writes the same map.
    """
    half, positions = 0.5 * soil.bin.width_m, np.asarray(cloud.positions_m, np.float64)
    if isinstance(soil, TerrainSoil):
        grid = height_grid(positions, 0.5 * soil.cell_m, ((0.0, -half), (soil.bin.length_m, half)))
    else:
        low, high = soil_span_m(positions, soil)
        radius, box = soil.particles.mean_volume_radius_m, ((low, -half), (high, half))
        radii = None if cloud.radii_m is None else np.asarray(cloud.radii_m, np.float64)
        grid = height_grid(positions, radius, box, radii)
    xs, ys = grid.centres_m()
    points = np.empty((*grid.height_m.shape, len(FIELDS)), dtype="<f4")
    points[:, :, 0], points[:, :, 1] = xs[None, :], ys[:, None]
    points[:, :, 2] = grid.height_m
    surface = np.zeros_like(xs)
    if isinstance(soil, Soil) and soil.surface is not None:
        surface = np.interp(xs, soil.surface.x_m, soil.surface.z_m)
    points[:, :, 3] = grid.height_m - surface[None, :]
    return points_message(cloud.end_time_ns, points, FIELDS, is_dense=False)
