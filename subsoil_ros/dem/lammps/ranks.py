"""All ranks of a soil, led by rank 0: it says what to do, and every rank does the same.

    mpiexec -n 1 PROGRAM : -n 3 python -m subsoil_ros.dem.lammps.ranks

starts a program whose process is rank 0, and three ranks that wait for its calls.
"""

import atexit
import functools
import os
import sys
import time
import traceback
from contextlib import suppress
from typing import Any

from ...errors import InputError, PhysicsError, RunError
from ..kernel_calls import use_threads
from .rank_soil import RankSoil

_END = "end"

_REST_S = 1e-4
"""Between two looks for a call: waiting in MPI would occupy the core."""


class Ranks:
    """The leading side.

    Raises:
        InputError: ranks run different versions.
    """

    def __init__(self) -> None:
        self.comm = _world()
        self.soil = RankSoil(self.comm)
        self._waits, self._closed = True, False  # whether the other ranks wait for a call
        atexit.register(self.close)
        found = self.call("versions")
        other = next((rank for rank, version in enumerate(found) if version != found[0]), 0)
        if other:
            raise InputError(
                f"ranks: rank 0 has {found[0]}, rank {other} has {found[other]}; all need the same: give "
                "every host of the run one environment"
            )

    def call(self, name: str, *arguments: Any, here: Any = None) -> Any:
        """Let every rank call a method of its RankSoil; `here` is one argument more that only rank 0 has."""
        extra = () if here is None else (here,)
        for rank in range(1, self.comm.size):
            self.comm.send((name, arguments + tuple(None for _ in extra)), dest=rank)
        self._waits = False
        try:
            found = getattr(self.soil, name)(*arguments, *extra)
        except (PhysicsError, RunError):  # on every rank
            self._waits = True
            raise
        self._waits = True
        return found

    def close(self) -> None:
        """Let the other ranks end; none may be called any more."""
        if not self._closed and self.comm.size > 1:
            from mpi4py import MPI

            self._closed = True
            if not self._waits:  # an error here alone: the others still wait for this rank's part
                self.comm.Abort(RunError.exit_status)
            for rank in range(1, self.comm.size):
                self.comm.send((_END, ()), dest=rank)
            MPI.Finalize()


@functools.cache
def _shared() -> Ranks:
    return Ranks()


def leader() -> Ranks:
    """The leading side: of several ranks always the same, alone a new one, with a soil of its own."""
    return _shared() if _world().size > 1 else Ranks()


def refuse_other_count(ranks: int) -> None:
    """Check that this program was started as one of so many ranks.

    Raises:
        InputError: it was not.
    """
    size = _world().size
    if size != ranks:
        raise InputError(
            f"ranks: given {ranks}, but this process is one of {size}; start it by subsoil run, with the "
            "mpiexec of the MPI that mpi4py uses (an MPICH)"
        )


def _world() -> Any:
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    from mpi4py import MPI

    return MPI.COMM_WORLD


def follow() -> None:
    """Do what rank 0 says until the program ends."""
    comm = _world()
    use_threads(1)
    soil = RankSoil(comm)
    while True:
        while not comm.Iprobe(source=0):
            time.sleep(_REST_S)
        name, arguments = comm.recv(source=0)
        if name == _END:
            return
        with suppress(PhysicsError, RunError):  # which rank 0 met too
            getattr(soil, name)(*arguments)


if __name__ == "__main__":
    try:
        follow()
    except Exception:
        traceback.print_exc()
        sys.stderr.flush()
        _world().Abort(1)
