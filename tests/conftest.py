"""Machines for the tests of the mechanism engine, and the bag of a real run."""

import copy
import fcntl
import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.scene.scene import Scene
from validation.machines import SEVEN_BODIES

os.environ["GOMP_SPINCOUNT"] = "0"  # workers share the cores: what spins while it waits takes another's

pytest_plugins = ["tests.costs"]

VALUES = {
    "stiffness_newton_per_m": 1e4,
    "tangential_stiffness_newton_per_m": 8e3,
    "damping_newton_s_per_m": 20.0,
    "tangential_damping_newton_s_per_m": 20.0,
    "cohesive_stiffness_newton_per_m": 7e3,
    "static_friction": 0.5,
    "sliding_friction": 0.5,
    "rolling_friction": 0.3,
    "equilibrium_overlap_m": 0.002,
    "cohesion_range_m": 0.002,
}
SOIL = {
    "bin": {"length_m": 1.0, "width_m": 0.5, "depth_m": 0.2},
    "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
    "bed": {"kind": "grid", "spacing_m": 0.018},
    "law": {"kind": "cohesive_linear", "particle": VALUES, "boundary": VALUES},
}


def _engine(
    mechanism: dict[str, Any],
    communication_step_ns: int = 1_000_000,
    steps: int = 1,
    tools: Sequence[str] = (),
    gravity_m_per_s2: float = 9.81,
    force: str = "tick_end",
) -> MechanismEngine:
    """Engine of a mechanism; `tools` are bodies that soil may push (no soil is simulated), by a wrench
    that is held through the next tick, unless `coupling.force` is given."""
    document: dict[str, Any] = {
        "name": "machine",
        "duration_s": 1.0,
        "gravity_m_per_s2": gravity_m_per_s2,
        "mechanism": mechanism,
    }
    if tools:
        document["soil"] = SOIL
        document["coupling"] = {"force": force}
        document["tools"] = {
            f"{body}_tool": {"body": body, "lateral_m": 0.1 * i, "groups": {"all": {"mesh": "none.stl"}}}
            for i, body in enumerate(tools)
        }
    timing = Timing(communication_step_ns, tick_count=1, soil_steps=1 if tools else 0, mechanism_steps=steps)
    return MechanismEngine(Scene.model_validate(document), timing)


@pytest.fixture(scope="session")
def mechanism_engine() -> Callable[..., MechanismEngine]:
    """Factory: (mechanism, communication_step_ns, steps, tools, gravity, force) -> engine at time 0."""
    return _engine


@pytest.fixture
def subsoiler() -> dict[str, Any]:
    """The seven bodies of the 1S-300 on wheel contacts, at rest, pulled at 0.5 m/s."""
    return copy.deepcopy(SEVEN_BODIES)


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """A folder that `make` fills in one of the workers, while those that want it too wait."""
    base = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent
    folder = base / name
    with (base / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "made").exists():
            shutil.rmtree(folder, ignore_errors=True)  # of a worker that failed
            folder.mkdir()
            make(folder)
            (folder / "made").touch()
    return folder


@pytest.fixture(scope="session")
def machine_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bag of 10 ms of the machine in a small bin of soil, made by `subsoil run`."""
    from subsoil_ros.cli.main import main
    from tests.system.conftest import run_arguments

    def make(folder: Path) -> None:
        assert main(run_arguments(folder / "out", "direct", 0.01)) == 0

    return made_once(tmp_path_factory, "machine", make) / "out" / "bag"
