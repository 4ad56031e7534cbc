"""Measured drafts of blades beside the predicted ones: rules of PREDICTIONS.md, from the kept runs of
`python -m validation.measured TABLE --out results/SET_RADIUS`.
"""

import csv
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .blade_table import FORMS, blade_of, printed_soil
from .plate_points import Point

RESULTS = Path(__file__).with_name("results")
RADIUS_M = 0.012
"""Of all rows."""

SUSPECT = (0.3, 0.1)
"""Width and depth of the row whose dimensionless force is far from its fellows'."""

Place = tuple[float, float]
"""Width and depth of a row [m]."""

Kept = Mapping[str, str]


def read(name: str) -> list[Kept]:
    """Rows of every radius of a set."""
    rows: list[Kept] = []
    for path in sorted(RESULTS.glob(f"{name}_*/results.csv")):
        with path.open(newline="", encoding="utf-8") as file:
            rows += list(csv.DictReader(file))
    return rows


def place_of(row: Kept) -> Place:
    """Width and depth."""
    return float(row["width_m"]), float(row["depth_m"])


class Grain(NamedTuple):
    """F = F0 (1 + b r / d), least squares over the radii of one row."""

    slope: float  # b
    at_zero_newton: float  # F0
    half_newton: float  # of its 95 % interval, from those of the means


def grain(rows: Sequence[Kept]) -> Grain | None:
    """None with fewer than three radii."""
    if len({row["radius_m"] for row in rows}) < 3:
        return None
    x = [float(row["radius_m"]) / float(row["depth_m"]) for row in rows]
    taken = np.linalg.pinv(np.column_stack([np.ones(len(x)), x]))
    drafts, halves = (
        np.array([float(row[key]) for row in rows]) for key in ("simulated_newton", "simulated_error_newton")
    )
    at_zero, rise = taken @ drafts
    return Grain(float(rise / at_zero), float(at_zero), float(np.hypot.reduce(taken[0] * halves)))


def grains(rows: Sequence[Kept]) -> dict[str, Grain]:
    """Of each reading, where a row has three radii."""
    groups: dict[tuple[str, Place], list[Kept]] = defaultdict(list)
    for row in rows:
        groups[row["soil"], place_of(row)].append(row)
    return {soil: fit for (soil, _), group in groups.items() if (fit := grain(group)) is not None}


def predictions(rows: Sequence[Kept]) -> dict[str, dict[Place, list[float]]]:
    """Draft of each reading, by who predicts and by row."""
    found: dict[str, dict[Place, list[float]]] = defaultdict(lambda: defaultdict(list))
    fits = grains(rows)
    for row in sorted(rows, key=lambda row: row["soil"]):
        if float(row["radius_m"]) != RADIUS_M:
            continue
        soil, place, draft = row["soil"], place_of(row), float(row["simulated_newton"])
        found["particles"][place].append(draft)
        if soil in fits:
            found["particles, without grain"][place].append(
                draft / (1.0 + fits[soil].slope * RADIUS_M / place[1])
            )
        for name, form in FORMS.items():
            found[name][place].append(form(printed_soil(row), blade_of(row)).draft_newton)
    return found


def points() -> Iterator[Point]:
    """Geometric mean of both readings of each row, without the grain where three radii are there."""
    rows = read("obermayr2013")
    measured = {place_of(row): float(row["draft_newton"]) for row in rows}
    readings = {row["soil"] for row in rows}
    found = predictions(rows)
    particles = found.pop("particles, without grain", None) or found["particles"]
    found.pop("particles", None)
    for place in sorted(measured):
        if len(particles.get(place, [])) == len(readings) == 2:
            yield Point(
                "Obermayr et al.", f"{place[0]:g} m wide, {place[1]:g} m deep, N", measured[place],
                _mean(particles[place]), {name: _mean(drafts[place]) for name, drafts in found.items()},
            )  # fmt: skip


def verdict() -> Iterator[str]:
    """The rules of the set as a whole, and the factors of the grain."""
    suspect = f"{SUSPECT[0]:g} m wide, {SUSPECT[1]:g} m deep, N"
    found = list(points())
    off = {point.what: abs(point.predicted / point.measured - 1.0) for point in found}
    if not off:
        yield "Blades: no row has both readings yet."
        return
    rows = read("obermayr2013")
    trusted = [value for what, value in off.items() if what != suspect]
    both = {place: two for place, two in predictions(rows)["particles"].items() if len(two) == 2}
    apart = max(max(two) / min(two) for two in both.values())
    larger = [_mean(both[place]) / point.measured for place, point in zip(sorted(both), found, strict=True)]
    yield (
        f"Blades: {len(off)} rows of 8, mean absolute error {np.mean(list(off.values())):.1%}, without the "
        f"suspect row {np.mean(trusted):.1%} (below 15 %); readings up to {apart:.2f} apart (1.6). Particles "
        f"of {1e3 * RADIUS_M:g} mm, without the factor of the grain, over measured: "
        + ", ".join(f"{ratio:.2f}" for ratio in larger)
        + "."
    )
    for soil, fit in sorted(grains(rows).items()):
        yield ""
        yield (
            f"Factor of the grain, `{soil}`: b of $F_0 (1 + b\\, r/d)$ is {fit.slope:.1f}, $F_0$ "
            f"{fit.at_zero_newton:.0f} +- {fit.half_newton:.0f} N."
        )


def _mean(values: Sequence[float]) -> float:
    """Geometric."""
    return math.exp(float(np.mean(np.log(values))))
