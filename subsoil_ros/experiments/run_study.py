"""A study: what each factor of a scene costs and gains, measured against a reference run on several beds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from ..errors import InputError, RunError
from ..whole_files import write_whole
from ..yaml_document import dump_yaml
from .run_cache import CachedRun, lack_of
from .run_jobs import ExecutionOptions, Watcher, run_jobs
from .run_metrics import half_widths_of, metrics_of
from .run_sweep import RUNS, failed_of, open_folder, table_of, write_table
from .study_design import REFERENCE, StudyDesign
from .study_errors import Measurement, judge
from .study_tables import draw, expected_presets, markdown, wide_table
from .sweep_points import Job, Point, jobs_of

REQUEST = "study.yaml"


@dataclass(frozen=True)
class StudyOutcome:
    """What a study left in its folder."""

    text: str  # the table, as Markdown
    failed: list[tuple[str, str]]
    paths: list[Path]


def study_jobs(scene: str, common: Sequence[str], design: StudyDesign) -> tuple[Job, ...]:
    """Every run of a study: all presets with the first seed, with the next, then the references.

    Speed-ups are ratios on the same seed, so these runs stand near each other: a machine drifts by a tenth
    within an hour. Raises as jobs_of.

    common: KEY=VALUE of the command line, over those of the design.
    """
    points = [preset.point for preset in design.all_presets()]
    jobs: tuple[Job, ...] = ()
    for seed in design.seeds:
        jobs += jobs_of(scene, [*design.overrides, *common], points, (seed,))
    for name, reference in design.additional_references.items():
        point = Point({}, name=name, overrides=reference.overrides)
        jobs += jobs_of(scene, [*design.overrides, *common], (point,), reference.seeds)
    return jobs


def run_study(
    scene: str,
    common: Sequence[str],
    design: StudyDesign,
    out: Path,
    manner: ExecutionOptions,
    watcher: Watcher,
) -> StudyOutcome:
    """Runs what has not been run; writes study.csv, .parquet, .md, .png, runs.csv, .parquet, expected.yaml.

    Raises:
        InputError: the scene, a preset of it or the folder cannot be used; nothing was run.
        RunError: the reference run failed with every seed, so there is nothing to measure against.
    """
    jobs = study_jobs(scene, common, design)
    if any(job.scene.scene.stop_when is not None for job in jobs):
        raise InputError(
            f"{scene}: has stop_when, and runs of unequal length have unequal times; add stop_when=null to "
            "the overrides of the design"
        )
    open_folder(out, REQUEST)
    request = {"scene": str(Path(scene).resolve()), "set": list(common), **design.model_dump(mode="json")}
    write_whole(out / REQUEST, lambda part: part.write_text(dump_yaml(request), encoding="utf-8"))
    runs = run_jobs(jobs, out / RUNS, manner, watcher)
    measured = _measured(jobs, runs, by_record=design.intervals == "records")
    judged = judge(design, measured, _failures(jobs, runs))
    write_table(table_of(jobs, runs), out / "runs")
    if judged[0].wall_s is None:
        message = judged[0].failures[0] if judged[0].failures else "it has no series"
        raise RunError(
            f"{REFERENCE}: failed with every seed, so nothing can be measured against it: {message}"
        )
    paths = [*write_table(pd.DataFrame(wide_table(judged, design)), out / "study"), out / "study.md"]
    text = markdown(judged, design, measured)
    write_whole(out / "study.md", lambda part: part.write_text(text, encoding="utf-8"))
    facts = next(run.facts for job, run in zip(jobs, runs, strict=True) if job.point.name == REFERENCE)
    expected = expected_presets(judged, design, facts, jobs[0].scene.scene.duration_s, scene)
    if expected:
        paths.append(out / "expected.yaml")
        write_whole(paths[-1], lambda part: part.write_text(dump_yaml(expected), encoding="utf-8"))
    paths.append(draw(judged, design, jobs[0].scene.scene.name, out / "study.png"))
    return StudyOutcome(text, failed_of(jobs, runs), [*paths, out / "runs.csv", out / "runs.parquet"])


def _measured(jobs: Sequence[Job], runs: Sequence[CachedRun], *, by_record: bool) -> list[Measurement]:
    found = []
    for job, run in zip(jobs, runs, strict=True):
        wall_s, cpu_s = run.facts["wall_s"], run.facts["cpu_s"]
        if not lack_of(run) and wall_s and cpu_s is not None and job.point.seed is not None:
            metrics = metrics_of(run)
            widths = half_widths_of(run, metrics) if by_record else {}
            found.append(Measurement(job.point.name, job.point.seed, wall_s, cpu_s, metrics, widths))
    return found


def _failures(jobs: Sequence[Job], runs: Sequence[CachedRun]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for job, run in zip(jobs, runs, strict=True):
        if lack := lack_of(run):
            found.setdefault(job.point.name, []).append(lack)
    return found
