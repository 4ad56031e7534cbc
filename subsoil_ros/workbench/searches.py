"""Searches of a project in searches/NAME: what `subsoil optimise` is asked for, and what it has found."""

import csv
import math
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..analysis.intervals import Interval, mean_interval
from ..errors import InputError
from ..loading.fragments import with_base
from ..yaml_document import dump_yaml, leaves, merge, read_document
from . import jobs
from .project import Project, checked

GOALS = ("series.draft_newton.mean", "loads.specific.draft_pa")
"""Columns of trials.csv: mean draft, and draft per loosened section."""

_OFTEN = re.compile(r"tools\.[^.]+\.(depth_m|speed_m_per_s|blade\.(rake_deg|width_m))")


@dataclass(frozen=True)
class Point:
    """Values of the keys, the goal by seed, and why it has no result."""

    values: tuple[float, ...]
    by_seed: dict[str, float]
    lack: str

    @property
    def result(self) -> Interval:
        """The goal over the seeds."""
        return mean_interval(list(self.by_seed.values()))

    def words(self) -> list[str]:
        """The values and the result, or why there is none."""
        return [*(f"{value:g}" for value in self.values), self.lack or self.result.text(".4g")]


@dataclass(frozen=True)
class Found:
    """Keys, goal and points of a search, the least first, those without a result last."""

    keys: tuple[str, ...]
    goal: str
    points: tuple[Point, ...]


def folder_of(project: Project, name: str) -> Path:
    """The folder of a search. Raises InputError for a name that is none."""
    return project.folder / "searches" / checked(name)


def ask_for(
    project: Project, name: str, scene: str, ranges: Sequence[tuple[str, object, object]], **options: object
) -> None:
    """Put a search into the queue; ranges: key, least, largest; options: of the command, empty ones left out.

    Raises:
        InputError: a name cannot be used, or there is such a job or search.
        OSError: the scene cannot be read, or the disk is full.
    """
    folder = folder_of(project, name)
    if folder.exists():
        raise InputError(f"{name}: there is a search of this name; choose another")
    words = ["optimise", *jobs.keep_scene(project, name, scene), "--workers", "1", "--out", str(folder)]
    for key, low, high in ranges:
        words += ["--vary", f"{key}={low},{high}"]
    for option, value in options.items():
        words += [f"--{option}", str(value)] if value else []
    jobs.put(project, name, words, folder / "best.yaml", kind=jobs.SEARCH, scene=scene)


def suggested(project: Project, scene: str) -> tuple[str, ...]:
    """Keys of a scene that are often varied; none of a scene that cannot be read."""
    with suppress(InputError, OSError):
        file = project.scene_file(scene)
        return _suggested(file, file.stat().st_mtime_ns)
    return ()


@lru_cache(maxsize=64)
def _suggested(scene: Path, _: int) -> tuple[str, ...]:
    """The second argument tells versions of the file apart, here and below."""
    values = dict(leaves(with_base(scene, scene.name, ())))
    springs = {
        f"{key[:-4]}stiffness_newton_per_m" for key, value in values.items() if value == "spring_damper"
    }
    return tuple(key for key in values if _OFTEN.fullmatch(key) or key in springs)


def found(project: Project, name: str) -> Found:
    """What a search has found so far; nothing where there is none."""
    with suppress(InputError, OSError, KeyError, TypeError):
        table = folder_of(project, name) / "trials.csv"
        return _found(table, table.stat().st_mtime_ns)
    return Found((), "", ())


@lru_cache(maxsize=64)
def _found(table: Path, _: int) -> Found:
    request: Any = read_document(table.parent / "optimise.yaml", "optimise.yaml")
    keys, goal, count = tuple(request["ranges"]), request["least"], max(1, len(request["seeds"]))
    by_seed: dict[tuple[float, ...], dict[str, float]] = {}
    lacks: dict[tuple[float, ...], str] = {}
    for row in _rows(table):
        values = tuple(_number(row.get(key)) for key in keys)
        if not all(map(math.isfinite, values)):
            continue
        results, result = by_seed.setdefault(values, {}), _number(row.get(goal))
        if row.get("failure") or not math.isfinite(result):
            lacks[values] = row.get("failure") or f"{goal} is not known"
        else:
            results[str(row.get("seed"))] = result
    points = [
        Point(values, results, lacks.get(values, "" if len(results) >= count else "a run is missing"))
        for values, results in by_seed.items()
    ]
    points.sort(key=lambda point: (bool(point.lack), point.result.mean))
    return Found(keys, goal, tuple(points))


def _rows(table: Path) -> list[dict[str, str]]:
    """The rows of a table, up to one that cannot be read."""
    rows: list[dict[str, str]] = []
    with table.open(newline="", encoding="utf-8", errors="replace") as stream, suppress(csv.Error):
        for row in csv.DictReader(stream):
            rows.append(row)
    return rows


def _number(text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError:
        return math.nan


def best_scene(project: Project, name: str) -> str:
    """The text of the scene that was searched, with the best values; it has no comments.

    Raises:
        InputError: one of the files cannot be read.
    """
    best = read_document(folder_of(project, name) / "best.yaml", "best.yaml")
    base = project.folder / Path(str(best.pop("base", ""))).name
    scene = read_document(base, base.name)
    if isinstance(scene.get("soil"), str) and "soil" in best:
        scene["soil"] = {"material": scene["soil"]}
    return dump_yaml(merge(scene, best, base.name))
