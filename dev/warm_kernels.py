"""Compile the kernels that a first run needs, before that run.

Run from the sources: python -m dev.warm_kernels. One process runs the soil of `make run` in a small field,
with its tool on a path: preparation of its block, and the run. Another takes a step of its machine, no soil.
With --tests, the soils of tests/soils.py follow. Compiled kernels stay in the user's cache under a digest of
their sources, so a second call compiles nothing.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

from subsoil_ros import run
from subsoil_ros.cache_folders import kernel_cache_folder
from subsoil_ros.coupling.engines import build_mechanism
from subsoil_ros.loading.files import config_folder
from subsoil_ros.loading.loader import load_scene

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


def machine() -> None:
    """Kernels of the mechanism."""
    mechanism = build_mechanism(load_scene(SCENE))
    assert mechanism is not None
    mechanism.advance(0, ())
    mechanism.state("", 0, 0)


PARTS: Mapping[str, Callable[[], None]] = {"soil": soil, "machine": machine}


def compile_part(name: str) -> None:
    """Compile one of PARTS, or one of the soils of the tests."""
    if name in PARTS:
        PARTS[name]()
        return
    from tests.soils import warming_scene

    run(warming_scene(name))


def compile_all(parts: Sequence[str]) -> int:
    """Compile each part in a process, one for each core at a time; their beds are not kept. Exit status."""
    kernels = str(kernel_cache_folder())
    with tempfile.TemporaryDirectory(prefix="warm-kernels-") as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": kernels, "XDG_CACHE_HOME": folder}
        command = [sys.executable, "-m", "dev.warm_kernels", "--part"]
        with ThreadPoolExecutor(max(2, os.cpu_count() or 1)) as pool:
            ended = pool.map(lambda part: subprocess.call([*command, part], env=environment), parts)
        return max(ended, key=abs)


def main() -> int:
    """Exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", action="store_true", help="also the soils of the tests")
    parser.add_argument("--part", help="only this part, in this process")
    given = parser.parse_args()
    if given.part:
        compile_part(given.part)
        return 0
    soils: list[str] = []
    if given.tests:
        from tests.soils import SOILS

        soils = list(SOILS)
    return abs(compile_all([*PARTS, *soils]))


if __name__ == "__main__":
    sys.exit(main())
