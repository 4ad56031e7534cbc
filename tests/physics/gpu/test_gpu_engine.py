"""The engine on a GPU against that on the CPU, on a GPU where there is one, else in numba's simulator."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from numba import cuda
from numpy.testing import assert_allclose, assert_array_equal

from subsoil_ros.cli.main import main
from subsoil_ros.dem.engine import SoilEngine
from tests.physics.gpu.scenarios import RESUMED, SCENARIOS, results, resumed

HERE = Path(__file__).parent
NAMES = list(SCENARIOS)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what both engines made of all scenarios."""
    folder = tmp_path_factory.mktemp("gpu")
    for number, name in enumerate(NAMES):
        whole, kept = results(SoilEngine, name)
        np.savez(folder / f"cpu_{number}.npz", **whole)
        np.savez(folder / f"cpu_kept_{number}.npz", **kept)
    simulated = {} if cuda.is_available() else {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    subprocess.run(
        [sys.executable, str(HERE / "scenarios.py"), str(folder)],
        check=True,
        cwd=HERE.parents[1],
        env=os.environ | simulated | {"PYTHONPATH": str(HERE.parents[1])},
    )
    return folder


def taken(folder: Path, stem: str) -> dict[str, np.ndarray]:
    with np.load(folder / f"{stem}.npz") as arrays:
        return dict(arrays)


def assert_same(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray], *, mixed: bool) -> None:
    """To round-off: of float32 where most numbers are."""
    assert str(ours["error"]) == str(theirs["error"])
    assert_array_equal(ours["counts"], theirs["counts"])
    for name, array in theirs.items():
        if name in ("error", "counts"):
            continue
        scale = np.abs(array).max(initial=0.0)
        assert_allclose(ours[name], array, rtol=0.0, atol=(3e-5 if mixed else 1e-10) * scale, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_gpu_computes_what_the_cpu_does(both, name):
    number = NAMES.index(name)
    ours, theirs = taken(both, f"gpu_{number}"), taken(both, f"cpu_{number}")
    assert_same(ours, theirs, mixed="mixed" in name)
    assert theirs["counts"][2] > 1, "lists were built but once"
    assert bool(theirs["error"]) == (name == "lost particle")


@pytest.mark.slow
@pytest.mark.parametrize("name", RESUMED)
def test_a_run_goes_on_from_a_checkpoint_of_the_other_device(both, name):
    number, mixed = NAMES.index(name), "mixed" in name
    whole = taken(both, f"cpu_{number}")
    assert_same(taken(both, f"gpu_resumed_{number}"), whole, mixed=mixed)
    kept = taken(both, f"gpu_kept_{number}")
    assert_same(resumed(SoilEngine, name, kept), whole, mixed=mixed)


@pytest.mark.slow
def test_two_runs_give_the_same_bits(both):
    once, again = taken(both, f"gpu_{NAMES.index('cohesive linear with a tool')}"), taken(both, "gpu_again")
    for name, array in once.items():
        assert_array_equal(again[name], array)


@pytest.mark.skipif(cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_nothing_starts(tmp_path, capsys):
    out = tmp_path / "run"
    status = main(["run", "config/scenes/tine.yaml", "--out", str(out), "--set", "soil.device=gpu"])
    said = capsys.readouterr().err
    assert status == 2
    assert "soil.device: 'gpu'" in said
    assert ("'cpu'" if find_spec("numba_cuda") else "pip install 'subsoil_ros[gpu]'") in said
    assert not out.exists()
