"""An engine put into the state of another goes on with the same bits, as a file brings it."""

from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.mbd.tool_paths import PathEngine
from subsoil_ros.messages import ToolMotion, ToolWrench
from subsoil_ros.recording.checkpoint import commit, read_checkpoint, state_sha256, write_part
from tests.physics.conftest import SoilMaker, one_tool
from tests.soils import BOOKED, LAYERS, WET

SCENES = Path(__file__).parents[2] / "config/scenes"
STEP_S = 4e-5
SOILS = {
    "monitored and booked": {"monitors": {"every_steps": 7, "max_energy_defect": 0.5}},
    "layers": LAYERS,
    "periodic": {"bin": {"sides": "periodic"}},
    "mixed precision, booked": {"precision": "mixed", **BOOKED},
}
SHARED = ("monitored and booked", "periodic")
"""Those whose kernels other tests need too."""


def through_a_file(tmp_path: Path, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays as they come back from a checkpoint."""
    write_part(tmp_path, 1, "part", arrays)
    facts = {"time_s": 0.0, "run_id": "", "scene_hash": "", "coupling": {}}
    return read_checkpoint(commit(tmp_path, 1, ["part"], facts)).read_part("part")


def bar(tick: int) -> tuple[ToolMotion, ...]:
    """A bar that is swept fast through the bed, and turned."""
    time_s = (tick + 1) * STEP_S
    return (ToolMotion("tool", 0.08 + 1.0 * time_s, 0.0, -0.03, 3.0 * time_s, 1.0, 0.0, 3.0),)


def swept_bed(folder: Path, kind: str) -> ResolvedScene:
    """A small bed of SOILS, with the bar in it."""
    soil = {
        "bin": {"length_m": 0.3, "width_m": 0.1, "depth_m": 0.08},
        "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
        "bed": {"kind": "grid", "spacing_m": 0.018, "jitter_m": 0.0004},
        "law": WET,
        "time_step_s": STEP_S,
    }
    for key, changes in SOILS[kind].items():
        soil[key] = {**soil[key], **changes} if isinstance(soil.get(key), dict) else changes
    maker = SoilMaker(folder)
    return maker.scene(soil=soil, tools=one_tool(maker.box(0.03, 0.04, 0.08, subdivide=1)))


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=[pytest.mark.full] * (kind not in SHARED)) for kind in SOILS],
)
def test_soil_goes_on(tmp_path: Path, kind: str) -> None:
    """Through several new lists of neighbours: particles, histories, lists, books and monitors."""
    resolved = swept_bed(tmp_path, kind)
    first = build_engine(resolved)
    first.start(bar(-1))
    for tick in range(400):
        first.advance(tick, bar(tick))
    second = build_engine(resolved, 2)
    kept = through_a_file(tmp_path / "kept", first.state_arrays())
    second.restore(kept)
    assert state_sha256(second.state_arrays()) == state_sha256(first.state_arrays())
    rebuilds = first.state("", 0, 0).rebuild_count
    for tick in range(400, 800):
        assert first.advance(tick, bar(tick)) == second.advance(tick, bar(tick))
    assert first.state("", 0, 0).rebuild_count > rebuilds + 2
    assert first.state("", 0, 0) == second.state("", 0, 0)
    assert state_sha256(second.state_arrays()) == state_sha256(first.state_arrays())


@pytest.mark.full
@pytest.mark.parametrize("kind", list(SOILS))
def test_who_looks_at_a_soil_changes_nothing(tmp_path: Path, kind: str) -> None:
    """Between two ticks a half kick may be owed: it is made when the state is read, or with the next step.

    But for the books: a look adds them up, in an order of its own.
    """
    resolved = swept_bed(tmp_path, kind)
    alone, watched = build_engine(resolved), build_engine(resolved)
    looks = (
        watched.state_arrays,
        watched.energy,
        watched.velocities_m_per_s,
        watched.angular_velocities_rad_per_s,
    )
    alone.start(bar(-1))
    watched.start(bar(-1))
    for tick in range(300):
        assert alone.advance(tick, bar(tick)) == watched.advance(tick, bar(tick))
        looks[tick % len(looks)]()
    assert state_sha256(motion(kind, alone)) == state_sha256(motion(kind, watched))


def motion(kind: str, engine: SoilEngine) -> dict[str, np.ndarray]:
    """State of an engine without the books that its soil keeps."""
    books = ("pair_book", "wall_book", "sinks", "watch.") if "booked" in kind else ()
    return {name: array for name, array in engine.state_arrays().items() if not name.startswith(books)}


def pulled(resolved: ResolvedScene, tick: int) -> tuple[ToolWrench, ...]:
    """Wrenches that change from tick to tick."""
    force = -800.0 + 300.0 * np.sin(0.01 * tick)
    return tuple(ToolWrench(tool, force, 0.0, 50.0, 0.0, 20.0, 0.0, 0.0, 1) for tool in resolved.scene.tools)


@pytest.mark.parametrize("integrator", ["adams_moulton", "runge_kutta_4", "generalized_alpha"])
def test_mechanism_goes_on(tmp_path: Path, integrator: str) -> None:
    """From many ticks, most of them within the integrator's history: nothing else is carried over."""
    scene = SCENES / "subsoiler_1s300_quick.yaml"
    resolved = load_scene(scene, [f"mechanism.integrator={integrator}"])
    first = MechanismEngine(resolved.scene, resolved.timing)
    for tick in range(400):
        first.advance(tick, pulled(resolved, tick))
        if tick % 37 == 0:
            second = MechanismEngine(resolved.scene, resolved.timing)
            second.restore(through_a_file(tmp_path / f"{tick}", first.state_arrays()))
        elif tick > 37:
            second.advance(tick, pulled(resolved, tick))
            assert state_sha256(second.state_arrays()) == state_sha256(first.state_arrays())


def test_paths_go_on() -> None:
    """They are functions of time; the tick is all there is."""
    resolved = load_scene(SCENES / "tine.yaml")
    first, second = (PathEngine(resolved.scene, resolved.timing) for _ in range(2))
    for tick in range(5):
        first.advance(tick)
    second.restore(first.state_arrays())
    assert first.advance(5) == second.advance(5)


def test_another_bed_is_refused(tmp_path: Path) -> None:
    """A state belongs to the bed it began with."""
    maker = SoilMaker(tmp_path)
    soil = {
        "bin": {"length_m": 0.1, "width_m": 0.1, "depth_m": 0.1},
        "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
        "bed": {"kind": "grid", "spacing_m": 0.018},
        "law": WET,
        "time_step_s": STEP_S,
    }
    resolved = maker.scene(soil=soil)
    first, second = build_engine(resolved), build_engine(resolved)
    second.place(np.array([[0.05, 0.0, -0.05]]))
    with pytest.raises(ValueError, match="bed"):
        second.restore(first.state_arrays())
