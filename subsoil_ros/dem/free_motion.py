"""What a bed does when it is left alone."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from ..loading.loader import ResolvedScene
from .bed import Bed
from .build import build_engine
from .engine import SoilEngine


@dataclass(frozen=True)
class FreeMotion:
    """Motion of a bed that is left alone under the full law."""

    duration_s: float
    kinetic_energy_joule: float
    rms_move_m: float
    max_move_m: float


def free_motion(resolved: ResolvedScene, bed: Bed, threads: int, duration_s: float) -> FreeMotion:
    """Runs the bed without tools for `duration_s` at the scene's step."""
    scene = resolved.scene.model_copy(update={"mechanism": None, "tools": {}})
    alone, soil = dataclasses.replace(resolved, scene=scene), scene.particle_soil
    fixed = soil is None or soil.window is None
    engine = SoilEngine(alone, bed, threads) if fixed else build_engine(alone, threads)
    engine.start(())
    before = engine.positions_m()
    ticks = max(1, round(duration_s / resolved.timing.communication_step_s))
    for tick in range(ticks):
        engine.advance(tick, ())
    moved = np.linalg.norm(engine.positions_m() - before, axis=1)
    return FreeMotion(
        duration_s=ticks * resolved.timing.communication_step_s,
        kinetic_energy_joule=engine.state("", ticks - 1, 0).kinetic_energy_joule,
        rms_move_m=float(np.sqrt((moved**2).mean())),
        max_move_m=float(moved.max()),
    )
