"""Shared memory: remains of killed nodes, and room for the nodes of a run.

Fast DDS gives every participant segments and ports in /dev/shm (about 0.5 MB), and lock files that are
held locked as long as a process uses them. The files of a killed participant remain (as of Fast DDS 2.14;
its own `fastdds shm clean` works by the same rule).
"""

import fcntl
import mmap
import os
import re
import shutil
import time
from contextlib import suppress
from pathlib import Path

from ...errors import InputError

FOLDER = Path("/dev/shm")

SETTLED_S = 2.0
"""Files younger than this may belong to a process that is about to lock them."""

PROCESS_BYTES = 2**20
"""Shared memory for one process; measured were 0.65 MB, for its segment and its ports."""

MOST_NODES = 5
"""Largest number of nodes of a run, each a process."""

LOADED_BYTES = 2 * mmap.PAGESIZE
"""The tracing library of ROS (LTTng) maps two pages as a process loads rclpy, without reserving memory: where
there is none left, the process is killed by SIGBUS (`python -m dev.soak --shm-kib 4`)."""

TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_CHOSEN_BY = (TRANSPORTS, "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Variables by which a user chooses how messages travel."""

_NAME = re.compile(r"(fastrtps_(?:[0-9a-f]{16}|port\d+))(?:_[es]l)?")


def free_bytes() -> int:
    """Free bytes in shared memory."""
    return shutil.disk_usage(FOLDER).free


def avoid_full_memory(process_count: int = MOST_NODES) -> str:
    """Make this process, and those it starts, use UDP if shared memory has no room for `process_count` ones.

    Nothing is changed where the user has chosen how messages travel.

    Returns:
        A notice about it, in one line; empty if there is room.

    Raises:
        InputError: there is not even room to load ROS.
    """
    needed = process_count * PROCESS_BYTES
    if not FOLDER.is_dir() or free_bytes() >= needed:
        return ""
    sweep_shared_memory()
    free = free_bytes()
    if free < LOADED_BYTES:
        raise InputError(
            f"{FOLDER} is full: {free} bytes are free, loading ROS takes {LOADED_BYTES}, and a node would "
            "be killed; make room there, or run without ROS: subsoil run --mode direct"
        )
    if free >= needed or any(os.environ.get(name) for name in _CHOSEN_BY):
        return ""
    os.environ[TRANSPORTS] = "UDPv4"
    return (
        f"{FOLDER} has {free / 2**20:.1f} MiB free, shared memory for {process_count} processes takes "
        f"{needed / 2**20:.0f} MiB: messages go by UDP, which takes 10 to 30 % longer; make room to avoid it"
    )


def sweep_shared_memory() -> int:
    """Removes segments and ports that no process holds. Returns their number."""
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
