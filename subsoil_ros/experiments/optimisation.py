"""Search for the values of scene keys with the least of a quantity: Optuna proposes, runs answer."""

import itertools
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import optuna
import pandas as pd

from ..analysis.intervals import Interval, difference_by_seed, mean_interval
from ..errors import InputError, RunError
from ..loading.files import shipped_scene
from ..loading.loader import load_scene
from ..loading.overrides import Override, as_fragment
from ..whole_files import write_whole
from ..yaml_document import Document, dump_yaml, merge
from .run_cache import lack_of
from .run_jobs import ExecutionOptions, Watcher, run_jobs
from .run_sweep import RUNS, open_folder, refuse_unknown, table_of, write_table
from .sweep_points import Job, Point, Variation, jobs_of, one_soil, seed_key

REQUEST = "optimise.yaml"

TRIALS_AT_ONCE = 4
"""Points that are proposed together, on any machine: the same call proposes the same points, so one that was
stopped continues from its kept runs."""

SAMPLER_SEED = 0

RANDOM_TRIALS = 8
"""Trials at random places before the results steer the search: two rounds, a third of the default trials."""

DIGITS = 4
"""Significant digits of a proposed value: 0.1 mm of a width of 0.1 m."""


@dataclass(frozen=True)
class Range:
    """A key of the scene and the ends of its values."""

    key: str
    low: float
    high: float


@dataclass(frozen=True)
class Search:
    """Definition of a search."""

    scene: str
    overrides: tuple[str, ...]  # in every run
    ranges: tuple[Range, ...]
    least: str  # column of trials.csv
    trials: int
    seeds: tuple[int, ...] = ()

    def document(self) -> Document:
        """The request as a document, for the folder."""
        return {
            "scene": str(shipped_scene(Path(self.scene)).resolve()),
            "set": list(self.overrides),
            "ranges": {item.key: [item.low, item.high] for item in self.ranges},
            "least": self.least,
            "seeds": list(self.seeds),
        }


@dataclass(frozen=True)
class Trial:
    """A point whose runs are complete."""

    values: dict[str, object]
    by_seed: dict[int, float]

    @property
    def result(self) -> Interval:
        """Its quantity over the seeds."""
        return mean_interval(list(self.by_seed.values()))

    def behind(self, best: "Trial") -> Interval:
        """Its quantity above that of the best, by equal seeds."""
        return difference_by_seed(self.by_seed, best.by_seed)


@dataclass(frozen=True)
class SearchResult:
    """Trials, least first, and the scene of the first of them."""

    trials: list[Trial]
    failed: list[tuple[str, str]]  # label and message
    best_scene: Path
    paths: list[Path]


def in_every_run(overrides: Sequence[str]) -> str:
    """Options of a command that give the same overrides, in one line."""
    return " ".join(shlex.join(["--set", " ".join(text.split())]) for text in overrides)


def parse_ranges(variations: Sequence[Variation]) -> tuple[Range, ...]:
    """Ranges of variations that are two numbers, least first.

    Raises:
        InputError: one is not.
    """
    ranges = []
    for item in variations:
        numbers = [
            value for value in item.values if isinstance(value, int | float) and not isinstance(value, bool)
        ]
        if len(item.values) != 2 or len(numbers) != 2 or not numbers[0] < numbers[1] < math.inf:
            given = ",".join(map(str, item.values))
            raise InputError(f"--vary {item.key}: given {given}; must be two numbers, LEAST,LARGEST")
        ranges.append(Range(item.key, *map(float, numbers)))
    return tuple(ranges)


