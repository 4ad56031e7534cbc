"""Driver of a soil on a GPU for benchmarks: the engine, ticks of several steps, wall time."""

import dataclasses
import time

from benchmarks.soil_cases import Case
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.loading.loader import ResolvedScene

STEPS_PER_TICK = 10


def on_gpu(resolved: ResolvedScene) -> ResolvedScene:
    """A scene whose soil is computed on the GPU."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    there = soil.model_copy(update={"device": "gpu"})
    return dataclasses.replace(resolved, scene=resolved.scene.model_copy(update={"soil": there}))


def periodic(case: Case, width_m: float) -> Case:
    """A case between periodic sides so far apart."""
    soil = case.resolved.scene.particle_soil
    assert soil is not None
    wider = soil.bin.model_copy(update={"width_m": width_m, "sides": "periodic"})
    scene = case.resolved.scene.model_copy(update={"soil": soil.model_copy(update={"bin": wider})})
    return dataclasses.replace(case, resolved=dataclasses.replace(case.resolved, scene=scene))


def ticks_of(case: Case, soil_steps: int) -> Case:
    """A case whose ticks have so many soil steps."""
    timing = case.resolved.timing
    longer = Timing(
        timing.communication_step_ns * soil_steps, tick_count=10**9, soil_steps=soil_steps, mechanism_steps=0
    )
    return dataclasses.replace(case, resolved=dataclasses.replace(case.resolved, timing=longer))


class Drive:
    """Goes on with a case."""

    def __init__(self, engine: SoilEngine, case: Case) -> None:
        self._engine, self._case, self._tick = engine, case, 0

    def run(self, ticks: int) -> float:
        """Wall time of so many ticks [s]."""
        start = time.perf_counter()
        for _ in range(ticks):
            self._engine.advance(self._tick, self._case.motions(self._tick + 1))
            self._tick += 1
        return time.perf_counter() - start
