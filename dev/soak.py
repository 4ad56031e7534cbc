"""Many short runs as separate processes, one after the other: python -m dev.soak [--runs N] [--shm-kib SIZE]

Each is a `subsoil run` of three shanks on a wedge model for 20 ms, and must end with status 0. Prints a line
for each that does not, then the count. --shm-kib gives the runs a shared memory of that size (root is needed:
a tmpfs in a mount namespace of its own), and first prints the result of a process that only loads rclpy.
With FASTDDS_BUILTIN_TRANSPORTS=DEFAULT in the environment Fast DDS uses it, whether it has room or not. Exit
status: the number of runs that failed, 100 at most.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

SCENE = "three_shanks_wedge"
DURATION_S = 0.02
LIMIT_S = 300.0


def one_run(folder: Path, number: int) -> tuple[int, str]:
    """Exit status and last line of what it said."""
    words = ["run", SCENE, "--out", str(folder / str(number)), "--set", f"duration_s={DURATION_S}"]
    command = [sys.executable, "-m", "subsoil_ros.cli.main", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    lines = (done.stdout + done.stderr).strip().splitlines()
    said = [line for line in lines if "messages go by UDP" in line] or lines[-1:]
    return done.returncode, said[-1] if said else ""


def in_small_memory(kib: int, arguments: Sequence[str]) -> int:
    """This program again, where /dev/shm is that small. Returns its exit status."""
    alone = f"{sys.executable} -c 'import rclpy'; echo a process that loads rclpy: exit status $?"
    mount = f'mount -t tmpfs -o size={kib}k none /dev/shm && {alone}; exec "$@"'
    command = ["unshare", "--mount", "sh", "-c", mount, "sh", sys.executable, "-m", "dev.soak", *arguments]
    return subprocess.run(command, check=False).returncode


def main() -> int:
    """Returns the number of runs that failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--shm-kib", type=int, default=0, help="size of a shared memory of their own")
    args = parser.parse_args()
    if args.shm_kib:
        return in_small_memory(args.shm_kib, ["--runs", str(args.runs)])
    failed = 0
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="subsoil_soak_") as folder:
        for number in range(args.runs):
            status, said = one_run(Path(folder), number)
            failed += status != 0
            if status or "messages go by UDP" in said:
                print(f"{number + 1:4d} exit status {status}: {said}", flush=True)
    print(f"{args.runs} runs in {time.monotonic() - start:.0f} s, {failed} failed")
    return min(failed, 100)


if __name__ == "__main__":
    raise SystemExit(main())
