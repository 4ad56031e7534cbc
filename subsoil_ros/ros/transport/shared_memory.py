"""Shared memory that killed nodes left behind.

Fast DDS gives every participant segments and ports in /dev/shm (about 0.5 MB), and lock files that are
held locked as long as somebody uses them. What a killed participant leaves stays (as of Fast DDS 2.14;
its own `fastdds shm clean` works by the same rule).
"""

import fcntl
import re
import time
from contextlib import suppress
from pathlib import Path

FOLDER = Path("/dev/shm")

SETTLED_S = 2.0
"""Files younger than this may belong to somebody who is about to lock them."""

_NAME = re.compile(r"(fastrtps_(?:[0-9a-f]{16}|port\d+))(?:_[es]l)?")


def sweep_shared_memory() -> int:
    """Removes segments and ports that nobody holds. Returns their number."""
    matches = (_NAME.fullmatch(path.name) for path in FOLDER.glob("fastrtps_*"))
    return sum(_remove_unheld(name) for name in {match.group(1) for match in matches if match})


def _remove_unheld(name: str) -> bool:
    locks = [FOLDER / f"{name}_el", FOLDER / f"{name}_sl"]
    files = [FOLDER / name, FOLDER / f"sem.{name}_mutex", *locks]
    with suppress(OSError):  # another user's, or gone meanwhile
        if any(path.exists() and time.time() - path.stat().st_ctime < SETTLED_S for path in files):
            return False
        if any(path.exists() and _is_held(path) for path in locks):
            return False
        for path in files:
            path.unlink(missing_ok=True)
        return True
    return False


def _is_held(path: Path) -> bool:
    with path.open("rb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return True
    return False
