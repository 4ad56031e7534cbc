"""Time functions and paths: values, integrals, corners."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from subsoil_ros.errors import ProtocolError
from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.mbd.function_tables import (
    NO_FUNCTION,
    function_integral,
    function_rate,
    function_value,
    tabulate,
)
from subsoil_ros.mbd.tool_paths import PathEngine
from subsoil_ros.scene.scene import Scene
from subsoil_ros.scene.time_laws import ConstantLaw, RampLaw, SineLaw, TableLaw

LAWS = {
    "constant": (ConstantLaw(kind="constant", value=1.7), lambda t: 1.7),
    "ramp": (
        RampLaw(kind="ramp", start_value=0.4, end_value=-1.0, start_s=0.5, end_s=1.25),
        lambda t: float(np.interp(t, (0.5, 1.25), (0.4, -1.0))),
    ),
    "sine": (
        SineLaw(kind="sine", mean=0.2, amplitude=1.5, frequency_hz=0.8, phase_rad=0.3),
        lambda t: 0.2 + 1.5 * math.sin(2.0 * math.pi * 0.8 * t + 0.3),
    ),
    "table": (
        TableLaw(kind="table", times_s=(-1.0, 0.5, 0.75, 2.0), values=(3.0, 0.0, 2.0, -2.0)),
        lambda t: float(np.interp(t, (-1.0, 0.5, 0.75, 2.0), (3.0, 0.0, 2.0, -2.0))),
    ),
    "late table": (
        TableLaw(kind="table", times_s=(1.0, 2.0), values=(3.0, 5.0)),
        lambda t: float(np.interp(t, (1.0, 2.0), (3.0, 5.0))),
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_value_and_integral_are_those_of_the_law(name):
    """Value, slope and integral agree with the law's own words and with numerical integration."""
    law, expected = LAWS[name]
    # behind another law, so that offsets into the tables matter
    table, _ = tabulate([SineLaw(kind="sine", amplitude=9.0, frequency_hz=3.0), law])
    for t in (0.0, 0.3, 0.5, 0.6, 1.1, 1.9, 2.6):
        assert function_value(table, 1, t, t) == pytest.approx(expected(t), abs=1e-14)
        integral, _ = quad(expected, 0.0, t, points=[p for p in (0.5, 0.75, 1.0, 1.25, 2.0) if p < t] or None)
        assert function_integral(table, 1, t, t) == pytest.approx(integral, abs=1e-12)
        inside = t + 0.01
        slope = (expected(inside + 1e-6) - expected(inside - 1e-6)) / 2e-6
        assert function_rate(table, 1, inside, inside) == pytest.approx(slope, abs=1e-8)
    assert function_integral(table, NO_FUNCTION, 1.0, 1.0) == 0.0


def test_corner_belongs_to_the_piece_that_is_asked_for():
    """At a corner the slope before or after it is given, as the selecting time says."""
    law = LAWS["ramp"][0]
    table, corners = tabulate([law])
    np.testing.assert_array_equal(corners, [0.5, 1.25])
    assert function_rate(table, 0, 0.5, 0.4) == 0.0
    assert function_rate(table, 0, 0.5, 0.6) == pytest.approx(-1.4 / 0.75)


def _path_scene():
    values = {
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
    path = {
        "start_x_m": -0.1,
        "start_z_m": 0.2,
        "start_angle_rad": 0.3,
        "speed_x_m_per_s": {"kind": "ramp", "end_value": 0.5, "start_s": 0.1, "end_s": 0.3},
        "angular_speed_rad_per_s": {"kind": "constant", "value": -2.0},
    }
    return Scene.model_validate(
        {
            "name": "tine",
            "duration_s": 1.0,
            "soil": {
                "bin": {"length_m": 1.0, "width_m": 0.5, "depth_m": 0.2},
                "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
                "bed": {"kind": "grid", "spacing_m": 0.018},
                "law": {"kind": "cohesive_linear", "particle": values, "boundary": values},
            },
            "tools": {"tine": {"path": path, "lateral_m": 0.05, "groups": {"all": {"mesh": "tine.stl"}}}},
        }
    )


def test_path_is_the_closed_form_integral_of_its_laws():
    """A tool on a path stands where the integrals of its speeds say, to round-off, at any tick."""
    engine = PathEngine(_path_scene(), Timing(1_000_000, 500, 1, 0))
    start = engine.initial_motions()[0]
    assert (start.x_m, start.y_m, start.z_m, start.angle_rad) == (-0.1, 0.05, 0.2, 0.3)
    for tick in range(500):
        motion = engine.advance(tick, ())[0]
    assert motion.x_m == pytest.approx(-0.1 + 0.5 * 0.1 + 0.5 * 0.2, abs=1e-15)
    assert motion.velocity_x_m_per_s == 0.5
    assert motion.z_m == 0.2
    assert motion.angle_rad == pytest.approx(0.3 - 1.0, abs=1e-15)
    assert motion.angular_velocity_rad_per_s == -2.0
    with pytest.raises(ProtocolError, match="tick 7, but the next one is 500"):
        engine.advance(7, ())
