"""Mean drafts of field_tine by radius, whole tool and set back, and the limit of small particles.

    python -m validation.limit_figure PNG

Reads validation/studies/limit.csv, the drafts of validation/limit.md and, of presets in loam, of the study in
validation/trade.md, with 95 % intervals.
"""

import argparse
import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .limit import limits

DRAFTS = Path(__file__).parent / "studies/limit.csv"
TITLES = {"loam": "loam", "dry_sand": "dry sand"}

FITTED_UP_TO_MM = {"loam": 10.0, "dry_sand": 15.0}
"""Largest radius of the straight line in validation/limit.md."""


def draw(path: Path) -> None:
    """Write the figure as a PNG file."""
    from matplotlib.figure import Figure

    with DRAFTS.open(newline="") as table:
        rows = list(csv.DictReader(table))
    figure = Figure((7.0, 2.9), layout="constrained")
    axes: Any = figure.subplots(1, len(TITLES))
    for axis, (soil, title) in zip(axes, TITLES.items(), strict=True):
        names = ("radius_mm", "setback_mm", "draft_newton", "half_width_newton")
        numbers = np.array([[float(row[name]) for name in names] for row in rows if row["soil"] == soil])
        whole = numbers[numbers[:, 1] == 0.0]
        fitted = whole[whole[:, 0] <= FITTED_UP_TO_MM[soil]]
        _, limit, half = next(limits(fitted[:, 0], fitted[:, 2], fitted[:, 3]))
        slope = np.polyfit(fitted[:, 0], fitted[:, 2], 1, w=1.0 / fitted[:, 3])[0]
        ends = np.array((0.0, fitted[:, 0].max()))
        axis.plot(ends, limit + slope * ends, "--", color="0.5", lw=1.0)
        axis.errorbar(0.0, limit, half, fmt="D", color="0.3", capsize=3, label="limit")
        axis.errorbar(*whole[:, [0, 2, 3]].T, fmt="o", color="#1f4e79", capsize=3, label="whole tool")
        back = numbers[numbers[:, 1] > 0.0]
        axis.errorbar(*back[:, [0, 2, 3]].T, fmt="s", color="#b5651d", capsize=3, label="set back")
        for radius, setback, draft, _ in back:
            axis.annotate(f"{setback:g} mm", (radius, draft), (5, -10), textcoords="offset points", size=7)
        axis.set(title=title, xlabel="radius mm", xlim=(-1.0, 26.0), ylim=(0.0, None))
    axes[0].set_ylabel("mean draft N")
    axes[0].legend(loc="lower right", fontsize=8)
    figure.savefig(path, dpi=110)


def main(arguments: Sequence[str] | None = None) -> None:
    """Draws the figure."""
    parser = argparse.ArgumentParser(prog="python -m validation.limit_figure")
    parser.add_argument("png", type=Path)
    draw(parser.parse_args(arguments).png)


if __name__ == "__main__":
    main()
