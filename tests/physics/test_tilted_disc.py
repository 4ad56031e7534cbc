"""The example examples/tilted_disc: its mesh, and a short run of it."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import subsoil_ros as subsoil
from subsoil_ros.scene.tool_mesh import load_tool_mesh

EXAMPLE = Path(__file__).parents[2] / "examples" / "tilted_disc"
SHORT = {
    "duration_s": 0.12,
    "soil.bin.length_m": 0.3,
    "tools.disc.path.start_x_m": 0.07,
    "record.series_ticks": 40,
}


def rotation(disc_angle_deg: float) -> list[float]:
    """start_rotation_rad of a disc angle, tilted by 15 degrees."""
    tilt = Rotation.from_rotvec((np.radians(15.0), 0.0, 0.0))
    return (Rotation.from_rotvec((0.0, 0.0, np.radians(disc_angle_deg))) * tilt).as_rotvec().tolist()


def test_the_mesh_is_that_of_the_generator_and_the_numbers_are_those_of_the_text() -> None:
    """Vertices to the float32 of the file; rotation vector and inertia as the comments say."""
    spec = importlib.util.spec_from_file_location("make_mesh", EXAMPLE / "make_mesh.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    resolved = subsoil.load_scene(EXAMPLE / "disc.yaml")
    written = load_tool_mesh(resolved.directory, resolved.scene, "disc").vertices_m
    made = module.disc().vertices
    assert_allclose(np.sort(written, axis=0), np.sort(made, axis=0), atol=1e-8)
    turn = resolved.scene.tools["disc"].path.turn
    assert_allclose(turn.start_rotation_rad, rotation(40.0), atol=1e-6)
    mass = 7850.0 * np.pi * module.RADIUS_M**2 * module.THICKNESS_M
    assert_allclose(turn.free.inertia_kg_m2, 0.5 * mass * module.RADIUS_M**2, rtol=0.01)


@pytest.mark.full
def test_the_disc_rolls_and_is_pushed_aside(tmp_path: Path) -> None:
    """Travel turns it forward; draft is positive; the side force changes its sign with the disc angle."""
    sides = []
    for angle in (40.0, -40.0):
        scene = subsoil.load_scene(
            EXAMPLE / "disc.yaml", SHORT | {"tools.disc.path.turn.start_rotation_rad": rotation(angle)}
        )
        run = subsoil.run(scene, tmp_path / f"{angle:g}")
        assert run.failure is None
        axis = Rotation.from_rotvec(rotation(angle)).apply((0.0, 1.0, 0.0))
        spin = run.series[[f"tool.disc.angular_velocity_{name}_rad_per_s" for name in "xyz"]].to_numpy()
        assert spin[-1] @ axis > 0.2
        assert_allclose(spin - np.outer(spin @ axis, axis), 0.0, atol=1e-12)
        rows = run.series[run.series["time_s"] > 0.04]
        assert rows["draft_newton"].mean() > 1.0
        sides.append(rows["tool.disc.force_y_newton"].mean())
        document = json.loads((tmp_path / f"{angle:g}" / "summary.json").read_text())
        assert document["energy"]["residual_ratio"] < 0.02
    assert sides[0] > 0.3
    assert sides[1] < -0.3
