"""Compile the kernels that a first run needs, before that run.

Run from the sources: python -m dev.warm_kernels. Of two processes, one runs the soil of `make run` in a small
field, with its tool on a path: preparation of its block, and the run. The other takes a step of its machine,
without soil. With --tests, the first scene of the tutorial and the soils of tests/soils.py follow. Compiled
kernels stay in the user's cache under a digest of their sources, so a second call compiles nothing.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping

from subsoil_ros import run
from subsoil_ros.cache_folders import kernel_cache_folder
from subsoil_ros.coupling.engines import build_mechanism
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.shipped import config_folder

SCENE = config_folder() / "scenes" / "field_swing_brittle.yaml"
SHORT = {"duration_s": 0.002, "record.series_ticks": 1}

SOIL = {
    **SHORT,
    "mechanism": None,
    "coupling": None,
    "report": None,
    "tools.shank.body": None,
    "tools.shank.path": {"start_x_m": 0.1},
    "soil.bin": {"length_m": 0.3, "width_m": 0.3, "depth_m": 0.15, "sides": "held"},
    "soil.bed.tile_m": 0.15,
}


def soil() -> None:
    """Kernels of a field and of the preparation of its bed."""
    run(SCENE, overrides=SOIL)


def tine() -> None:
    """Kernels of the first scene of the tutorial."""
    run("tine", overrides=SHORT)


def machine() -> None:
    """Kernels of the mechanism."""
    mechanism = build_mechanism(load_scene(SCENE))
    assert mechanism is not None
    mechanism.advance(0, ())
    mechanism.state("", 0, 0)


def soils_of_tests(part: int) -> Callable[[], None]:
    """Kernels of every other soil of the tests, from the one numbered `part` on."""

    def compile_them() -> None:
        from tests.soils import SOILS, warming_scene

        for name in list(SOILS)[part::2]:
            run(warming_scene(name))

    return compile_them


PARTS: Mapping[str, Callable[[], None]] = {
    "soil": soil, "tine": tine, "machine": machine,
    "tests-0": soils_of_tests(0), "tests-1": soils_of_tests(1),
}  # fmt: skip


def side_by_side(*parts: str) -> int:
    """Each part in a process of its own; beds go to a folder that is removed. Exit status."""
    kernels = str(kernel_cache_folder())
    with tempfile.TemporaryDirectory(prefix="warm-kernels-") as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": kernels, "XDG_CACHE_HOME": folder}
        command = [sys.executable, "-m", "dev.warm_kernels", "--part"]
        processes = [subprocess.Popen([*command, part], env=environment) for part in parts]
        return max([process.wait() for process in processes], key=abs)


def main() -> int:
    """Exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", action="store_true", help="also the tutorial and the soils of the tests")
    parser.add_argument("--part", choices=PARTS, help="only this part, in this process")
    given = parser.parse_args()
    if given.part:
        PARTS[given.part]()
        return 0
    status = side_by_side("soil", "machine")
    if given.tests and status == 0:
        status = side_by_side("tine", "tests-0", "tests-1")
    return abs(status)


if __name__ == "__main__":
    sys.exit(main())
