"""One table of many runs: a row each, CSV and Parquet."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from ...analysis.summary import flattened
from ..run_cache import CachedRun
from ..run_metrics import metrics_of
from .points import Job, as_text

RUN_COLUMNS = ("run", "name", "seed", "failure", "wall_s", "cpu_s", "threads", "at_once", "machine", "code")
"""Columns beside the varied keys and the numbers of the summary. wall_s and cpu_s are of the ticks alone."""


def table_of(jobs: Sequence[Job], runs: Sequence[CachedRun]) -> pd.DataFrame:
    """A row per job: its run's folder, the varied keys, its outcome, then every number of its summary.

    seed is -1 where a job has none of its own, failure empty where there was none.
    """
    keys = list(dict.fromkeys(key for job in jobs for key in job.point.values))
    numeric = {key: _all_numbers(jobs, key) for key in keys}
    rows = []
    for job, run in zip(jobs, runs, strict=True):
        values = {
            key: job.point.values.get(key) if numeric[key] else as_text(job.point.values.get(key, ""))
            for key in keys
        }
        facts = {name: run.facts.get(name) for name in RUN_COLUMNS[4:]}
        rows.append(
            {
                "run": run.folder.name,
                "name": job.point.name,
                **values,
                "seed": -1 if job.point.seed is None else job.point.seed,
                "failure": run.failure or "",
                **facts,
                **numbers_of(run),
            }
        )
    return pd.DataFrame(rows)


def numbers_of(run: CachedRun) -> dict[str, float | int]:
    """Every number of a run's summary, by its dotted path; of a complete run its metrics (run_metrics.py)."""
    metrics = {} if run.failure else metrics_of(run)
    return {f"metrics.{name}": value for name, value in metrics.items()} | {
        name: value
        for name, value in flattened(run.summary).items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


def _all_numbers(jobs: Sequence[Job], key: str) -> bool:
    values = [job.point.values[key] for job in jobs if key in job.point.values]
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def write_table(table: pd.DataFrame, stem: Path) -> tuple[Path, Path]:
    """Write STEM.csv and STEM.parquet, each in one piece; numbers of the CSV read back to the same bits."""
    paths = stem.with_suffix(".csv"), stem.with_suffix(".parquet")
    write_whole(paths[0], lambda part: table.to_csv(part, index=False))
    write_whole(paths[1], lambda part: table.to_parquet(part, engine="pyarrow", index=False))
    return paths


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file beside `path`, then move it to `path`."""
    part = path.with_name(f".{path.name}.part")
    write(part)
    os.replace(part, path)
