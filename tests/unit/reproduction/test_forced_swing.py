"""The soil's work on a swing that is known, and its moment about the hinge."""

import math
from pathlib import Path

import numpy as np
import pytest

from reproduction.yuan_yu_2020.forced_swing import (
    damper_of_spring,
    moment_of_soil,
    soil_on_swing,
    swung_shank,
)
from subsoil_ros.loading.loader import load_scene

MACHINE = Path(__file__).parents[3] / "config/scenes/subsoiler_1s300.yaml"


@pytest.mark.parametrize(("damper", "spring"), [(40.0, 3000.0), (-25.0, -500.0)])
def test_a_damper_is_found_again_beside_a_spring(damper, spring):
    """M = M_0 - C w - K q with a mean, a part of a period at the beginning and noise."""
    rng = np.random.default_rng(2)
    times = np.arange(0.0, 4.07, 1e-3)
    swing = 2.0 * np.pi * 3.0
    angle, rate = 0.05 * np.sin(swing * times), 0.05 * swing * np.cos(swing * times)
    moment = -1200.0 - damper * rate - spring * angle + rng.normal(0.0, 50.0, len(times))
    periods, power, half, found, half_damper = soil_on_swing(times, rate, moment, 3.0)
    assert periods == 12
    assert found == pytest.approx(damper, abs=max(5.0, 2.0 * half_damper))
    assert power == pytest.approx(-damper * (rate**2).mean(), rel=0.1, abs=2.0 * half)
    with pytest.raises(ValueError, match=r"fewer than two periods of 0\.3 Hz"):
        soil_on_swing(times, rate, moment, 0.3)


def test_moment_about_the_hinge_does_the_work_of_the_forces():
    """A turn of the shank about its hinge: force times way and moment times turn, about whatever point."""
    scene = load_scene(MACHINE).scene
    body, hinge = scene.mechanism.bodies["shank"], complex(0.0, 0.40)
    turn, force, torque_y = 0.01, complex(-900.0, 200.0), -35.0
    arm = complex(*body.position_m) - hinge
    place = hinge + arm
    series = {
        "body.shank.angle_rad": body.angle_rad, "body.shank.x_m": place.real, "body.shank.z_m": place.imag,
        "tool.shank.x_m": place.real, "tool.shank.z_m": place.imag, "tool.shank.force_x_newton": force.real,
        "tool.shank.force_z_newton": force.imag, "tool.shank.torque_y_newton_m": torque_y,
    }  # fmt: skip
    moment = moment_of_soil({name: np.array([value]) for name, value in series.items()}, scene, hinge)[0]
    way = hinge + arm * complex(math.cos(turn), math.sin(turn)) - place
    work = force.real * way.real + force.imag * way.imag - torque_y * turn
    assert moment * turn == pytest.approx(work, rel=0.01)


def test_a_shank_that_is_swung_starts_at_rest_behind_its_mean_angle():
    """A driver in the place of the spring; the rate is amplitude times 2 pi f."""
    resolved = load_scene(MACHINE)
    document = swung_shank(resolved, -0.16, 0.05, 3.0)
    joint = document["mechanism"]["joints"]["shank_lock"]
    assert joint["speed"] == {
        "kind": "sine",
        "amplitude": pytest.approx(0.05 * 6.0 * math.pi),
        "frequency_hz": 3.0,
    }
    assert "H9_spring" not in document["mechanism"]["forces"]
    assert document["mechanism"]["initial"]["coordinates"]["shank.angle_rad"] == pytest.approx(
        -0.21, abs=2e-3
    )


def test_damper_of_the_spring_is_on_its_arm_squared():
    """1000 N s/m at 0.25 m in the reference pose, where spring and arm are square."""
    assert damper_of_spring(load_scene(MACHINE).scene, 0.0) == pytest.approx(62.5)
