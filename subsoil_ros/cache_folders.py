"""Folders of what is kept between runs, outside the package."""

import functools
import os
import tempfile
from pathlib import Path


def kernel_cache_folder() -> Path:
    """Folder of the compiled kernels: NUMBA_CACHE_DIR, or a folder in the user's cache."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    return Path(given) if given else user_cache_folder() / "kernels"


def user_cache_folder() -> Path:
    """This package's folder among the user's own caches.

    Where that cannot be written, a folder in the temporary folder. If an existing one there is not safe, a
    new one, which later runs do not find.
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
    """Whether the folder, made if missing, is owned and writable by this user: kernels are executed."""
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        return place.stat().st_uid == os.getuid() and os.access(place, os.W_OK)
    except OSError:
        return False
