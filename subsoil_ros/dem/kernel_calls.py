"""Calls of kernels whose arguments are the same objects from step to step, and numba's number of threads."""

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import numba

from ..errors import InputError

_of_thread = threading.local()


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


def refuse_threads(count: int) -> None:
    """Raise InputError unless this machine has `count` threads for kernels."""
    if not 1 <= count <= numba.config.NUMBA_NUM_THREADS:
        raise InputError(
            f"threads: {count} given, this machine allows 1 to {numba.config.NUMBA_NUM_THREADS}; "
            "give fewer, or set NUMBA_NUM_THREADS"
        )


def use_threads(count: int) -> None:
    """Let kernels that this Python thread calls run on `count` threads; setting a new number takes 15 us."""
    if getattr(_of_thread, "count", None) != count:
        numba.set_num_threads(count)
        _of_thread.count = count
