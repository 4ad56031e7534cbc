"""Wall and CPU time of each step from a clone to the first picture, cold caches; size of the environment.

python benchmarks/first_picture.py FOLDER [--python PATH]

FOLDER, which must not exist, gets a clone of this repository's last commit and caches of its own. The steps
run one after another; `make run` alone compiles messages and kernels side by side.
"""

import argparse
import os
import resource
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
STEPS = {
    "packages": [".venv/.set-up-packages"],
    "messages": [".venv/.set-up-messages"],
    "subsoil_ros": [".venv/.set-up-subsoil"],
    "kernels": [".venv/.set-up-kernels"],
    "run and report": ["run"],
    "packages of tests and checks": [".venv/.set-up-check"],
}
"""Targets of make by what they do."""


def main() -> None:
    """Clone, time each step, print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--python", default="", help="interpreter of the environment")
    given = parser.parse_args()
    folder = given.folder.resolve()
    clone = folder / "clone"
    subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
    caches = {name: str(folder / "cache") for name in ("XDG_CACHE_HOME", "PIP_CACHE_DIR", "UV_CACHE_DIR")}
    environment = os.environ | caches | {"HOME": str(folder)}
    environment.pop("NUMBA_CACHE_DIR", None)
    print("| step | wall s | CPU s | environment GB |\n|---|---|---|---|")
    for name, targets in STEPS.items():
        wall, cpu = time.monotonic(), children_cpu_s()
        absolute = [str(clone / target) if target.startswith(".") else target for target in targets]
        python = [f"PYTHON={given.python}"] if given.python else []
        subprocess.run(
            ["make", "--silent", *absolute, *python],
            cwd=clone, env=environment, check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        wall, cpu = time.monotonic() - wall, children_cpu_s() - cpu
        print(f"| {name} | {wall:.0f} | {cpu:.0f} | {size_gb(clone / '.venv'):.2f} |", flush=True)


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
