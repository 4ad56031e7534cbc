"""Set-up of numba: compilation of kernels, messages about it, and their cache outside the package."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import numba
from llvmlite.binding import get_host_cpu_features
from numba.core import event
from numba.core.caching import CacheImpl

from .cache_folders import kernel_cache_folder
from .source_digest import PACKAGE, kernel_digest

SPIN_COUNT = "3000"
"""Turns that a thread of GNU's OpenMP spins before it sleeps, about 0.1 ms. Measured from 0 to 30,000: with
this many, two threads on 9,000 particles take 0.6 of the time; more turns gain nothing."""


class KernelLocator:
    """Cache locator of numba for the kernels of one source file of this package; detects outdated kernels.

    numba itself compares the time of that file only: after a change of a contact law, it would still load the
    old kernel of another file that calls the law. Here the names of the kept files contain the digest of all
    that the file imports.
    """

    def __init__(self, source: Path) -> None:
        self._digest = kernel_digest(source)[:16]
        self._folder = kernel_cache_folder() / source.parent.relative_to(PACKAGE)

    @classmethod
    def from_function(cls, function: object, file: str) -> "KernelLocator | None":
        """Return the locator of a kernel; None if the kernel is not of this package."""
        source = Path(file)
        return cls(source) if source.is_relative_to(PACKAGE) else None

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_source_stamp(self) -> str:
        """Return the stamp of the sources that kept kernels must match."""
        return self._digest

    def get_disambiguator(self) -> str:
        """Return a text that distinguishes the files of equally named kernels."""
        return self._digest


def soil_kernels_are_kept() -> bool:
    """Whether a soil step, as its sources are now, has been compiled before."""
    digest = kernel_digest(PACKAGE / "dem" / "step.py")[:16]
    return any((kernel_cache_folder() / "dem").glob(f"step.*-{digest}.*.nbc"))


def set_up_numba() -> None:
    """Set how numba keeps, compiles and runs kernels; NUMBA_ variables of the user take precedence."""
    given = os.environ
    if not given.get("NUMBA_CACHE_LOCATOR_CLASSES"):
        numba.config.CACHE_LOCATOR_CLASSES = ",".join(
            f"{locator.__module__}.{locator.__qualname__}"
            for locator in (KernelLocator, *CacheImpl._locator_classes)
        )
    if not given.get("NUMBA_CPU_FEATURES") and not given.get("NUMBA_CPU_NAME"):
        numba.config.CPU_FEATURES = _features_of_this_core()
    if not given.get("NUMBA_THREADING_LAYER_PRIORITY"):
        numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]
    # OpenMP threads would spin for long after a parallel region and take the cores of the other nodes;
    # without any spinning every region of a step would wake them anew. OpenMP reads this once, at first use.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("GOMP_SPINCOUNT", SPIN_COUNT)


def _features_of_this_core() -> str:
    """All features of this processor, with its widest vectors; by default LLVM uses half of their width."""
    features = get_host_cpu_features()
    features["prefer-256-bit"] = False
    return str(features.flatten())


_compiling: list[object] = []
"""Events of the kernels that are being compiled."""


class _Compiling(event.Listener):
    def on_start(self, event: object) -> None:
        _compiling.append(event)

    def on_end(self, event: object) -> None:
        _compiling.pop()


event.register("numba:compile", _Compiling())


def compiling() -> bool:
    """Whether this process is compiling a kernel."""
    return bool(_compiling)


class CompilationListener(event.Listener):
    """Announces the compilation of the first kernel, and in `done` reports how long it took.

    Nothing is printed for kernels loaded from the cache on disk, nor for the few that are compiled after
    `done`. Use as context manager.

    Args:
        say: called with each line.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._depth = self._compiled = 0
        self._since = self._seconds = 0.0
        self._told = False

    def on_start(self, event: object) -> None:
        """Handle the start of the compilation of a kernel, or of one that it calls."""
        if self._compiled == 0:
            self._say(f"compiling kernels, once, in 1 to 4 minutes: kept in {kernel_cache_folder()}")
        if self._depth == 0:
            self._since = time.monotonic()
        self._depth += 1
        self._compiled += 1

    def on_end(self, event: object) -> None:
        """Handle the end of that compilation."""
        self._depth -= 1
        if self._depth == 0:
            self._seconds += time.monotonic() - self._since

    def done(self) -> None:
        """Report the time of compilation, once; nothing if nothing was compiled."""
        if self._compiled and not self._told:
            self._told = True
            self._say(f"compiled {self._compiled} kernels in {self._seconds:.0f} s")

    def __enter__(self) -> "CompilationListener":
        event.register("numba:compile", self)
        return self

    def __exit__(self, *exception: object) -> None:
        event.unregister("numba:compile", self)
        self.done()
