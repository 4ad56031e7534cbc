"""The engine of this project, run with the job of the peers."""

import dataclasses
import time
from pathlib import Path

import numpy as np

from benchmarks.soil_cases import linear_case
from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.messages import ToolMotion
from subsoil_ros.scene.tools import Tool

from .job import Job, Law, Result

NAME = "subsoil_ros"
_PLATE_EVERY = 50  # steps between two samples of the plate's force, as in the peers


def find() -> str:
    """Always there."""
    return NAME


def run(job: Job, engine_name: str = "own") -> Result:
    """Runs a job on one thread; a few steps before it compile the kernels. engine_name: soil.engine."""
    bed = Bed(job.positions_m, job.lower_m, job.upper_m)
    resolved = _resolved(job, engine_name)
    _steps(_engine(job, bed, resolved), job, min(3, job.steps))
    engine = _engine(job, bed, resolved)
    before = engine.state("", 0, 0).rebuild_count
    start = time.process_time()
    force = _steps(engine, job, job.steps)
    cpu_s = time.process_time() - start
    return Result(
        engine.positions_m(),
        engine.velocities_m_per_s(),
        engine.angular_velocities_rad_per_s(),
        cpu_s,
        engine.state("", 0, 0).rebuild_count - before,
        force if job.plate else None,
    )


def _resolved(job: Job, engine_name: str) -> ResolvedScene:
    """The scene of a job; its step stands as given, whatever our own limits say."""
    any_size = (1.0, 1.0, 1.0)  # the walls are those of the bed
    case = linear_case({"kind": "grid", "spacing_m": "rest"}, any_size, job.steps, "job")
    soil = case.resolved.scene.particle_soil
    assert soil is not None
    row = soil.law.particle.model_copy(update=_row(job.law))
    tools = {}
    if job.plate is not None:
        document = {"path": {}, "groups": {"plate": {"mesh": str(job.plate.stl)}}}
        tools = {"plate": Tool.model_validate(document)}
    soil = soil.model_copy(
        update={
            "law": soil.law.model_copy(update={"particle": row, "boundary": row}),
            "engine": engine_name,
            "skin_m": job.skin_m,
            "particles": soil.particles.model_copy(
                update={"radius_m": job.radius_m, "density_kg_per_m3": job.density_kg_per_m3}
            ),
        }
    )
    scene = case.resolved.scene.model_copy(
        update={"soil": soil, "tools": tools, "gravity_m_per_s2": job.gravity_m_per_s2}
    )
    timing = Timing(round(job.step_s * 1e9), tick_count=1, soil_steps=1, mechanism_steps=0)
    return dataclasses.replace(case.resolved, scene=scene, timing=timing, directory=Path())


def _row(law: Law) -> dict[str, float]:
    return {
        "stiffness_newton_per_m": law.stiffness,
        "tangential_stiffness_newton_per_m": law.tangential_stiffness,
        "damping_newton_s_per_m": law.damping,
        "static_friction": law.friction,
        "sliding_friction": law.friction,
        "rolling_friction": law.rolling_friction,
    }


def _engine(job: Job, bed: Bed, resolved: ResolvedScene) -> SoilEngine:
    engine = SoilEngine(resolved, bed, 1)
    engine.place(job.positions_m, job.velocities_m_per_s, job.spins_rad_per_s)
    engine.start(_motions(job, 0))
    return engine


def _motions(job: Job, step: int) -> tuple[ToolMotion, ...]:
    if job.plate is None:
        return ()
    speed = job.plate.speed_m_per_s
    return (ToolMotion("plate", speed * step * job.step_s, 0.0, 0.0, 0.0, speed, 0.0, 0.0),)


def _steps(engine: SoilEngine, job: Job, steps: int) -> np.ndarray:
    """Runs from the start; (rows, 2) time [s] and force on the plate along x [N]."""
    rows = []
    for step in range(1, steps + 1):
        wrenches = engine.advance(step, _motions(job, step))
        if job.plate is not None and step % _PLATE_EVERY == 0:
            rows.append((step * job.step_s, wrenches[0].force_x_newton))
    return np.array(rows)
