"""The terrain model: mass, slopes, closed forms of its pressures, what a bucket holds, and its state."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_array_equal

from subsoil_ros.loading.loader import load_scene
from subsoil_ros.mbd.tool_paths import PathEngine
from subsoil_ros.messages import ToolWrench
from subsoil_ros.scene.tool_mesh import ToolMesh
from subsoil_ros.terrain.dig_forces import _pressures
from subsoil_ros.terrain.terrain_engine import TerrainEngine
from subsoil_ros.terrain.terrain_field import Ground, slide, stands
from subsoil_ros.terrain.tool_shape import PITCHES_RAD, held_m3, tool_shape, views
from subsoil_ros.wedge.failure_wedge import Plate, Strength, failure
from validation.digs import poses

GAMMA = 15_000.0
SAND: dict[str, Any] = {
    "density_kg_per_m3": GAMMA / 9.81, "cohesion_pa": 0.0, "friction_angle_rad": 0.55,
    "loose_friction_angle_rad": 0.55, "adhesion_pa": 0.0, "tool_friction_angle_rad": 0.35,
}  # fmt: skip
BUCKET = Path(__file__).parents[2] / "examples" / "bucket_arm" / "bucket.stl"
TICK_S = 0.005


@pytest.fixture
def dig(tmp_path: Path) -> Callable[..., tuple[TerrainEngine, list[ToolWrench]]]:
    """Moves a mesh along a path through a terrain; its engine, and the wrenches of all ticks."""

    def run(mesh: trimesh.Trimesh | Path, path: dict[str, Any], ticks: int, **soil: Any) -> Any:
        file = mesh if isinstance(mesh, Path) else tmp_path / "tool.stl"
        if not isinstance(mesh, Path):
            mesh.export(file)
        values = SAND | soil.pop("values", {})
        box = {"length_m": 1.0, "width_m": 0.8, "depth_m": 0.3}
        scene = load_scene(
            {
                "name": "terrain",
                "duration_s": 3.0,
                "soil": {"model": "terrain", "bin": box, "values": values, **soil},
                "tools": {"tool": {"path": path, "groups": {"tool": {"mesh": str(file)}}}},
                "coupling": {"communication_step_ns": round(TICK_S * 1e9)},
            }
        )
        engine, paths = TerrainEngine(scene), PathEngine(scene.scene, scene.timing)
        motions = paths.initial_motions()
        wrenches = [*engine.start(motions)]
        for tick in range(ticks):
            motions = paths.advance(tick, tuple(wrenches[-1:]))
            wrenches += engine.advance(tick, motions)
        return engine, wrenches, (paths, scene)

    return run


def mesh_of(solid: trimesh.Trimesh) -> ToolMesh:
    """A tool of one group."""
    facets = np.asarray(solid.faces, dtype=np.int32)
    return ToolMesh(np.asarray(solid.vertices), facets, np.zeros(len(facets), dtype=np.int32), ("tool",))


def volume_m3(engine: TerrainEngine) -> float:
    """Of all soil, as if it were loose."""
    ground, carried = engine._ground, engine._tools[0].cavity.carried_m
    firm = ground.swell * (ground.firm_m - ground.lowest_m)
    return ground.cell_m**2 * float((firm + ground.loose_m).sum() + carried.sum() + ground.spilled_m[0])


def ground_of(top_m: np.ndarray, loose_m: np.ndarray, **changes: float) -> Ground:
    """A ground of cells of 20 mm, without a tool."""
    ground = Ground(
        top_m - loose_m, loose_m, np.full(top_m.shape, np.inf), np.zeros(1), (0.0, 0.0), 0.02, -1.0, 0.5,
        0.55, 1.1, 0.0, 0.0,
    )  # fmt: skip
    return ground._replace(**changes)


def settled(ground: Ground) -> np.ndarray:
    """Heights once nothing slides any more."""
    found = np.zeros(4, dtype=np.int64)
    for _ in range(4000):
        if slide(ground, np.array([0, 0, *ground.firm_m.shape]), found) < 1e-7:
            break
    return ground.firm_m + ground.loose_m


@pytest.mark.parametrize("cohesion", [0.0, 5e3])
def test_a_dig_loses_no_soil(dig, cohesion: float) -> None:
    """Cut, pushed, carried, slid, dropped beside: the volume stays to round-off."""
    values = {"cohesion_pa": cohesion, "loose_cohesion_pa": 0.4 * cohesion, "loose_friction_angle_rad": 0.45}
    engine, wrenches, _ = dig(BUCKET, {"poses": poses("A")}, 600, values=values)
    assert volume_m3(engine) == pytest.approx(1.1 * 0.3 * 1.0 * 0.8, rel=1e-12)
    carried = engine._tools[0].cavity.carried_m.sum() * 0.02**2
    assert carried > 1e-3
    assert wrenches[-1].force_z_newton == pytest.approx(-carried * GAMMA / 1.1, rel=1e-9)
    assert max(wrench.force_x_newton for wrench in wrenches) > 50.0


def test_loose_soil_rests_at_its_friction_angle() -> None:
    """A heap poured on a plane ends as a cone of that slope, and keeps its volume."""
    loose = np.zeros((41, 41))
    loose[20, 20] = 8.0
    ground = ground_of(loose.copy(), loose)
    top = settled(ground)
    assert top.sum() == pytest.approx(8.0, rel=1e-12)
    steepest = np.abs(np.diff(top[20])).max() / 0.02
    assert steepest == pytest.approx(math.tan(0.5), abs=1e-3)
    radius = (3.0 * 8.0 * 0.02**2 / (math.pi * math.tan(0.5))) ** (1.0 / 3.0)
    assert top.max() == pytest.approx(radius * math.tan(0.5), rel=0.1)  # eight directions: no round cone


@pytest.mark.parametrize(("part", "stays"), [(0.95, True), (1.05, False)])
def test_a_bank_stands_up_to_culmanns_height(part: float, stays: bool) -> None:
    """An upright one up to 4 c / gamma cos(phi) / (1 - sin(phi)) = 4 c / gamma tan(45 + phi / 2)."""
    over = 0.05
    upright = 4.0 * over * math.tan(0.25 * math.pi + 0.275)
    assert stands(over, 0.55, part * upright, 1e-9) == stays
    slope = math.atan2(part * upright, 0.02)  # over one cell of 20 mm it may be higher
    higher = 4.0 * over * math.sin(slope) * math.cos(0.55) / (1.0 - math.cos(slope - 0.55))
    top = np.zeros((20, 12))
    top[:10] = part * higher
    ground = ground_of(top.copy(), np.zeros_like(top), cohesion_height_m=over)
    assert (np.abs(settled(ground) - top).max() < 1e-9) == stays


def test_pressures_have_closed_limits() -> None:
    """A wide smooth wall: Rankine's; a footing: Prandtl's N_q and N_c."""
    soil = Strength(GAMMA, 1500.0, 2e3, 0.55, 0.0, 0.0, 0.0, 0.0)
    k = math.tan(0.25 * math.pi + 0.275) ** 2
    by_weight, more = _pressures(0.5 * math.pi, 1e4, 0.1, soil, 0.0)
    assert by_weight == pytest.approx(k * GAMMA, rel=1e-3)
    assert more == pytest.approx(2.0 * math.sqrt(k) * 2e3, rel=1e-3)
    by_weight, more = _pressures(math.pi, 1e4, 0.1, soil, 0.0)
    n_q = k * math.exp(math.pi * math.tan(0.55))
    assert by_weight == pytest.approx(n_q * GAMMA, rel=1e-3)
    assert more / 2e3 == pytest.approx((n_q - 1.0) / math.tan(0.55), rel=1e-3)
    clay = soil._replace(friction=0.0)
    assert _pressures(math.pi, 1e4, 0.1, clay, 0.0)[1] / 2e3 == pytest.approx(math.pi + 2.0, rel=1e-3)


def test_a_blade_meets_the_force_of_the_wedge_before_it(dig) -> None:
    """McKyes and Ali's, before a heap has grown: 4 mm after it begins to move. The wedge slides up along
    the blade, so its force has the angle of friction to the normal, upwards."""
    blade = trimesh.creation.box((0.02, 0.3, 0.4))
    path = {"start_x_m": 0.503, "start_z_m": 0.1, "speed_x_m_per_s": {"kind": "constant", "value": 0.05}}
    _, wrenches, _ = dig(blade, path, 16, cell_m=0.01)
    soil = Strength(GAMMA, GAMMA / 9.81, 0.0, 0.55, 0.0, 0.35, 0.0, 1.0)
    expected = failure(Plate(0.3, 0.5 * math.pi, 0.1, 0.1), soil, 0.05).force * math.cos(0.35)
    assert -wrenches[-1].force_x_newton == pytest.approx(expected, rel=0.15)
    assert wrenches[-1].force_z_newton == pytest.approx(expected * math.tan(0.35), rel=0.15)
    assert abs(wrenches[-1].force_y_newton) < 1e-9 * expected


def test_a_box_holds_its_volume() -> None:
    """Open on top, of thin walls: seen upright and, turned by 30 degrees, up to its lower rim."""
    wall, (a, b, h) = 0.004, (0.3, 0.2, 0.15)
    plates = [
        trimesh.creation.box(extents, trimesh.transformations.translation_matrix(at))
        for extents, at in (
            ((a, b, wall), (0, 0, 0)),
            ((wall, b, h), (0.5 * a, 0, 0.5 * h)), ((wall, b, h), (-0.5 * a, 0, 0.5 * h)),
            ((a, wall, h), (0, 0.5 * b, 0.5 * h)), ((a, wall, h), (0, -0.5 * b, 0.5 * h)),
        )
    ]  # fmt: skip
    solid = trimesh.util.concatenate(plates)
    scene_mesh = mesh_of(solid)
    seen = zip(np.degrees(PITCHES_RAD).round(1), views(scene_mesh, 0.01), strict=True)
    found = {pitch: held_m3(view, 0.01) for pitch, view in seen}
    assert found[0.0] == pytest.approx(a * b * h, rel=0.08)
    assert found[30.0] == pytest.approx(b * (a * h - 0.5 * a * a * math.tan(math.pi / 6)), rel=0.15)
    assert found[90.0] == 0.0
    assert views(mesh_of(trimesh.creation.box((0.02, 0.3, 0.4))), 0.02) == ()
    shape = tool_shape(scene_mesh, 0.01)
    assert shape.areas_m2.sum() == pytest.approx(solid.area, rel=1e-6)


def test_a_restored_terrain_goes_on_alike(dig) -> None:
    """All of the state is in state_arrays: the same wrenches to the bit."""
    engine, wrenches, (paths, scene) = dig(BUCKET, {"poses": poses("B")}, 300)
    other = TerrainEngine(scene)
    other.restore({name: np.copy(array) for name, array in engine.state_arrays().items()})
    for tick in range(300, 420):
        motions = paths.advance(tick, tuple(wrenches[-1:]))
        assert engine.advance(tick, motions) == other.advance(tick, motions)
    for name, array in engine.state_arrays().items():
        assert_array_equal(array, other.state_arrays()[name])
    assert len(engine.cloud(420, 0).positions_m) > 50 * 40
