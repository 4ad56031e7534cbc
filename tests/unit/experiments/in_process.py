"""Runs of scenes in the process of a test, without Dask, whose use tests/system/test_sweep.py tests."""

from collections.abc import Sequence
from pathlib import Path

from subsoil_ros.api.execution import execute
from subsoil_ros.experiments.run_cache import CachedRun, find_run, keep_run
from subsoil_ros.experiments.sweep_points import Job


def run_jobs_here(jobs: Sequence[Job], cache: Path, *_: object) -> list[CachedRun]:
    """In the place of run_jobs."""
    return [
        find_run(cache, job.scene.scene_hash) or keep_run(cache, job.scene, execute(job.scene))
        for job in jobs
    ]
