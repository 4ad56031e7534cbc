"""The tables in docs/results are those of the series, or of the single runs, beside them."""

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from benchmarks.kept_runs import read_rows
from subsoil_ros.analysis.findings import MOVING_S
from subsoil_ros.analysis.paired import paired_difference
from subsoil_ros.analysis.series_file import read_series_csv
from subsoil_ros.analysis.smoothing import moving_mean

RESULTS = Path(__file__).parents[2] / "docs" / "results"
FOLDERS = sorted(path.parent for path in RESULTS.glob("*/provenance.json"))
COLUMN_OF = {
    "draft, cycle": "draft_newton",
    "draft, run": "draft_newton",
    "spring force": "spring.H9_spring.force_newton",
    "share entry angle": "body.shank.angle_rad",
    "height of the shank's centre of mass": "body.shank.z_m",
}
TAKE = {
    "least": np.min, "largest": np.max, "mean": np.mean, "largest compression": np.max,
    "largest tension": np.min, "peak to peak": np.ptp,
}  # fmt: skip


def test_there_are_results():
    """At least one run is shipped."""
    assert FOLDERS


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_tables_are_those_of_the_series(folder):
    """Every draft, force, angle and height of the table follows from the rows of window or rest."""
    series = read_series_csv(folder / "series.csv")
    document = json.loads((folder / "reproduction.json").read_text())
    summary = json.loads((folder / "summary.json").read_text())
    provenance = json.loads((folder / "provenance.json").read_text())
    assert document["scene_hash"] == summary["scene_hash"] == provenance["scene_hash"]
    window = summary["window"]
    rows = (series["time_s"] >= window["start_s"]) & (series["time_s"] <= window["end_s"])
    assert rows.sum() == window["rows"]
    checked = 0
    for row in document["rows"]:
        if row["quantity"] not in COLUMN_OF:
            continue
        column, take = COLUMN_OF[row["quantity"]], TAKE[row["measure"]]
        values = series[column] if row["measure"] == "mean" else moving_mean(series, column, MOVING_S)
        for place, chosen in (("inside", rows), ("outside", ~rows)):
            assert row[place] == pytest.approx(float(take(values[chosen])), rel=1e-12), (
                row["measure"],
                place,
            )
            checked += 1
    assert checked >= 20


SAVINGS = sorted((RESULTS / "tables").glob("draft_saving_*.json"))


@pytest.mark.parametrize("path", SAVINGS, ids=lambda path: path.stem)
def test_savings_are_those_of_their_seeds(path):
    """Every difference with its half-width follows from the runs, bed by bed."""
    document = json.loads(path.read_text())
    checked = 0
    for control, quantities in document["differences"].items():
        for name, shipped in quantities.items():
            runs = [[seed[machine][name] for seed in document["seeds"]] for machine in ("sprung", control)]
            known = {key: value if value is not None else math.inf for key, value in shipped.items()}
            assert known == pytest.approx(asdict(paired_difference(*runs)), rel=1e-12)
            checked += 1
    assert checked >= 8


def test_springs_lie_where_the_locked_shanks_say():
    """Springs at their own angle: drafts of the ranking, and control drafts between the locked angles."""
    tables = RESULTS / "tables"
    spring = "mechanism.forces.H9_spring."
    names = ("stiffness_newton_per_m", "free_length_m", "damping_newton_s_per_m")
    ranked = {
        tuple(float(row[spring + name]) for name in names): float(row["draft_newton_mean"])
        for row in read_rows(tables / "springs_ranking.csv")
        if row[spring + names[0]]
    }
    locked = [
        (float(row["angle_rad"]), float(row["draft_newton"]))
        for row in read_rows(tables / "locked_angles.csv")
    ]
    angles = sorted({angle for angle, _ in locked})
    means = [np.mean([draft for at, draft in locked if at == angle]) for angle in angles]
    rows = read_rows(tables / "springs_at_own_angle.csv")
    assert len(rows) > 50
    for row in rows:
        draft, control = float(row["draft_newton"]), float(row["locked_there_newton"])
        assert draft == pytest.approx(ranked[tuple(float(row[name]) for name in names)], rel=1e-9)
        # interpolated seed by seed, and each seed at its own angle: nearly the means
        assert control == pytest.approx(np.interp(float(row["mean_angle_rad"]), angles, means), rel=2e-3)
        assert float(row["saving"]) == pytest.approx(1.0 - draft / control, abs=1e-4)
