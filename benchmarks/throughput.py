"""Throughput of one case: the same run several times over, CPU and wall time of its steps."""

import dataclasses
import hashlib
import statistics
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.scene_phases import clocked
from benchmarks.soil_cases import Case, stirred_velocities
from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.build import prepare_bed
from subsoil_ros.dem.engine import SoilEngine


@dataclass(frozen=True)
class Throughput:
    """One line of the table; steps are those of one repeat."""

    name: str
    bed_hash: str
    particle_count: int
    listed_pairs_per_particle: float
    contacts_per_particle: float  # between particles, each counted once
    skin_m: float
    rebuild_count: int  # in the timed steps
    steps: int
    threads: int
    precision: str
    repeats: int
    particle_steps_per_cpu_s: float  # median
    particle_steps_per_cpu_s_min: float
    particle_steps_per_cpu_s_max: float
    particle_steps_per_wall_s: float  # median
    bytes_per_particle: float  # of the engine's arrays after the run


def bed_hash(bed: Bed) -> str:
    """sha256 hex, 12 digits, of positions and walls."""
    content = bed.positions_m.tobytes() + np.array([*bed.lower_m, *bed.upper_m]).tobytes()
    return hashlib.sha256(content).hexdigest()[:12]


def prepared_engine(case: Case, bed: Bed, threads: int) -> SoilEngine:
    """The engine of a case before its first step."""
    engine = SoilEngine(case.resolved, bed, threads)
    if case.stirred:
        engine.place(bed.positions_m, stirred_velocities(len(bed.positions_m)))
    engine.start(case.motions(0))
    return engine


def run_steps(engine: SoilEngine, case: Case, steps: int) -> None:
    """The first steps of a case."""
    for step in range(steps):
        engine.advance(step, case.motions(step + 1))


def measure(case: Case, threads: int, repeats: int, bed: Bed | None = None) -> Throughput:
    """Run a case `repeats` times from its start, after a few steps that only compile."""
    bed = bed or prepare_bed(case.resolved, threads)
    run_steps(prepared_engine(case, bed, threads), case, 3)
    cpu_s, wall_s = [], []
    for _ in range(repeats):
        engine = prepared_engine(case, bed, threads)
        rebuilds = engine.state("", 0, 0).rebuild_count
        cpu, wall = time.process_time(), time.perf_counter()
        run_steps(engine, case, case.steps)
        cpu_s.append(time.process_time() - cpu)
        wall_s.append(time.perf_counter() - wall)
    state = engine.state("", 0, 0)
    work = state.particle_count * case.steps
    return Throughput(
        name=case.name,
        bed_hash=bed_hash(bed),
        particle_count=state.particle_count,
        listed_pairs_per_particle=engine.listed_pair_count / state.particle_count,
        contacts_per_particle=state.contact_count / state.particle_count,
        skin_m=case.skin_m,
        rebuild_count=state.rebuild_count - rebuilds,
        steps=case.steps,
        threads=threads,
        precision=case.precision,
        repeats=repeats,
        particle_steps_per_cpu_s=work / statistics.median(cpu_s),
        particle_steps_per_cpu_s_min=work / max(cpu_s),
        particle_steps_per_cpu_s_max=work / min(cpu_s),
        particle_steps_per_wall_s=work / statistics.median(wall_s),
        bytes_per_particle=array_bytes(engine) / state.particle_count,
    )


def phase_parts(case: Case, bed: Bed) -> dict[str, float]:
    """Part of the CPU time of the case's steps in each phase, and in `other`; one thread, sum 1."""
    engine = prepared_engine(case, bed, 1)
    with clocked() as spent:
        start = time.process_time()
        run_steps(engine, case, case.steps)
        whole = time.process_time() - start
    parts = {phase: seconds / whole for phase, seconds in spent.items()}
    return {**parts, "other": 1.0 - sum(parts.values())}


def array_bytes(root: object) -> int:
    """Bytes of all arrays that an object holds, itself or through dataclasses, tuples and plain objects."""
    seen: dict[int, int] = {}
    _gather(root, seen, set())
    return sum(seen.values())


def _gather(value: Any, arrays: dict[int, int], visited: set[int]) -> None:
    if isinstance(value, np.ndarray):
        owner = value
        while isinstance(owner.base, np.ndarray):
            owner = owner.base
        arrays[id(owner)] = owner.nbytes
        return
    if id(value) in visited:
        return
    visited.add(id(value))
    for part in _parts(value):
        _gather(part, arrays, visited)


def _parts(value: Any) -> Iterable[Any]:
    if isinstance(value, (tuple, list)):
        return value
    if isinstance(value, dict):
        return value.values()
    if dataclasses.is_dataclass(value) or type(value).__module__.startswith("subsoil_ros.dem"):
        return getattr(value, "__dict__", {}).values()
    return ()
