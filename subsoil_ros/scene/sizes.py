"""Particles: equal spheres, or several radii and how they are distributed, by number of particles."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ..strict_model import Positive, StrictModel
from .bed_kinds import Seed

LARGEST_RATIO = 4.0
"""Limit of the largest radius over the smallest. Cells are sized by the largest: at 4, a cell can hold some
eighty of the smallest, and the damper's limit on the step, set by the smallest, is 1/64 of that of the
largest. For wider distributions, leave out the fine part."""

_PARTS = 4096
"""Number of equal parts of a distribution over which its moments are summed."""


def refuse_wide(smallest_m: float, max_m: float, key: str) -> None:
    if max_m > LARGEST_RATIO * smallest_m * (1.0 + 1e-12):
        raise ValueError(
            f"{key}: {max_m:g} m is {max_m / smallest_m:.3g} times the smallest radius, "
            f"{smallest_m:g} m; allowed is up to {LARGEST_RATIO:g} times, since the smallest sets the step "
            "and the largest the cells; leave out the fine part"
        )


class _Spread(StrictModel):
    """Radii between two bounds."""

    min_radius_m: Positive
    max_radius_m: Positive
    seed: Seed = 0

    @model_validator(mode="after")
    def _ordered(self) -> "_Spread":
        if self.max_radius_m <= self.min_radius_m:
            raise ValueError(
                f"max_radius_m: {self.max_radius_m:g} m is not above min_radius_m, "
                f"{self.min_radius_m:g} m; for equal spheres give particles.radius_m"
            )
        refuse_wide(self.min_radius_m, self.max_radius_m, "max_radius_m")
        return self

    @property
    def bounds_m(self) -> tuple[float, float]:
        """Smallest and largest radius."""
        return self.min_radius_m, self.max_radius_m


class UniformSizes(_Spread):
    """Every radius between the bounds as frequent as any other."""

    kind: Literal["uniform"]

    def radii_at(self, part: np.ndarray) -> np.ndarray:
        """Radius [m] that this `part` (0 to 1) of all particles does not exceed."""
        return self.min_radius_m + part * (self.max_radius_m - self.min_radius_m)


class NormalSizes(_Spread):
    """A normal distribution, cut at the bounds: what lies outside is left out, not moved to them.

    Mean and deviation are those before the cut.
    """

    kind: Literal["normal"]
    mean_radius_m: Positive
    standard_deviation_m: Positive

    @model_validator(mode="after")
    def _mean_inside(self) -> "NormalSizes":
        if not self.min_radius_m < self.mean_radius_m < self.max_radius_m:
            raise ValueError(
                f"mean_radius_m: {self.mean_radius_m:g} m is not between min_radius_m and "
                f"max_radius_m, {self.min_radius_m:g} and {self.max_radius_m:g} m"
            )
        return self

    def radii_at(self, part: np.ndarray) -> np.ndarray:
        """Radius [m] that this `part` (0 to 1) of all particles does not exceed."""
        from scipy.special import ndtr, ndtri  # slow to import, and rarely used

        mean, deviation = self.mean_radius_m, self.standard_deviation_m
        low, high = (ndtr((bound - mean) / deviation) for bound in self.bounds_m)
        return np.clip(mean + deviation * ndtri(low + part * (high - low)), *self.bounds_m)


class ListedSizes(StrictModel):
    """A list of radii, each with its share of all particles, by number or by mass.

    Shares need no sum: each counts over the sum of all. Mass is taken at one density.
    """

    kind: Literal["listed"]
    radii_m: tuple[Positive, ...] = Field(min_length=2)
    shares: tuple[Positive, ...] = Field(min_length=2)
    shares_are: Literal["number", "mass"]
    seed: Seed = 0

    @model_validator(mode="after")
    def _table(self) -> "ListedSizes":
        if len(self.shares) != len(self.radii_m):
            raise ValueError(f"shares: has {len(self.shares)} entries for the {len(self.radii_m)} of radii_m")
        if any(b <= a for a, b in zip(self.radii_m[:-1], self.radii_m[1:], strict=True)):
            raise ValueError("radii_m: must grow from one to the next")
        refuse_wide(self.radii_m[0], self.radii_m[-1], "radii_m")
        return self

    @property
    def bounds_m(self) -> tuple[float, float]:
        """Smallest and largest radius."""
        return self.radii_m[0], self.radii_m[-1]

    @property
    def number_shares(self) -> np.ndarray:
        """Share of each radius in the number of particles; their sum is 1."""
        shares = np.array(self.shares)
        if self.shares_are == "mass":
            shares = shares / np.array(self.radii_m) ** 3
        return shares / shares.sum()

    def radii_at(self, part: np.ndarray) -> np.ndarray:
        """Radius [m] that this `part` (0 to 1) of all particles does not exceed."""
        above = np.cumsum(self.number_shares)[:-1]
        return np.array(self.radii_m)[np.searchsorted(above, part, side="right")]


Sizes = Annotated[UniformSizes | NormalSizes | ListedSizes, Field(discriminator="kind")]


def mean_power(sizes: UniformSizes | NormalSizes | ListedSizes, power: int, less_m: float = 0.0) -> float:
    """Mean of (radius - `less_m`)^power over the particles [m^power], to about 1 / 4096."""
    parts = (np.arange(_PARTS) + 0.5) / _PARTS
    return float(((sizes.radii_at(parts) - less_m) ** power).mean())


def sampled_radii_m(sizes: UniformSizes | NormalSizes | ListedSizes, count: int) -> np.ndarray:
    """(count,) [m] radii drawn with the seed of `sizes`."""
    return sizes.radii_at(np.random.default_rng(sizes.seed).uniform(size=count))


class Particles(StrictModel):
    """Spheres: equal ones of `radius_m`, or of several `sizes`."""

    radius_m: Positive | None = Field(None, description="of equal spheres; or give sizes.")
    sizes: Sizes | None = Field(None, description="in place of radius_m; not for a grid.")
    density_kg_per_m3: Positive = Field(description="of a particle.")
    reference_radius_m: Positive | None = Field(
        None,
        description="radius at which the law was found; it is scaled from there.",
    )

    @model_validator(mode="after")
    def _one_form(self) -> "Particles":
        if (self.radius_m is None) == (self.sizes is None):
            given = "neither is given" if self.sizes is None else "both are given"
            raise ValueError(f"radius_m: {given}; give 'radius_m' for equal spheres or 'sizes' for several")
        return self

    @property
    def bounds_m(self) -> tuple[float, float]:
        """Smallest and largest radius."""
        if self.radius_m is not None:
            return self.radius_m, self.radius_m
        assert self.sizes is not None
        return self.sizes.bounds_m

    @property
    def mean_volume_radius_m(self) -> float:
        """Radius of the sphere of mean volume; that of every sphere where they are equal."""
        if self.radius_m is not None:
            return self.radius_m
        assert self.sizes is not None
        return float(mean_power(self.sizes, 3) ** (1.0 / 3.0))

    def radius_words(self) -> str:
        """Radius, or range, kind and mean of the radii."""
        smallest, largest = self.bounds_m
        if self.sizes is None:
            return f"{largest * 1e3:g} mm"
        mean_mm = mean_power(self.sizes, 1) * 1e3
        return f"{smallest * 1e3:g} to {largest * 1e3:g} mm ({self.sizes.kind}, mean {mean_mm:.3g} mm)"
