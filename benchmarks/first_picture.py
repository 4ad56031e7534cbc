"""Wall and CPU time from a clone to the first picture, and of the tests; size of the environment.

python benchmarks/first_picture.py FOLDER [--revision REVISION] [--python PATH]

FOLDER, which must not exist, gets a clone of this repository and caches of its own, all cold. Kernels are
cold again when the tests start.
"""

import argparse
import os
import resource
import shutil
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
STEPS = ("run", "setup-test", "test", "setup-check", "setup-docs")
"""Targets of make, in this order; those that a revision has not are left out."""


def main() -> None:
    """Clone, time each step, print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--revision", default="HEAD")
    parser.add_argument("--python", default="", help="interpreter of the environment")
    given = parser.parse_args()
    folder = given.folder.resolve()
    clone, cache = folder / "clone", folder / "cache"
    revision = subprocess.check_output(["git", "rev-parse", given.revision], cwd=ROOT, text=True).strip()
    subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
    subprocess.run(["git", "checkout", "--quiet", "--detach", revision], cwd=clone, check=True)
    caches = {name: str(cache) for name in ("XDG_CACHE_HOME", "PIP_CACHE_DIR", "UV_CACHE_DIR")}
    environment = os.environ | caches | {"HOME": str(folder)}
    environment.pop("NUMBA_CACHE_DIR", None)
    python = [f"PYTHON={given.python}"] if given.python else []
    makefile = (clone / "Makefile").read_text()
    print("| make | wall | CPU | environment GB |\n|---|---|---|---|")
    for target in STEPS:
        if f"\n{target}:" not in makefile:
            continue
        if target == "test":
            shutil.rmtree(cache / "subsoil_ros" / "kernels")
        wall, cpu = time.monotonic(), children_cpu_s()
        done = subprocess.run(
            ["make", "--silent", target, *python], cwd=clone, env=environment, stdout=subprocess.DEVNULL
        )
        wall, cpu = time.monotonic() - wall, children_cpu_s() - cpu
        failed = f" (exit {done.returncode})" * bool(done.returncode)
        size = f"{size_gb(clone / '.venv'):.2f}"
        print(f"| {target}{failed} | {minutes(wall)} | {minutes(cpu)} | {size} |", flush=True)


def minutes(seconds: float) -> str:
    """Minutes and seconds."""
    return f"{round(seconds) // 60}:{round(seconds) % 60:02d}"


def children_cpu_s() -> float:
    """CPU time of all processes that this one has waited for [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def size_gb(folder: Path) -> float:
    """Space that a folder takes on the disk [GB]."""
    listed = subprocess.check_output(["du", "-s", "--block-size=1", folder], text=True)
    return int(listed.split()[0]) / 1e9


if __name__ == "__main__":
    main()
