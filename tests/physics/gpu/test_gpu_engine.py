"""The engine on a GPU against that on the CPU, on a GPU where there is one, else in numba's simulator."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba import cuda
from numpy.testing import assert_allclose, assert_array_equal

from subsoil_ros.cli.main import main
from tests.physics.gpu.scenarios import RESUMED, SCENARIOS, results, resumed

HERE = Path(__file__).parent
FIRST = ("cohesive linear with a tool",)
"""What `make test` runs; the others are in `make test-full`."""


class Both(NamedTuple):
    """What both engines made of some scenarios."""

    folder: Path
    names: tuple[str, ...]


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(FIRST, id="first"),
        pytest.param(tuple(set(SCENARIOS) - set(FIRST)), id="others", marks=pytest.mark.full),
    ],
)
def both(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Both:
    """A folder with what both engines made of a group of scenarios."""
    folder = tmp_path_factory.mktemp("gpu")
    for name in request.param:
        whole, kept = results("cpu", name)
        np.savez(folder / f"cpu {name}.npz", **whole)
        np.savez(folder / f"cpu kept {name}.npz", **kept)
    simulated = {} if cuda.is_available() else {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    subprocess.run(
        [sys.executable, str(HERE / "scenarios.py"), str(folder), *request.param],
        check=True,
        cwd=HERE.parents[2],
        env=os.environ | simulated | {"PYTHONPATH": str(HERE.parents[2])},
    )
    return Both(folder, request.param)


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


def test_the_gpu_computes_what_the_cpu_does(both: Both) -> None:
    """To round-off; a particle that is lost, with the same words."""
    for name in both.names:
        ours, theirs = taken(both.folder, f"gpu {name}"), taken(both.folder, f"cpu {name}")
        assert_same(ours, theirs, mixed="mixed" in name)
        assert theirs["counts"][2] > 1, "lists were built but once"
        assert bool(theirs["error"]) == (name == "lost particle")
        if name.startswith("bonds"):
            assert theirs["counts"][-2:].min() > 0, "of the bonds none or all broke"
        if name == "window":
            before = taken(both.folder, "cpu kept window")["window"]
            assert (theirs["window"] != before).any(), "it did not move"


def test_a_run_goes_on_from_a_checkpoint_of_the_other_device(both: Both) -> None:
    """From the CPU on the GPU, and back."""
    for name in set(both.names) & set(RESUMED):
        whole = taken(both.folder, f"cpu {name}")
        assert_same(taken(both.folder, f"gpu resumed {name}"), whole, mixed=False)
        kept = taken(both.folder, f"gpu kept {name}")
        assert_same(resumed("cpu", name, kept), whole, mixed=False)


@pytest.mark.skipif(not cuda.is_available(), reason="there is no GPU")
def test_two_runs_give_the_same_bits(both: Both) -> None:
    """The first scenario, run again."""
    once, again = taken(both.folder, f"gpu {both.names[0]}"), taken(both.folder, "gpu again")
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
