"""Measured drafts of blades beside the predicted ones: rules of PREDICTIONS.md, from the kept runs of
`python -m validation.measured TABLE --out results/SET_RADIUS`.
"""

import csv
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

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


def grain_slope(rows: Sequence[Kept]) -> float | None:
    """b of F = F0 (1 + b r / d), least squares over the radii of one row; None with fewer than three."""
    if len({row["radius_m"] for row in rows}) < 3:
        return None
    x = [float(row["radius_m"]) / float(row["depth_m"]) for row in rows]
    slope, at_zero = np.polyfit(x, [float(row["simulated_newton"]) for row in rows], 1)
    return float(slope / at_zero)


def predictions(rows: Sequence[Kept]) -> dict[str, dict[Place, list[float]]]:
    """Draft of each reading, by who predicts and by row."""
    found: dict[str, dict[Place, list[float]]] = defaultdict(lambda: defaultdict(list))
    for soil in sorted({row["soil"] for row in rows}):
        own = [row for row in rows if row["soil"] == soil]
        by_place: dict[Place, list[Kept]] = defaultdict(list)
        for row in own:
            by_place[place_of(row)].append(row)
        slopes = [slope for group in by_place.values() if (slope := grain_slope(group)) is not None]
        for row in own:
            if float(row["radius_m"]) != RADIUS_M:
                continue
            place, draft = place_of(row), float(row["simulated_newton"])
            found["particles"][place].append(draft)
            if slopes:
                found["particles, without grain"][place].append(
                    draft / (1.0 + slopes[0] * RADIUS_M / place[1])
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


def verdict() -> str:
    """The rules of the set as a whole."""
    suspect = f"{SUSPECT[0]:g} m wide, {SUSPECT[1]:g} m deep, N"
    off = {point.what: abs(point.predicted / point.measured - 1.0) for point in points()}
    if not off:
        return "Blades: no row has both readings yet."
    trusted = [value for what, value in off.items() if what != suspect]
    drafts = predictions(read("obermayr2013"))["particles"].values()
    apart = max(max(both) / min(both) for both in drafts if len(both) == 2)
    return (
        f"Blades: {len(off)} rows of 8, mean absolute error {np.mean(list(off.values())):.0%}, without the "
        f"suspect row {np.mean(trusted):.0%} (below 15 %); readings up to {apart:.2f} apart (1.6)."
    )


def _mean(values: Sequence[float]) -> float:
    """Geometric."""
    return math.exp(float(np.mean(np.log(values))))
