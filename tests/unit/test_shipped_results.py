"""The tables in docs/results are those of the series beside them."""

import json
from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.analysis.findings import MOVING_S
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
