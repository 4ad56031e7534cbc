"""A stirred grid of spheres here and in LAMMPS with KOKKOS, on one GPU: `python -m benchmarks.gpu peer`."""

import dataclasses
import re
import statistics
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchmarks.gpu_drive import STEPS_PER_TICK, Drive, on_gpu, periodic, ticks_of
from benchmarks.soil_cases import RADIUS_M, linear_case, stirred_velocities
from subsoil_ros.dem.build import build_engine

DECK = Path(__file__).parent / "gran_hooke.in"


def peer(folder: Path, sides: list[int], lammps: Path | None, repeats: int) -> Iterable[dict[str, Any]]:
    """The same soil here and there; the box of LAMMPS is periodic on all sides, ours in y."""
    for side in sides:
        steps = 2000 if side < 80 else 500
        walls = [_ours(side, steps) for _ in range(repeats)]
        yield _peer_row("subsoil_ros", side, steps, walls)
        if lammps is not None:
            yield _peer_row(
                "LAMMPS KOKKOS", side, steps, [_theirs(folder, lammps, side, steps) for _ in range(repeats)]
            )


def _peer_row(program: str, side: int, steps: int, walls: list[float]) -> dict[str, Any]:
    wall = statistics.median(walls)
    return {
        "program": program,
        "particles": side**3,
        "steps": steps,
        "us_per_step": 1e6 * wall / steps,
        "particle_steps_per_s": side**3 * steps / wall,
    }


def _ours(side: int, steps: int) -> float:
    """Wall time of so many steps after 200."""
    edge = 2.0 * RADIUS_M * side
    case = linear_case({"kind": "grid", "spacing_m": 2.0 * RADIUS_M}, (edge, edge, edge), 1, "peer")
    scene = case.resolved.scene
    assert scene.particle_soil is not None
    law = scene.particle_soil.law
    row = law.particle.model_copy(update={"rolling_friction": 0.0})
    soil = scene.particle_soil.model_copy(
        update={"law": law.model_copy(update={"particle": row, "boundary": row, "combining_rule": "none"})}
    )
    still = scene.model_copy(update={"soil": soil, "gravity_m_per_s2": 0.0})
    case = dataclasses.replace(case, resolved=dataclasses.replace(case.resolved, scene=still))
    case = ticks_of(periodic(case, edge), STEPS_PER_TICK)
    engine = build_engine(on_gpu(case.resolved))
    assert engine.particle_count == side**3
    engine.place(engine.bed.positions_m, stirred_velocities(side**3))
    engine.start(())
    drive = Drive(engine, case)
    drive.run(200 // STEPS_PER_TICK)
    return drive.run(steps // STEPS_PER_TICK)


def _theirs(folder: Path, lammps: Path, side: int, steps: int) -> float:
    log = folder / "log.lammps"
    on_gpu = ["-k", "on", "g", "1", "-sf", "kk", "-pk", "kokkos", "neigh", "half", "newton", "off"]
    variables = ["-var", "side", str(side), "-var", "steps", str(steps)]
    subprocess.run(
        [lammps, *on_gpu, "-in", DECK, *variables, "-log", log, "-screen", "none"], check=True, cwd=folder
    )
    times = re.findall(r"^Loop time of (\S+)", log.read_text(encoding="utf-8"), re.MULTILINE)
    return float(times[-1])
