"""Calls of kernels whose arguments are the same objects from step to step, and numba's number of threads."""

import os
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import numba

from ..errors import InputError

_of_thread = threading.local()
_forked_from: list[int] = []  # process whose threads this one lacks


def _note_fork() -> None:
    try:
        numba.threading_layer()
    except ValueError:  # no thread of a kernel was started yet
        return
    _forked_from.append(os.getppid())


os.register_at_fork(after_in_child=_note_fork)


class KernelCalls:
    """Kernels that are always called with arguments of the same types.

    A plain call determines the types of some sixty numbers and arrays: 20 us if the particles fill the cache.
    """

    def __init__(self) -> None:
        self._compiled: dict[Any, Callable[..., Any]] = {}

    def bind(self, kernel: Any, *arguments: Any, varying: tuple[Any, ...] = ()) -> Callable[..., Any]:
        """`kernel` with these first arguments; a call gives the others, of the types of those in `varying`.

        The first call for a kernel fixes the types.
        """
        if numba.config.DISABLE_JIT:  # as beside numba's simulator of a GPU
            return partial(kernel, *arguments)
        if kernel not in self._compiled:
            types = tuple(numba.typeof(argument) for argument in (*arguments, *varying))
            self._compiled[kernel] = kernel.compile(types)
        return partial(self._compiled[kernel], *arguments)


def refuse_fork() -> None:
    """Raise InputError if this process was forked from one that has run kernels: OpenMP would end it."""
    if _forked_from:
        raise InputError(
            f"process {os.getpid()}: was forked from process {_forked_from[0]}, which has run soil and whose "
            "threads are missing here; start processes by multiprocessing.get_context('spawn')"
        )


def refuse_threads(count: int) -> None:
    """Raise InputError unless this machine has `count` threads for kernels, and this process may use them."""
    refuse_fork()
    if not 1 <= count <= numba.config.NUMBA_NUM_THREADS:
        raise InputError(
            f"threads: {count} given, this machine allows 1 to {numba.config.NUMBA_NUM_THREADS}; "
            "give fewer, or set NUMBA_NUM_THREADS"
        )


def use_threads(count: int) -> None:
    """Let kernels that this Python thread calls run on `count` threads; setting a new number takes 15 us.

    Raises:
        InputError: see refuse_fork.
    """
    refuse_fork()
    if getattr(_of_thread, "count", None) != count:
        numba.set_num_threads(count)
        _of_thread.count = count
