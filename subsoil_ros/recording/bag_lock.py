"""The lock that a writer holds on its bag; it goes with the process."""

import fcntl
import os
from contextlib import suppress
from pathlib import Path
from typing import IO


def lock(stream: IO[bytes]) -> None:
    """Lock a bag for its writer, where the file system has locks."""
    with suppress(OSError):
        fcntl.flock(stream, fcntl.LOCK_EX)


def unlock(stream: IO[bytes]) -> None:
    """Release the lock, also that of processes which were forked meanwhile."""
    with suppress(OSError):
        fcntl.flock(stream, fcntl.LOCK_UN)


def writer_of(path: Path) -> str:
    """Who is writing the bag file `path`, in words; empty if no process is."""
    with path.open("rb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return _holder(os.fstat(stream.fileno()).st_ino)
        except OSError:  # no locks on this file system
            return ""
    return ""


def _holder(inode: int) -> str:
    with suppress(OSError):
        for line in Path("/proc/locks").read_text().splitlines():
            words = line.split()
            if "FLOCK" in words and words[-3].endswith(f":{inode}"):
                return f"process {words[-4]}"
    return "a process"
