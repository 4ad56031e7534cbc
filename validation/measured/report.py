"""Measured drafts of blades beside the predicted ones: rules of PREDICTIONS.md, from kept runs in seconds.

    python -m validation.measured.report

Reads results/SET_RADIUS/results.csv, written by `python -m validation.measured --out`.
"""

import csv
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..blades import Blade, Soil, godwin_odogherty, mckyes_ali, perumpral

RESULTS = Path(__file__).with_name("results")
RADIUS_M = 0.012
"""Of all rows."""

SUSPECT = (0.3, 0.1)
"""Width and depth of the row whose dimensionless force is far from its fellows'."""

FORMS = {"Perumpral": perumpral, "Godwin and O'Dogherty": godwin_odogherty, "McKyes and Ali": mckyes_ali}

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


def printed_strength(row: Kept) -> Soil:
    """The soil as the laboratory gives it."""
    return Soil(
        float(row["cohesion_pa"]), math.radians(float(row["friction_angle_deg"])),
        float(row["bulk_density_kg_per_m3"]), math.radians(float(row["metal_friction_angle_deg"])),
    )  # fmt: skip


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
            blade = Blade(*place, math.radians(float(row["rake_deg"])), float(row["speed_m_per_s"]))
            for name, form in FORMS.items():
                found[name][place].append(form(printed_strength(row), blade).draft_newton)
    return found


def report(rows: Sequence[Kept]) -> Iterator[str]:
    """Tables: each row's geometric mean of both readings over the measured, and the errors."""
    measured = {place_of(row): float(row["draft_newton"]) for row in rows}
    readings = len({row["soil"] for row in rows})
    found = predictions(rows)
    yield "| width m | depth m | measured N | " + " | ".join(found) + " | readings apart |"
    yield "|---" * (len(found) + 4) + "|"
    ratios: dict[str, dict[Place, float]] = defaultdict(dict)
    for place in sorted(measured):
        cells = []
        for name, drafts in found.items():
            both = drafts.get(place, [])
            if len(both) == readings:
                ratios[name][place] = math.exp(float(np.mean(np.log(both)))) / measured[place]
            cells.append(f"{ratios[name][place]:.2f}" if place in ratios[name] else "-")
        both = found["particles"].get(place, [])
        apart = f"{max(both) / min(both):.2f}" if len(both) == readings else "-"
        yield f"| {place[0]:g} | {place[1]:g} | {measured[place]:.0f} | {' | '.join(cells)} | {apart} |"
    yield ""
    yield "| predicted by | rows | mean absolute error | without the suspect row | mean |"
    yield "|---|---|---|---|---|"
    for name, by_place in ratios.items():
        off = {place: ratio - 1.0 for place, ratio in by_place.items()}
        trusted = [value for place, value in off.items() if place != SUSPECT]
        yield (
            f"| {name} | {len(off)} | {_mean_size(list(off.values())):.0%} | {_mean_size(trusted):.0%} "
            f"| {np.mean(list(off.values())):+.0%} |"
        )


def _mean_size(values: Sequence[float]) -> float:
    return float(np.mean(np.abs(values))) if values else math.nan


if __name__ == "__main__":
    print("\n".join(report(read("obermayr2013"))))
