"""A node whose process is the first rank of several under MPI."""

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from ...errors import InputError


def mpiexec() -> str:
    """The program that starts ranks: of this environment, or on the path.

    Raises:
        InputError: there is none.
    """
    found = shutil.which("mpiexec", path=str(Path(sys.executable).parent)) or shutil.which("mpiexec")
    if found is None:
        raise InputError(
            "--ranks: needs mpiexec, which is neither beside this Python nor on the path; install it by "
            "pip install 'subsoil_ros[cluster]', load the MPICH of your cluster, or use --ranks 1"
        )
    return found


def under_mpi(command: Sequence[str], ranks: int) -> list[str]:
    """The command of a program that is rank 0 of `ranks`; the others wait for it (dem.lammps.ranks)."""
    others = [sys.executable, "-m", "subsoil_ros.dem.lammps.ranks"]
    return [mpiexec(), "-n", "1", *command, ":", "-n", str(ranks - 1), *others]
