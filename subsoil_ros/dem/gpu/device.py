"""The GPU that numba-cuda drives: whether there is one, and kernels that are launched together."""

import functools
import os
from typing import Any

import numpy as np

from ...errors import InputError
from ...extras import require

os.environ.setdefault("NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS", "0")  # small beds have small grids

from numba import cuda

SIMULATED = os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"
"""Whether numba's simulator, which runs kernels as plain Python, stands for a GPU."""

THREADS = 8 if SIMULATED else 128
"""Threads of a block: four warps; the simulator starts a thread of the operating system for each."""

WARP = 32


def refuse_without_gpu() -> None:
    """Check that a GPU can be used.

    Raises:
        InputError: there is none, or its libraries are missing; the message names what is missing.
    """
    if not SIMULATED:
        require("soil.device: 'gpu'", "cuda", "numba_cuda")
    if not cuda.is_available():
        raise InputError(
            "soil.device: 'gpu' given, but no CUDA GPU can be used here; install an NVIDIA driver, or use "
            "'cpu'"
        )


def blocks(count: int) -> int:
    """Blocks of THREADS for `count` threads, at least one."""
    return max(1, -(-count // THREADS))


class Launches:
    """Kernels that are launched one after the other, always with the same arguments.

    The first time they are launched one by one, which compiles them; then they are recorded as a CUDA graph,
    which starts in some 10 us however many they are (one by one each takes 50 to 100 us of Python).
    """

    def __init__(self, stream: Any) -> None:
        self._stream, self._warm = stream, False
        self._graph: Any = None
        self._launches: list[tuple[Any, int, int, tuple[Any, ...]]] = []

    def add(self, kernel: Any, grid: int, *arguments: Any, threads: int = THREADS) -> None:
        """Add a kernel, launched on `grid` blocks."""
        self._launches.append((kernel, grid, threads, arguments))

    def run(self) -> None:
        """Launch all kernels."""
        if self._graph is not None:
            _checked(_driver().cuGraphLaunch(self._graph, _handle(self._stream)))
        elif self._warm and not SIMULATED:
            self._record()
            self.run()
        else:
            self._launch()
            self._warm = True

    def _launch(self) -> None:
        for kernel, grid, threads, arguments in self._launches:
            kernel[grid, threads, self._stream](*arguments)

    def _record(self) -> None:
        driver, stream = _driver(), _handle(self._stream)
        mode = driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_THREAD_LOCAL
        with cuda.defer_cleanup():  # memory given back meanwhile would end the recording
            _checked(driver.cuStreamBeginCapture(stream, mode))
            self._launch()
            graph = _checked(driver.cuStreamEndCapture(stream))
        self._graph = _checked(driver.cuGraphInstantiate(graph, 0))


class Mirror:
    """Array of float64 on the device with a copy on the host, for numbers that are exchanged every tick.

    Copies go through the driver: those of numba take several times as long for so little.
    """

    def __init__(self, shape: tuple[int, ...], stream: Any) -> None:
        self.there = cuda.to_device(np.zeros(shape))
        self.here = cuda.pinned_array(shape, np.float64)
        self.here[:] = 0.0
        self._stream, self._places = stream, (0, 0, 0)
        if not SIMULATED:
            there = self.there.__cuda_array_interface__["data"][0]
            self._places = there, self.here.ctypes.data, self.here.nbytes

    def send(self) -> None:
        """Copy `here` to the device; it may be changed after the next `take` of any Mirror."""
        if SIMULATED:
            self.there.copy_to_device(self.here)
        else:
            there, here, size = self._places
            _checked(_driver().cuMemcpyHtoDAsync(there, here, size, _handle(self._stream)))

    def take(self) -> np.ndarray:
        """Wait for all launched kernels and copy the array to the host, where the next call overwrites it."""
        if SIMULATED:
            self.there.copy_to_host(self.here)
        else:
            there, here, size = self._places
            _checked(_driver().cuMemcpyDtoHAsync(here, there, size, _handle(self._stream)))
            _checked(_driver().cuStreamSynchronize(_handle(self._stream)))
        return self.here


@functools.cache
def _driver() -> Any:
    from cuda.bindings import driver

    return driver


@functools.lru_cache(maxsize=8)
def _handle(stream: Any) -> Any:
    return _driver().CUstream(int(getattr(stream.handle, "value", stream.handle)))


def _checked(result: tuple[Any, ...]) -> Any:
    """Value that a call of the driver returned.

    Raises:
        RuntimeError: the call failed.
    """
    if int(result[0]) != 0:
        raise RuntimeError(f"CUDA driver: {result[0]}")
    return result[1] if len(result) > 1 else None


def room_for(count: int) -> int:
    """Length of an array for `count` numbers that may become more."""
    return int(count * 1.1) + 256


def on_device(array: np.ndarray) -> Any:
    """Copy of an array on the device; an empty one, which kernels cannot take, becomes one row long."""
    given = np.ascontiguousarray(array)
    if given.size == 0:
        given = np.zeros([max(length, 1) for length in given.shape], given.dtype)
    return cuda.to_device(given)
