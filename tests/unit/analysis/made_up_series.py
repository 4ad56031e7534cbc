"""Series of the machine with known numbers."""

import math
from pathlib import Path

import numpy as np
import yaml

from subsoil_ros.analysis.loads import loads_of
from subsoil_ros.analysis.metrics_window import Window
from subsoil_ros.analysis.series import Series
from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.analysis.summarize import RunStatistics
from subsoil_ros.loading.loader import ResolvedScene, load_scene

SCENES = Path(__file__).parents[3] / "config/scenes"
ROWS = 2001
STEP_S = 0.001


def made_up(resolved: ResolvedScene) -> Series:
    """Steady pull at 0.5 m/s: every part carries a known share of the machine, the draft swings by a sine."""
    scene = resolved.scene
    times = STEP_S * (1 + np.arange(ROWS))
    columns = {"time_s": times, "draft_newton": 700.0 + 300.0 * np.sin(2.0 * math.pi * 2.0 * times)}
    level = np.ones(ROWS)
    for name, joint in scene.mechanism.joints.items():  # between bodies they carry nothing
        columns[f"joint.{name}.force_z_newton"] = (0.0 if joint.kind == "driver" else 1e6) * level
    for name, body in scene.mechanism.bodies.items():
        columns[f"body.{name}.x_m"] = body.position_m[0] + 0.5 * times
        columns[f"body.{name}.z_m"] = body.position_m[1] * level
        columns[f"body.{name}.angle_rad"] = body.angle_rad * level
        columns[f"body.{name}.velocity_x_m_per_s"] = 0.5 * level
        columns[f"body.{name}.acceleration_z_m_per_s2"] = 0.2 * level
    for name, (force_x, force_z) in {
        "shank": (-600.0, -200.0), "wheel_left": (-50.0, 600.0), "wheel_right": (-50.0, 610.0)
    }.items():  # fmt: skip
        columns |= {
            f"tool.{name}.force_x_newton": force_x * level, f"tool.{name}.force_z_newton": force_z * level,
            f"tool.{name}.torque_y_newton_m": 4.0 * level, f"tool.{name}.velocity_x_m_per_s": 0.5 * level,
            f"tool.{name}.velocity_z_m_per_s": 0.1 * level,
            f"tool.{name}.angular_velocity_rad_per_s": -2.5 * level,
        }  # fmt: skip
    columns["joint.H1_rail.force_z_newton"] = 1300.0 * level
    columns["coordinate_spring.chain.force_newton"] = 5.0 * level
    spring = scene.mechanism.forces["H9_spring"]
    force = 2.5 * columns["draft_newton"]
    columns["spring.H9_spring.force_newton"] = force
    columns["spring.H9_spring.length_m"] = spring.free_length_m - force / spring.stiffness_newton_per_m
    return Series(columns, "run", 1.0)


def whole(series: Series) -> Window:
    """A window of all rows."""
    return Window(np.ones(len(series), dtype=bool), "all", False)


def statistics_of(series: Series, resolved: ResolvedScene, window: Window) -> RunStatistics:
    """Without soil."""
    steady = stationarity(series["time_s"], series["draft_newton"])
    loads = loads_of(series, resolved, window)
    return RunStatistics(loads, {"draft_newton": steady}, {}, None, None, None, {}, {}, None, {})


def two_ranks(folder: Path, **changes: object) -> ResolvedScene:
    """Two tines of one kind in a bin 3 m long, `rear` 1 m behind `front`."""
    tine = yaml.safe_load((SCENES / "tine.yaml").read_text())["tools"]["tine"]
    for part in tine["groups"].values():
        part["mesh"] = str(SCENES / part["mesh"])
    rear = {**tine, "path": {**tine["path"], "start_x_m": -1.17}}
    document = {
        "base": str(SCENES / "tine.yaml"),
        "duration_s": 8.0,
        "soil": {"bin": {"length_m": 3.0}},
        "tools": {"tine": None, "front": tine, "rear": rear},
        **changes,
    }
    (folder / "scene.yaml").write_text(yaml.safe_dump(document))
    return load_scene(folder / "scene.yaml")


def pulled(resolved: ResolvedScene, times_s: np.ndarray, speeds: tuple[float, ...], draft: float) -> Series:
    """Tools on level paths at constant speeds; each draws `draft` [N] while its tip is in the bin."""
    columns = {"time_s": times_s, "draft_newton": np.zeros(len(times_s))}
    length_m, tip_x_m = resolved.scene.soil.bin.length_m, resolved.scene.report.tip_m[0]
    for (name, tool), speed in zip(resolved.scene.tools.items(), speeds, strict=True):
        x = tool.path.start_x_m + speed * times_s
        force = np.where((x + tip_x_m >= 0.0) & (x + tip_x_m <= length_m), draft, 0.0)
        level = np.ones(len(times_s))
        columns |= {
            f"tool.{name}.x_m": x, f"tool.{name}.z_m": tool.path.start_z_m * level,
            f"tool.{name}.angle_rad": 0.0 * level, f"tool.{name}.velocity_x_m_per_s": speed * level,
            f"tool.{name}.velocity_z_m_per_s": 0.0 * level,
            f"tool.{name}.angular_velocity_rad_per_s": 0.0 * level,
            f"tool.{name}.force_x_newton": -force, f"tool.{name}.force_z_newton": 0.0 * level,
            f"tool.{name}.torque_y_newton_m": 0.0 * level,
        }  # fmt: skip
        columns["draft_newton"] = columns["draft_newton"] + force
    return Series(columns, "run", 1.0)
