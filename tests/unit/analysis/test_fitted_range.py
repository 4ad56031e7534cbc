"""What a tool does outside the range in which its wedge model was fitted, from series by hand."""

import math

import numpy as np
import pytest

from subsoil_ros.analysis.columns import TIME, PlanarTool
from subsoil_ros.analysis.fitted_range import extrapolated, words
from subsoil_ros.analysis.metrics_window import Window
from subsoil_ros.analysis.series import Series
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.tool_faces import cutting_faces
from subsoil_ros.scene.tool_mesh import load_tool_mesh

AT = PlanarTool("shank")


def test_rake_depth_and_speed_outside_the_fit() -> None:
    """A fifth of the time the share stands 3 degrees too steep; 0.14 to 0.26 m, 0.5 to 4 m/s are fitted."""
    found = load_scene("field_swing", ["preset=real_time"])
    scene, count = found.scene, 100
    share = cutting_faces(load_tool_mesh(found.directory, scene, "shank"), "")[0]
    fitted_to = 0.6363323
    steep = share.rake_rad - fitted_to - math.radians(3.0)
    reference = scene.mechanism.bodies["shank"].angle_rad
    turn = np.where(np.arange(count) < 20, steep, -0.05)
    ahead, up = share.tip_m
    below = np.sin(turn) * ahead + np.cos(turn) * up
    columns = {
        TIME: np.linspace(0.01, 1.0, count),
        AT.angle_rad: reference + turn,
        AT.z_m: -0.2 - below,
        AT.velocity_x_m_per_s: np.where(np.arange(count) < 50, 0.0, 1.0),
        AT.angular_velocity_rad_per_s: np.zeros(count),
    }
    window = Window(np.ones(count, np.bool_), "all", False)
    (item,) = extrapolated(Series(columns, "run", 1.0), found, window)["shank"].items()
    assert item[0] == "rake_rad"
    assert item[1]["part"] == pytest.approx(0.2)
    assert item[1]["largest"] == pytest.approx(fitted_to + math.radians(3.0), abs=1e-6)
    assert words("shank", *item).startswith(
        "shank: rake 27.9 to 39.5 deg, in 20 % of the window outside 25 to 36.5"
    )
    fast = {**columns, AT.velocity_x_m_per_s: np.full(count, 5.0), AT.z_m: -0.3 - below}
    far = extrapolated(Series(fast, "run", 1.0), found, window)["shank"]
    assert {key: value["part"] for key, value in far.items()} == {
        "depth_m": 1.0, "speed_m_per_s": 1.0, "rake_rad": pytest.approx(0.2),
    }  # fmt: skip
    particles = load_scene("field_swing")
    assert extrapolated(Series(fast, "run", 1.0), particles, window) == {}
