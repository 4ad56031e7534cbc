"""How numba compiles and runs kernels, and where it keeps them: one folder per state of the sources.

numba looks only at the file of the function it compiles, not at those it calls. With one cache, a changed
contact law would go on running as it was, compiled into the pair kernel. So the folder's name is a digest
of every kernel source. It stands outside the package, which may be read-only.
"""

import functools
import hashlib
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numba
from llvmlite.binding import get_host_cpu_features

_PACKAGE = Path(__file__).parent
KERNEL_FOLDERS = (_PACKAGE / "dem", _PACKAGE / "dem" / "gpu", _PACKAGE / "mbd", _PACKAGE / "resistance")


SPIN_COUNT = "3000"
"""Turns that GNU's OpenMP waits awake, about 0.1 ms (measured, 0 to 30,000: with it two threads on 9,000
particles take 0.6 of the time, and more turns gain nothing)."""


def kernel_cache_folder(sources: Iterable[Path] = KERNEL_FOLDERS) -> Path:
    """The cache folder for the kernels in the folders `sources`, under the user's cache folder."""
    return user_cache_folder() / source_digest(sources)[:16]


def source_digest(sources: Iterable[Path]) -> str:
    """sha256 hex of numba's version and of the Python files in `sources`, each a folder or a file."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sources:
        for path in sorted(source.glob("*.py")) if source.is_dir() else (source,):
            digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def user_cache_folder() -> Path:
    """This package's folder among the user's own caches.

    Where that cannot be written to, one in the temporary folder; if that of an earlier run is not to be
    trusted, a fresh one, which no later run finds again.
    """
    given = os.environ.get("XDG_CACHE_HOME")
    place = Path(given) if given else Path(os.path.expanduser("~")) / ".cache"
    if _is_ours(place / "subsoil_ros"):
        return place / "subsoil_ros"
    shared = Path(tempfile.gettempdir()) / f"cache-{os.getuid()}"
    if _is_ours(shared):
        return shared
    return _folder_of_this_process()


@functools.cache
def _folder_of_this_process() -> Path:
    return Path(tempfile.mkdtemp(prefix="cache-"))


def _is_ours(place: Path) -> bool:
    """A folder, made if need be, that this user owns and can write to: kernels are code that is run."""
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        return place.stat().st_uid == os.getuid() and os.access(place, os.W_OK)
    except OSError:
        return False


def set_up_numba() -> None:
    """How numba keeps, compiles and runs the kernels; what the user's NUMBA_ variables say, stands."""
    given = os.environ
    if not given.get("NUMBA_CACHE_DIR"):
        numba.config.CACHE_DIR = str(kernel_cache_folder())
    if not given.get("NUMBA_CPU_FEATURES") and not given.get("NUMBA_CPU_NAME"):
        numba.config.CPU_FEATURES = _features_of_this_core()
    if not given.get("NUMBA_THREADING_LAYER_PRIORITY"):
        numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]
    # OpenMP threads would spin for long after a parallel region and take the cores of the other nodes;
    # without any spinning every region of a step would wake them anew. OpenMP reads this once, at first use.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("GOMP_SPINCOUNT", SPIN_COUNT)


def _features_of_this_core() -> str:
    """All that it has, and its widest vectors: LLVM takes half of them by default, for older cores' sake."""
    features = get_host_cpu_features()
    features["prefer-256-bit"] = False
    return str(features.flatten())
