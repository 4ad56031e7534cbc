"""The tables in results/ are those of the single runs beside them, and say where they come from."""

import json
import math
from dataclasses import asdict

import numpy as np
import pytest

from benchmarks.run_cache import read_rows
from reproduction.yuan_yu_2020 import HERE, RESULTS
from reproduction.yuan_yu_2020.paired import paired_difference

LARGEST_BYTES = 2_000_000


def test_results_stay_small():
    """All results and pictures of the repository, those of docs/ included."""
    folders = [HERE, HERE.parents[1] / "docs" / "results"]
    files = [path for top in folders for path in top.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    assert sum(path.stat().st_size for path in files) < LARGEST_BYTES


def test_runs_say_where_they_come_from():
    """A table of a run has its command, commit, scene and window, and the hash that the table names."""
    folders = [path.parent for path in RESULTS.glob("*/reproduction.csv")]
    assert len(folders) >= 6
    for folder in folders:
        found = json.loads((folder / "provenance.json").read_text())
        assert {"command", "commit", "scene", "window"} <= found.keys()
        assert f"`{found['scene_hash'][:16]}`" in (folder / "reproduction.md").read_text()


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
