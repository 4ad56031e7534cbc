"""LIGGGHTS 3.8 (Debian package `liggghts`): hooke/stiffness, tangential history, epsd2 rolling."""

import tempfile
from pathlib import Path

import numpy as np

from .job import DUMP, Job, Result, program, read_dump, rebuilds, run_program, thermo_table, write_data

NAME = "LIGGGHTS"
_PLATE_EVERY = 50  # steps between two prints of the plate's force


def find() -> str | None:
    """The program; None where it is missing."""
    return program("liggghts", "SUBSOIL_LIGGGHTS")


def run(job: Job) -> Result:
    """Runs a job; CPU time is that of the process less that of one without steps."""
    path = find()
    assert path is not None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_data(job, folder / "particles.data")
        cpu = {}
        for steps in (0, job.steps):
            (folder / "in.txt").write_text(_input(job, steps))
            printed, cpu[steps] = run_program([path, "-in", "in.txt", "-log", "none"], folder)
        position, velocity, spin = read_dump(folder / "end.dump")
    force = None
    if job.plate is not None:
        table = thermo_table(printed, 2)
        force = np.column_stack([table[:, 0] * job.step_s, table[:, 1]])
    return Result(position, velocity, spin, cpu[job.steps] - cpu[0], rebuilds(printed), force)


def _input(job: Job, steps: int) -> str:
    law = job.law
    model = "model hooke/stiffness tangential history rolling_friction epsd2"
    settings = "absolute_damping on tangential_damping off limitForce off"  # at the very end
    pair = {
        "kn": law.stiffness,
        "kt": law.tangential_stiffness,
        "gamman_abs": law.damping,
        "gammat_abs": 0.0,
        "coefficientFriction": law.friction,
        "coefficientRollingFriction": law.rolling_friction,
    }
    (x0, y0, z0), (x1, y1) = job.lower_m, job.upper_m
    planes = {"xplane": (x0, x1), "yplane": (y0, y1), "zplane": (z0,)}
    lines = [
        "atom_style granular", "atom_modify map array sort 100 0", "boundary f f f", "newton off",
        "communicate single vel yes", "units si", "read_data particles.data",
        f"neighbor {job.skin_m!r} bin", "neigh_modify every 1 delay 0 check yes",
        *(f"fix {k} all property/global {k} peratomtypepair 1 {v!r}" for k, v in pair.items()),
        f"pair_style gran {model} {settings}", "pair_coeff * *",
        f"fix weight all gravity {job.gravity_m_per_s2!r} vector 0.0 0.0 -1.0",
    ]  # fmt: skip
    for axis, places in planes.items():
        for k, place in enumerate(places):
            lines.append(f"fix {axis}{k} all wall/gran {model} primitive type 1 {axis} {place!r} {settings}")
    lines += [f"timestep {job.step_s!r}", "thermo_style custom step atoms", f"thermo {max(steps, 1)}"]
    if job.plate is not None:
        lines += [
            "fix youngs all property/global youngsModulus peratomtype 1e7",
            "fix poisson all property/global poissonsRatio peratomtype 0.3",
            f"fix plate all mesh/surface/stress file {job.plate.stl} type 1",
            f"fix touch all wall/gran {model} mesh n_meshes 1 meshes plate {settings}",
            f"fix drag all move/mesh mesh plate linear {job.plate.speed_m_per_s!r} 0.0 0.0",
            "thermo_style custom step f_plate[1]", f"thermo {_PLATE_EVERY}",
        ]  # fmt: skip
    lines += [
        "thermo_modify lost error norm no", "fix move all nve/sphere", f"run {steps}",
        f"write_dump all custom end.dump {DUMP} modify sort id format \"%d" + 9 * " %.17g" + '"',
    ]  # fmt: skip
    return "\n".join(lines) + "\n"
