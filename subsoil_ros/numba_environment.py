"""Environment variables of numba, checked before it is imported, which would end in a traceback."""

import os
from pathlib import Path

from .errors import environment_error


def check_numba_environment() -> None:
    """Check what numba will read.

    Raises:
        InputError: a variable has a value with which numba cannot be imported, or cannot keep kernels.
    """
    threads = os.environ.get("NUMBA_NUM_THREADS", "")
    if threads and not (threads.isascii() and threads.isdecimal() and threads.strip("0")):
        raise environment_error("NUMBA_NUM_THREADS", threads, "a whole number from 1")
    folder = os.environ.get("NUMBA_CACHE_DIR", "")
    if folder and not _can_be_written(Path(folder)):
        raise environment_error("NUMBA_CACHE_DIR", folder, "a folder that can be made and written")


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)
