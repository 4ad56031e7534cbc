"""Input of one simulation, the same for every code, and its result."""

import os
import re
import resource
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.soil_cases import DENSITY_KG_PER_M3, LINEAR, LINEAR_SKIN_M, LINEAR_STEP_S, RADIUS_M


@dataclass(frozen=True)
class Law:
    """Springs and dashpots of a pair, SI; walls and plates have the same."""

    stiffness: float = LINEAR["stiffness_newton_per_m"]
    tangential_stiffness: float = LINEAR["tangential_stiffness_newton_per_m"]
    damping: float = LINEAR["damping_newton_s_per_m"]
    friction: float = LINEAR["sliding_friction"]
    rolling_friction: float = LINEAR["rolling_friction"]


@dataclass(frozen=True)
class Plate:
    """A box, dragged along x at constant speed."""

    stl: Path  # [m], where it starts
    speed_m_per_s: float


@dataclass(frozen=True)
class Job:
    """Equal spheres in a box with an open top, and how long to run them."""

    positions_m: np.ndarray  # (n, 3)
    velocities_m_per_s: np.ndarray  # (n, 3)
    spins_rad_per_s: np.ndarray  # (n, 3)
    lower_m: tuple[float, float, float]
    upper_m: tuple[float, float]
    steps: int
    gravity_m_per_s2: float = 9.81
    law: Law = field(default_factory=Law)
    step_s: float = LINEAR_STEP_S
    skin_m: float = LINEAR_SKIN_M
    radius_m: float = RADIUS_M
    density_kg_per_m3: float = DENSITY_KG_PER_M3
    plate: Plate | None = None

    @property
    def mass_kg(self) -> float:
        """Of one sphere."""
        return self.density_kg_per_m3 * 4.0 / 3.0 * np.pi * self.radius_m**3


@dataclass(frozen=True)
class Result:
    """The end of a run, particles in the order of the job."""

    positions_m: np.ndarray
    velocities_m_per_s: np.ndarray
    spins_rad_per_s: np.ndarray
    cpu_s: float  # of the steps alone
    rebuild_count: int | None  # None: the code does not say
    plate_force_newton: np.ndarray | None = None  # (rows, 2): time [s], force on the plate along x


def kinetic_joule(job: Job, result: Result) -> float:
    """Kinetic energy of all spheres, turning included."""
    inertia = 0.4 * job.mass_kg * job.radius_m**2
    return 0.5 * float(
        job.mass_kg * np.sum(result.velocities_m_per_s**2) + inertia * np.sum(result.spins_rad_per_s**2)
    )


def program(name: str, variable: str) -> str | None:
    """Path of a peer's program: from an environment variable, or on the path; None where it is missing."""
    return os.environ.get(variable) or shutil.which(name)


def run_program(command: list[str], folder: Path) -> tuple[str, float]:
    """Runs a peer on one core. Returns what it printed, and its CPU time [s].

    A program in the bin folder of an environment finds libraries in the lib folder beside it (mpich).

    Raises:
        RuntimeError: it failed; the message ends as its output does.
    """
    libraries = [str(Path(command[0]).parent.parent / "lib"), os.environ.get("LD_LIBRARY_PATH", "")]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "LD_LIBRARY_PATH": ":".join(filter(None, libraries))}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, errors="replace"
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise RuntimeError(f"{command[0]} failed: ...{(done.stdout + done.stderr)[-1500:]}")
    return done.stdout, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def write_data(job: Job, path: Path) -> None:
    """The particles as a data file of LAMMPS and LIGGGHTS, atom style sphere or granular."""
    n, margin = len(job.positions_m), 5.0 * job.radius_m
    top = float(job.positions_m[:, 2].max()) + 20.0 * job.radius_m
    bounds = [
        (job.lower_m[0] - margin, job.upper_m[0] + margin),
        (job.lower_m[1] - margin, job.upper_m[1] + margin),
        (job.lower_m[2] - margin, top),
    ]
    lines = ["particles", "", f"{n} atoms", "1 atom types"]
    lines += [
        f"{float(low)!r} {float(high)!r} {axis}lo {axis}hi"
        for axis, (low, high) in zip("xyz", bounds, strict=True)
    ]
    lines += ["", "Atoms", ""]
    kind = f"1 {2.0 * job.radius_m!r} {job.density_kg_per_m3!r}"
    lines += [f"{k + 1} {kind} {_numbers(x)}" for k, x in enumerate(job.positions_m)]
    lines += ["", "Velocities", ""]
    motion = np.hstack([job.velocities_m_per_s, job.spins_rad_per_s])
    lines += [f"{k + 1} {_numbers(row)}" for k, row in enumerate(motion)]
    path.write_text("\n".join(lines) + "\n")


def _numbers(row: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in row)


DUMP = "id x y z vx vy vz omegax omegay omegaz"
"""Columns of the dump file that `read_dump` reads."""


def read_dump(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and spins of a dump with one frame, in the order of the ids."""
    lines = path.read_text().splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("ITEM: ATOMS")) + 1
    table = np.loadtxt(lines[start:], ndmin=2)
    table = table[np.argsort(table[:, 0])]
    return table[:, 1:4], table[:, 4:7], table[:, 7:10]


def rebuilds(printed: str) -> int | None:
    """Neighbour list builds that LAMMPS and LIGGGHTS report for their last run."""
    found = re.findall(r"Neighbor list builds = (\d+)", printed)
    return int(found[-1]) if found else None


def thermo_table(printed: str, columns: int) -> np.ndarray:
    """(rows, columns) numbers of the last run's thermo output."""
    rows: list[list[float]] = []
    for line in printed.splitlines():
        words = line.split()
        if words[:1] == ["Step"]:
            rows = []
        elif len(words) == columns:
            try:
                rows.append([float(word) for word in words])
            except ValueError:
                continue
    return np.array(rows)
