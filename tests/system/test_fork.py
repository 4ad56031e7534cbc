"""Runs beside each other in processes of one program."""

import multiprocessing
from typing import Any

import pytest

import subsoil_ros as subsoil
from tests.soils import warming_scene


def run(context: str, scene: dict[str, Any]) -> str:
    """What a process that is started so after a run says of its own run."""
    with multiprocessing.get_context(context).Pool(1) as pool:
        return pool.apply_async(attempt, (scene,)).get(timeout=300)


def attempt(scene: dict[str, Any]) -> str:
    """Run a scene in this process."""
    try:
        return f"{subsoil.run(scene).summary['run']['complete']}"
    except subsoil.errors.SubsoilError as error:
        return str(error)


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_fork_after_a_run_is_told_and_a_new_process_runs() -> None:
    """A forked child raises one error instead of dying in OpenMP, its pool waiting for ever."""
    scene = warming_scene("wet")
    assert attempt(scene) == "True"
    words = run("fork", scene)
    assert "was forked from process" in words
    assert "get_context('spawn')" in words
    assert run("spawn", scene) == "True"
