"""A sweep: combinations of values of a scene, run, tabled, drawn and ranked."""

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from ..analysis.columns import DRAFT, spring_element
from ..analysis.intervals import CONFIDENCE
from ..analysis.summary import MEAN_DRAFT, flattened, path_of
from ..errors import InputError
from ..figures.sweep_figures import draw_response
from ..whole_files import write_whole
from ..yaml_document import dump_yaml
from .run_cache import CachedRun
from .run_jobs import ExecutionOptions, Watcher, run_jobs
from .run_metrics import metrics_of
from .sweep_points import Job, Point, Variation, as_text, combinations, jobs_of, one_soil
from .sweep_ranking import Ranked, control_point, point_key, rank, ranking_table, recommended

REQUEST = "sweep.yaml"
RUNS = "runs"

RUN_COLUMNS = ("run", "name", "seed", "failure", "wall_s", "cpu_s", "threads", "at_once", "machine", "code")
"""Columns beside the varied keys and the numbers of the summary. wall_s and cpu_s are of the ticks alone."""


@dataclass(frozen=True)
class Sweep:
    """Definition of a sweep."""

    scene: str
    overrides: tuple[str, ...]  # in every run
    varied: tuple[Variation, ...]
    paired: tuple[Variation, ...] = ()
    seeds: tuple[int, ...] = ()
    control: tuple[str, ...] = ()  # KEY=VALUE of the runs that savings are counted from

    @property
    def keys(self) -> list[str]:
        """Varied keys, in the order they were given."""
        return [item.key for item in (*self.varied, *self.paired)]

    @property
    def axes(self) -> list[str]:
        """Keys of the figure's x axes: the varied ones and the first of the paired ones."""
        return [item.key for item in (*self.varied, *self.paired[:1])]

    def points(self) -> tuple[Point, ...]:
        """Combinations of values, without seeds and controls."""
        return combinations(self.varied, self.paired)

    def jobs(self) -> tuple[Job, ...]:
        """Every run, controls last, each once, all in one soil. Raises as jobs_of and combinations."""
        points = self.points()
        controls = [control_point(point, self.control) for point in points] if self.control else []
        unique = {point_key(point): point for point in (*points, *controls)}
        runs = tuple(unique.values())
        jobs = jobs_of(self.scene, self.overrides, runs, self.seeds)
        alike = one_soil([job.scene for job in jobs])
        return jobs_of(self.scene, [*alike, *self.overrides], runs, self.seeds) if alike else jobs

    def document(self) -> dict[str, object]:
        """The request as a document, for the folder."""
        return {
            "scene": str(Path(self.scene).resolve()),
            "set": list(self.overrides),
            "vary": {item.key: list(item.values) for item in self.varied},
            "pair": {item.key: list(item.values) for item in self.paired},
            "seeds": list(self.seeds),
            "control": list(self.control),
        }


@dataclass(frozen=True)
class Outcome:
    """Results of a sweep in its folder."""

    table: pd.DataFrame
    ranked: list[Ranked]
    best: Ranked | None
    failed: list[tuple[str, str]]  # label and message
    paths: list[Path]
    extrapolated: int  # runs that left the range in which their wedge model was fitted
    empty_windows: int  # runs without a row in their metrics window: their means are of the whole run


def open_folder(out: Path, request: str) -> None:
    """Make or open the folder of a sweep or a study: new, empty, or begun before.

    Raises:
        InputError: it holds something else, or cannot be made.
    """
    if out.is_dir() and any(out.iterdir()) and not (out / request).is_file():
        raise InputError(
            f"--out {out}: exists, and has no {request} of an earlier call to go on from; name another folder"
        )
    try:
        (out / RUNS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be created ({error.strerror}); name a folder that can"
        ) from error


def run_sweep(
    sweep: Sweep, out: Path, manner: ExecutionOptions, watcher: Watcher, shown: Sequence[str] = ()
) -> Outcome:
    """Run the missing runs, then write sweep.csv, sweep.parquet, ranking.csv and response.png.

    shown: columns to draw and to add to the ranking; by default draft and spring force are drawn.

    Raises:
        InputError: a wrong key, value or folder (nothing was run), no cluster, or a column in `shown` that no
            run has (sweep.csv is written).
    """
    jobs = sweep.jobs()
    open_folder(out, REQUEST)
    write_whole(out / REQUEST, lambda part: part.write_text(dump_yaml(sweep.document()), encoding="utf-8"))
    runs = run_jobs(jobs, out / RUNS, manner, watcher)
    table = table_of(jobs, runs)
    spring = jobs[0].scene.scene.report.spring
    empty = sum(run.failure is None and run.metrics.window.whole_run for run in runs)
    paths = [*write_table(table, out / "sweep")]
    if any(run.failure is None for run in runs):
        refuse_unknown(shown, table, "--show")
    by_point = table.assign(point=[point_key(job.point) for job in jobs])
    ranked = rank(sweep.points(), by_point, sweep.control, spring, CONFIDENCE, shown)
    proven = not sweep.control or (bool(ranked) and ranked[0].saving is not None)
    best = recommended(ranked) if len(ranked) > 1 and proven and not empty else None
    if ranked:
        paths.append(out / "ranking.csv")
        write_whole(paths[-1], lambda part: ranking_table(ranked, best).to_csv(part, index=False))
    columns = list(shown) or _usual_columns(table, spring)
    done = table[(table["failure"] == "") & (table["name"] == "")]
    figure = draw_response(done, sweep.axes, columns, out / "response.png")
    paths += [figure] if figure else []
    extrapolated = sum(run.failure is None and bool(run.metrics.loads.extrapolated) for run in runs)
    return Outcome(table, ranked, best, failed_of(jobs, runs), paths, extrapolated, empty)


def _usual_columns(table: pd.DataFrame, spring: str | None) -> list[str]:
    names = [
        MEAN_DRAFT,
        path_of(DRAFT, "max"),
        path_of(spring_element(spring).load, "max"),
        path_of(spring_element(spring).load, "min"),
    ]
    return [name for name in names if name in table]


def refuse_unknown(columns: Sequence[str], table: pd.DataFrame, flag: str) -> None:
    """Raise InputError for a column that the table of runs has not."""
    unknown = [name for name in columns if name not in table]
    if unknown:
        near = difflib.get_close_matches(unknown[0], [str(name) for name in table.columns], n=3)
        hint = f"; near it are {', '.join(near)}" if near else ""
        raise InputError(
            f"{flag} {unknown[0]}: no such column{hint}. All runs are kept, and the table beside them names "
            f"the columns; the same command with another {flag} continues from them"
        )


def failed_of(jobs: Sequence[Job], runs: Sequence[CachedRun]) -> list[tuple[str, str]]:
    """Label and message of every run that failed."""
    return [
        (job.point.label, run.failure) for job, run in zip(jobs, runs, strict=True) if run.failure is not None
    ]


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
