"""The limit of small particles: mean forces on a tine by radius, and what they tend to.

    python -m validation.limit RUN RUN RUN [...] [--from-s 0.7] [--to-s 2.7] [--study CSV]

RUN: result folders of one scene with particles of three radii or more. Means and deviations of 20 ms means
over a time that all runs have, with 95 % intervals from each record; the scatter from bed to bed is not in
them. Two extrapolations to r = 0, by least squares: order one, a + b r, and a + b r^p with p fitted. --study:
errors of the presets in the table of a study, against the first, as config/presets/ quotes them; `reference`
is the preset fine.
"""

import argparse
import csv
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from subsoil_ros import read_run
from subsoil_ros.analysis.stationarity import stationarity

ROW_S = 0.02
NORMAL_95 = 1.96
Array = NDArray[np.float64]


def means_of(folder: Path, column: str, from_s: float, to_s: float) -> tuple[float, float, float]:
    """Mean, half-width of its interval, and standard deviation of the 20 ms means of a column."""
    series = read_run(folder).series
    time_s = series["time_s"].to_numpy()
    per_row = round(ROW_S / float(time_s[2] - time_s[1]))
    values = series[column].to_numpy()[(time_s > from_s) & (time_s <= to_s)]
    rows = values[: len(values) // per_row * per_row].reshape(-1, per_row).mean(axis=1)
    known = stationarity(ROW_S * np.arange(len(rows), dtype=np.float64), rows)
    if known is None:
        raise SystemExit(f"{folder}: {len(rows)} rows from {from_s:g} to {to_s:g} s are too few")
    return known.mean, known.mean_half_width, float(rows.std())


def limits(radii_m: Array, means: Array, halves: Array) -> Iterator[tuple[str, float, float]]:
    """Name, value at r = 0, and half-width of each extrapolation; the second needs four radii."""
    sigma = halves / NORMAL_95
    found, spread = curve_fit(lambda r, a, b: a + b * r, radii_m, means, sigma=sigma, absolute_sigma=True)
    yield "a + b r", found[0], NORMAL_95 * float(np.sqrt(spread[0, 0]))
    if len(radii_m) > 3:
        start = (*found, 1.0)
        found, spread = curve_fit(
            lambda r, a, b, p: a + b * (r / 0.01) ** p * 0.01, radii_m, means, p0=start, sigma=sigma,
            absolute_sigma=True, bounds=((-np.inf, -np.inf, 0.3), (np.inf, np.inf, 3.0)),
        )  # fmt: skip
        yield f"a + b r^{found[2]:.2f}", found[0], NORMAL_95 * float(np.sqrt(spread[0, 0]))


def errors_of(
    row: dict[str, str], draft: tuple[float, float], vertical: tuple[float, float]
) -> Iterator[tuple[str, float, float]]:
    """Name, error and half-width of a preset's means against limits, each a value and its half-width [N].

    Both errors are parts of the limit of the draft, whose own interval widens the first alone.
    """
    for name, (limit, half) in {"draft_mean_newton": draft, "vertical_mean_newton": vertical}.items():
        mean, high = float(row[name]), float(row[f"{name}_high"])
        weight = mean / limit if name == "draft_mean_newton" else 1.0  # of a ratio, of a difference
        yield name, (mean - limit) / draft[0], math.hypot(high - mean, weight * half) / draft[0]


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a table and the extrapolations."""
    parser = argparse.ArgumentParser(prog="python -m validation.limit")
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--from-s", type=float, default=0.7)
    parser.add_argument("--to-s", type=float, default=2.7)
    parser.add_argument("--study", type=Path)
    args = parser.parse_args(arguments)
    if len(args.runs) < 3:
        parser.error(f"RUN: {len(args.runs)} given; an extrapolation needs three radii or more")
    radii = []
    for folder in args.runs:
        soil = read_run(folder).scene.scene.particle_soil
        if soil is None:
            parser.error(f"{folder}: its soil has no particles")
        radii.append(soil.particles.mean_volume_radius_m)
    order = np.argsort(radii)[::-1]
    radii_m = np.array(radii)[order]
    straight = []
    for name, column in (("draft", "draft_newton"), ("vertical force, up", "tool.tine.force_z_newton")):
        rows = [means_of(args.runs[k], column, args.from_s, args.to_s) for k in order]
        mean, half, deviation = np.array(rows).T
        print(f"{name}:")
        for radius, *row in zip(radii_m, mean, half, deviation, strict=True):
            print(f"  r = {1e3 * radius:.3g} mm: {row[0]:.0f} +- {row[1]:.0f} N, deviation {row[2]:.0f} N")
        found = list(limits(radii_m, mean, half))
        straight.append(found[0][1:])
        for form, value, width in found:
            print(f"  limit by {form}: {value:.0f} +- {width:.0f} N")
    if args.study is not None:
        with args.study.open(newline="") as table:
            presets = [
                row for row in csv.DictReader(table) if ":" not in row["preset"] and not row["failure"]
            ]
        for row in presets:
            for name, error, width in errors_of(row, *straight):
                ends = f"mean {error:.4f}, low {error - width:.4f}, high {error + width:.4f}"
                print(f"{row['preset']}, {name}: {ends}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
