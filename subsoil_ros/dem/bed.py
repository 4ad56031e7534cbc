"""A prepared bed, and the progress of its preparation."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ..errors import InputError
from ..scene.bed_kinds import SurfaceProfile
from ..scene.soil import Soil


@dataclass(frozen=True)
class Bed:
    """Prepared particles and the box they stand in. World axes, z = 0 at the mean top."""

    positions_m: np.ndarray  # (n, 3) float64
    lower_m: tuple[float, float, float]  # x, y, z of the walls x = 0, right side, floor
    upper_m: tuple[float, float]  # x, y of the far wall and the left side; the top is open
    kinetic_energy_joule: float = 0.0  # left when its preparation ended; a run starts from rest
    radii_m: np.ndarray | None = None  # (n,) float64; None: all are equal
    materials: np.ndarray | None = None  # (n,) int64 number of the layer from the top; None: there are none
    sides: Literal["walls", "periodic", "endless"] = "walls"
    """periodic: the box is one period wide in y; endless: it repeats itself along all axes, z = 0 its top."""
    held: np.ndarray | None = None  # (n,) bool: stays where it is; None: no particle does

    @property
    def period_m(self) -> float | None:
        """Period in y [m], None between walls."""
        return None if self.sides == "walls" else self.upper_m[1] - self.lower_m[1]

    @property
    def periods_m(self) -> tuple[float, float, float]:
        """Period along x, y and z [m], infinite where there is none."""
        x, y, z = self.lower_m
        if self.sides == "endless":
            return self.upper_m[0] - x, self.upper_m[1] - y, -z
        return np.inf, self.period_m or np.inf, np.inf

    @property
    def floor_m(self) -> float:
        """Lower end of the bed [m]: the plane of the floor, or the highest centre that is held."""
        return self.lower_m[2] if self.held is None else float(self.positions_m[self.held, 2].max())

    def only(self, kept: np.ndarray) -> "Bed":
        """The bed with only the particles `kept`: (n,) bool, or an array of their numbers."""
        return dataclasses.replace(
            self,
            positions_m=self.positions_m[kept],
            radii_m=None if self.radii_m is None else self.radii_m[kept],
            materials=None if self.materials is None else self.materials[kept],
            held=None if self.held is None else self.held[kept],
        )


def scaled(bed: Bed, scale: float | np.ndarray) -> Bed:
    """Bed and walls `scale` times as large, or (3,) along x, y and z, about the origin."""
    scales = np.broadcast_to(scale, 3)
    x, y, z = np.array(bed.lower_m) * scales
    far, left = np.array(bed.upper_m) * scales[:2]
    return dataclasses.replace(
        bed,
        positions_m=bed.positions_m * scale,
        lower_m=(float(x), float(y), float(z)),
        upper_m=(float(far), float(left)),
        kinetic_energy_joule=0.0,
    )


def radii_of(bed: Bed, soil: Soil) -> np.ndarray:
    """(n,) [m] radius of every particle."""
    if bed.radii_m is not None:
        return bed.radii_m
    return np.full(len(bed.positions_m), soil.particles.mean_volume_radius_m)


def profile_m(surface: SurfaceProfile | None, x_m: np.ndarray) -> np.ndarray:
    """Height of a surface profile at `x_m`; zero without one [m]."""
    return np.zeros_like(x_m) if surface is None else np.interp(x_m, surface.x_m, surface.z_m)


def refuse_outside(bed: Bed, planes: np.ndarray, position_m: np.ndarray) -> None:
    """Check that `position_m` (n, 3) is in the box of `bed`, open at the top and at periodic sides.

    Raises:
        InputError: a centre is outside or not a number, or no centre is given.
    """
    inside = (planes[:, 3] - position_m @ planes[:, :3].T >= 0.0).all(axis=1)  # not a number: outside
    if len(position_m) == 0 or not inside.all():
        given = "no particle" if len(position_m) == 0 else f"a particle at {position_m[np.argmin(inside)]} m"
        raise InputError(
            f"place: given {given}; allowed are centres inside the bin, from {bed.lower_m} to {bed.upper_m} m"
        )


def finite_rows(name: str, given: np.ndarray, count: int) -> np.ndarray:
    """`given` as (count, 3) float64.

    Raises:
        InputError: rows are missing or not finite.
    """
    rows = np.array(given, np.float64).reshape(-1, 3)
    finite = int(np.isfinite(rows).all(axis=1).sum())
    if len(rows) != count or finite != count:
        raise InputError(
            f"place: given {len(rows)} rows of {name}, {finite} finite; they must be {count}, all finite"
        )
    return rows


class RestProgress(NamedTuple):
    """Progress of one phase of a preparation."""

    phase: str
    simulated_s: float
    longest_s: float  # the phase ends then at the latest
    rms_speed_m_per_s: float
    rest_speed_m_per_s: float  # the phase ends below it


OnProgress = Callable[[RestProgress], None]
"""Called from time to time with the progress of a preparation."""


def ignore_progress(progress: RestProgress) -> None:
    """Show no progress."""
