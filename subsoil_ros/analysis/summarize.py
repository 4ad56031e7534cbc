"""Metrics of a finished run, from its bag."""

from pathlib import Path

import numpy as np

from ..loading.loader import ResolvedScene
from ..messages import Command, Grant, LostParticle, SoilState
from ..recording.bag_reader import BagReader
from ..recording.joined import open_record
from ..scene.scene import Scene
from ..ticks import tick_end_s
from ..yaml_document import Document
from .columns import COUPLING, SOIL, TIME
from .metrics_window import metrics_window, window_span_s
from .run_statistics import RunStatistics, run_statistics
from .series import Series, read_series
from .summary import SCHEMA_VERSION, Summary, UnrecordedSummary


def summarize(
    bag: Path,
    resolved: ResolvedScene,
    run_info: Document,
    series: Series | None = None,
    statistics: RunStatistics | None = None,
) -> Summary:
    """Metrics of a finished run.

    run_info: facts that are not in the bag: fields of summary.RunFacts.
    series, statistics: of the bag, if they are known already.

    Raises:
        InputError, RecordingError: as read_series.
    """
    scene, timing = resolved.scene, resolved.timing
    series = series if series is not None else read_series(bag, scene)
    window = metrics_window(series, scene)
    statistics = statistics if statistics is not None else run_statistics(bag, resolved, series, window)
    start_s, end_s = window_span_s(series, window)
    simulated_s = float(series[TIME][-1])
    tick_count = round(simulated_s / timing.communication_step_s)
    wall_s = series.wall_time_s  # of the ticks alone: without start-up and compilation
    columns = statistics.column_metrics()
    return Summary.model_validate(
        {
            **_heading(resolved),
            "run": {
                "id": series.run_id,
                **run_info,
                "recorded": True,
                "complete": tick_count == timing.tick_count or _ended_early(bag, scene),
                "simulated_s": simulated_s,
                "ticks": tick_count,
                "steps": tick_count * (timing.soil_steps or timing.mechanism_steps),
                "wall_s": wall_s,
                "real_time_factor": simulated_s / wall_s if wall_s > 0.0 else 0.0,
            },
            "particles": _particles(series, bag, timing.communication_step_ns),
            "energy": {
                "residual_joule": float(series[COUPLING.residual_joule][-1]),
                "residual_ratio": float(series[COUPLING.residual_ratio][-1]),
            },
            "window": {
                "rule": window.rule,
                "whole_run": window.whole_run,
                "start_s": start_s,
                "end_s": end_s,
                "rows": int(window.rows.sum()),
            },
            "series": {
                name: _of_column(values, window.rows, columns.get(name, {}))
                for name, values in series.columns.items()
                if name != TIME
            },
            **statistics.metrics(),
        },
        from_attributes=True,
    )


def _ended_early(bag: Path, scene: Scene) -> bool:
    """Whether a run with stop_when has its END, which the last grant of the record carries."""
    if scene.stop_when is None:
        return False
    end_ns = BagReader(bag).end_time_ns
    grants = BagReader(bag).records(Grant, at=lambda time_ns: time_ns == end_ns)
    return any(grant.command is Command.END for grant in grants)


def summarize_unrecorded(resolved: ResolvedScene, run_info: Document) -> UnrecordedSummary:
    """Summary of a run without a bag: what is known without its record."""
    run = {**run_info, "recorded": False, "complete": "failure" not in run_info}
    return UnrecordedSummary.model_validate({**_heading(resolved), "run": run})


def _heading(resolved: ResolvedScene) -> Document:
    scene = resolved.scene
    return {
        "schema_version": SCHEMA_VERSION,
        "scene": {
            "name": scene.name,
            "hash": resolved.scene_hash,
            "allow": list(scene.allow),
            "note": scene.report.note,
        },
    }


def _particles(series: Series, bag: Path, communication_step_ns: int) -> Document:
    """Numbers of particles present and lost; the first row with a lost one, and their identities."""
    if SOIL.lost_particle_count not in series:
        return {"count": 0, "lost_count": 0, "first_lost_s": None, "first_lost": []}
    lost = series[SOIL.lost_particle_count]
    first = float(series[TIME][np.argmax(lost > 0)]) if lost[-1] > 0 else None
    named: tuple[LostParticle, ...] = ()
    if first is not None:
        last_ns = round(1e9 * float(series[TIME][-1]))
        for state in open_record(bag).records(SoilState, at=lambda time_ns: time_ns == last_ns):
            named = state.lost_particles
    return {
        "count": int(series[SOIL.particle_count][-1]),
        "lost_count": int(lost[-1]),
        "first_lost_s": first,
        "first_lost": [
            {
                "identity": item.identity,
                "position_m": [item.x_m, item.y_m, item.z_m],
                "time_s": tick_end_s(item.tick, communication_step_ns),
            }
            for item in named
        ],
    }


def _of_column(values: np.ndarray, rows: np.ndarray, more: Document) -> Document:
    """Statistics of a column (n,) over the window, `rows`, and under `run` over all of it."""
    run = {**_statistics(values), **more.get("run", {})}
    return {**_statistics(values[rows]), **more, "run": run}


def _statistics(values: np.ndarray) -> Document:
    return {
        "mean": float(np.mean(values)),
        "min": values.min().item(),
        "max": values.max().item(),
        "std": float(np.std(values)),
    }
