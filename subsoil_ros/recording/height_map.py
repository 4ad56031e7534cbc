"""Height of the soil's surface over the bin, from the positions of its particles."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..messages import SoilCloud
from ..scene.soil import Soil
from .point_cloud import points_message

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
    positions_m: NDArray[Any], radius_m: float, box_m: tuple[tuple[float, float], tuple[float, float]]
) -> HeightGrid:
    """Highest centre plus a radius in every cell of a box ((x, y) of its corners); positions (n, 3) [m]."""
    cell = CELL_DIAMETERS * 2.0 * radius_m
    (x_low, y_low), (x_high, y_high) = box_m
    columns = max(1, round((x_high - x_low) / cell))
    rows = max(1, round((y_high - y_low) / cell))
    column = np.floor((positions_m[:, 0] - x_low) / cell).astype(np.int64)
    row = np.floor((positions_m[:, 1] - y_low) / cell).astype(np.int64)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    height = np.full((rows, columns), -np.inf)
    np.maximum.at(height, (row[inside], column[inside]), positions_m[inside, 2] + radius_m)
    return HeightGrid((x_low, y_low), cell, np.where(np.isfinite(height), height, np.nan))


def soil_span_m(positions_m: NDArray[Any], soil: Soil) -> tuple[float, float]:
    """Extent of the soil along x [m]: the bin or, with a window, whole cells around the particles (n, 3)."""
    if soil.window is None or len(positions_m) == 0:
        return 0.0, soil.bin.length_m
    cell = CELL_DIAMETERS * 2.0 * soil.particles.mean_volume_radius_m
    low, high = float(positions_m[:, 0].min()), float(positions_m[:, 0].max())
    return cell * math.floor(low / cell), cell * math.ceil(high / cell)


def height_map(cloud: SoilCloud, soil: Soil) -> Any:
    """sensor_msgs/PointCloud2 in rows and columns: centre and height of every cell, and its lift, float32.

    lift [m] is the height over the surface that the scene describes (z = 0, or its profile), NaN where no
    particle is. It depends only on the cloud and the soil, so a resumed run writes the same map.
    """
    half, positions = 0.5 * soil.bin.width_m, np.asarray(cloud.positions_m, np.float64)
    low, high = soil_span_m(positions, soil)
    grid = height_grid(positions, soil.particles.mean_volume_radius_m, ((low, -half), (high, half)))
    xs, ys = grid.centres_m()
    points = np.empty((*grid.height_m.shape, len(FIELDS)), dtype="<f4")
    points[:, :, 0], points[:, :, 1] = xs[None, :], ys[:, None]
    points[:, :, 2] = grid.height_m
    surface = np.zeros_like(xs)
    if soil.surface is not None:
        surface = np.interp(xs, soil.surface.x_m, soil.surface.z_m)
    points[:, :, 3] = grid.height_m - surface[None, :]
    return points_message(cloud.end_time_ns, points, FIELDS, is_dense=False)