def search(wanted: Search, out: Path, manner: ExecutionOptions, watcher: Watcher) -> SearchResult:
    """Run what has not been run; write trials.csv, trials.parquet and best.yaml.

    All runs get the one soil of the corners of the ranges (one_soil).

    Raises:
        InputError: a wrong key, range or folder (nothing was run), or a quantity that no run has.
        RunError: no point has all its runs.
    """
    keys = [item.key for item in wanted.ranges]
    corners = [
        Point(dict(zip(keys, ends, strict=True)))
        for ends in itertools.product(*((item.low, item.high) for item in wanted.ranges))
    ]
    of_corners = jobs_of(wanted.scene, wanted.overrides, corners, wanted.seeds)
    _refuse_unwritable(wanted, of_corners[0])
    changes = [*one_soil([job.scene for job in of_corners]), *wanted.overrides]
    open_folder(out, REQUEST)
    write_whole(out / REQUEST, lambda part: part.write_text(dump_yaml(wanted.document()), encoding="utf-8"))
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(
        sampler=optuna.samplers.TPESampler(n_startup_trials=RANDOM_TRIALS, seed=SAMPLER_SEED)
    )
    tables: list[pd.DataFrame] = []
    trials: list[Trial] = []
    failed: list[tuple[str, str]] = []
    paths: tuple[Path, ...] = ()
    for first in range(0, wanted.trials, TRIALS_AT_ONCE):
        asked = [study.ask() for _ in range(min(TRIALS_AT_ONCE, wanted.trials - first))]
        points = [Point({item.key: _proposed(trial, item) for item in wanted.ranges}) for trial in asked]
        jobs = jobs_of(wanted.scene, changes, points, wanted.seeds)
        runs = run_jobs(jobs, out / RUNS, manner, watcher)
        lacks = [lack_of(run) for run in runs]
        tables.append(table_of(jobs, runs).assign(failure=lacks))
        failed += [(job.point.label, lack) for job, lack in zip(jobs, lacks, strict=True) if lack]
        paths = write_table(pd.concat(tables, ignore_index=True), out / "trials")
        if any(run.failure is None for run in runs):
            refuse_unknown([wanted.least], tables[-1], "--least")
        for trial, point in zip(asked, points, strict=True):
            results = _results(tables[-1], point, wanted.least)
            if len(results) == max(1, len(wanted.seeds)):
                trials.append(Trial(point.values, results))
                study.tell(trial, trials[-1].result.mean)
            else:
                study.tell(trial, state=optuna.trial.TrialState.FAIL)
    if not trials:
        why = f"the first failure: {failed[0][1]}" if failed else f"{wanted.least} is not known in any run"
        raise RunError(f"no point has all its runs; {why}")
    trials.sort(key=lambda trial: trial.result.mean)
    best = out / "best.yaml"
    text = dump_yaml(_scene(wanted, trials[0].values, of_corners[0]))
    if wanted.overrides:
        text = f"# found with {in_every_run(wanted.overrides)}, which this file has not\n{text}"
    write_whole(best, lambda part: part.write_text(text, "utf-8"))
    return SearchResult(trials, failed, best, [*paths, best])


def _proposed(trial: optuna.Trial, item: Range) -> float:
    return float(f"{trial.suggest_float(item.key, item.low, item.high):.{DIGITS}g}")


def _results(rows: pd.DataFrame, point: Point, column: str) -> dict[int, float]:
    """The column of a point's complete runs by seed, where it is a finite number."""
    if column not in rows:
        return {}
    own = rows[(rows["failure"] == "") & rows[column].notna()]
    for key, value in point.values.items():
        own = own[own[key] == value]
    return {int(seed): float(value) for seed, value in zip(own["seed"], own[column], strict=True)}


def _scene(wanted: Search, values: Mapping[str, object], like: Job) -> Document:
    """The searched scene with these values; like: a run with others."""
    document: Document = {"base": wanted.document()["scene"], "name": like.scene.scene.name}
    for key, value in values.items():
        document = merge(document, as_fragment(like.scene.document, Override(key, value)), key)
    return document


def _refuse_unwritable(wanted: Search, first: Job) -> None:
    """Raises InputError where a scene file with the values of a run is not the scene that is run."""
    seeded = [] if first.point.seed is None else [f"{seed_key(first.scene)}={first.point.seed}"]
    written = load_scene(_scene(wanted, first.point.values, first), [*wanted.overrides, *seeded])
    if written.scene_hash != first.scene.scene_hash:
        raise InputError(
            f"--vary {', '.join(first.point.values)}: best.yaml could not hold the values, as the scene's "
            "initial_condition comes after them; search a scene with initial_condition: null"
        )
