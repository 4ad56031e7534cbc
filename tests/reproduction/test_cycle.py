"""The study of the cycle scene: its cases load, its passive shank is a linear oscillator, its scatter that
of seeds."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from reproduction.yuan_yu_2020 import cycle, cycle_frequency, cycle_runs
from reproduction.yuan_yu_2020.levers import levers_of
from subsoil_ros.analysis.series import Series
from subsoil_ros.loading.loader import load_scene


def test_cases_load(tmp_path):
    """Every sprung case has a scene of its own, and those with a seed another bed."""
    cases = [case for case in cycle_runs.cases() if not case.locked]
    hashes = {case.key: load_scene(cycle_runs.scene_of(case, tmp_path)).scene_hash for case in cases}
    assert len(set(hashes.values())) == len(cases) >= 17
    base = load_scene(cycle_runs.SCENE)
    assert base.timing.soil_step_s == pytest.approx(cycle_runs.STEP_S)
    third = next(case for case in cases if case.name == "a third of the step")
    timing = load_scene(cycle_runs.scene_of(third, tmp_path)).timing
    assert timing.soil_step_s == pytest.approx(cycle_runs.STEP_S / 3.0, rel=1e-4)


def test_ground_keeps_the_depth(tmp_path):
    """On a stiffer ground that stands higher the wheels bear the same weight at the same height."""
    cases = {case.name: case for case in cycle_runs.cases()}
    for name, factor in (("wheel ground times 4", 4.0), ("wheel ground times 7", 7.0)):
        force = load_scene(cycle_runs.scene_of(cases[name], tmp_path)).scene.mechanism.forces["ground_left"]
        axle_m = 0.20 - cycle_runs.SINKAGE_M
        assert force.stiffness_newton_per_m == factor * 28000.0
        sunk = force.ground_z_m + force.radius_m - axle_m
        assert force.stiffness_newton_per_m * sunk == pytest.approx(28000.0 * cycle_runs.SINKAGE_M)


@pytest.mark.parametrize("ratio", [0.0, 0.5, 2.0])
def test_passive_shank(ratio):
    """A soil force along x that swings about a mean: the spring's mean is moment over arm, its amplitude
    that of a linear oscillator, |k + i w c| / |k - J w^2 + i w c| times the moment's over the arm (Den
    Hartog)."""
    scene = load_scene(cycle_runs.SCENE)
    levers = levers_of(scene.scene)
    assert levers is not None
    body = scene.scene.mechanism.bodies["shank"]
    omega = ratio * 2.0 * math.pi * levers.frequency_hz
    times = np.arange(0.0, 6.0, 1e-3)
    push = -1000.0 - 200.0 * np.sin(omega * times)
    zero = np.zeros_like(times)
    columns = {
        "time_s": times,
        "body.shank.angle_rad": zero + body.angle_rad,
        "tool.shank.force_x_newton": push,
        "tool.shank.force_z_newton": zero,
        "tool.shank.torque_y_newton_m": -0.4 * push,  # 0.4 m below the centre of mass: z F_x
    }
    run = SimpleNamespace(series=Series(columns, "run", 0.0), scene=scene)
    force = cycle_frequency.through_the_shank(run, levers, 1000.0)[times > 3.0]
    lever = 0.25 + 0.4  # of the force, below the hinge
    assert force.mean() == pytest.approx(1000.0 * lever / 0.25, rel=0.01)
    damping = 1000.0 * 0.25**2
    stiffness, inertia = levers.stiffness_newton_m_per_rad, levers.inertia_kg_m2
    spring = complex(stiffness, omega * damping)
    gain = abs(spring) / abs(spring - inertia * omega**2)
    expected = 200.0 * lever / 0.25 * gain * (ratio > 0.0)
    assert 0.5 * np.ptp(force) == pytest.approx(expected, rel=0.02, abs=1.0)


@pytest.mark.parametrize("soil_newton_per_m", cycle_frequency.TRAVEL_MODELS.values())
def test_shank_over_the_travel(soil_newton_per_m):
    """A soil of one strength holds the shank at rest under moment over arm; one whose strength falls to
    nothing at a place throws it forward once, and then its spring swings about zero and comes to rest."""
    scene = load_scene(cycle_runs.SCENE)
    levers = levers_of(scene.scene)
    body = scene.scene.mechanism.bodies["shank"]
    times = np.arange(0.0, 4.0, 1e-3)
    zero = np.zeros_like(times)
    for falls in (False, True):
        push = np.where(falls & (times > 1.0), 0.0, -1000.0)
        columns = {
            "time_s": times,
            "body.shank.x_m": 0.5 * times,
            "body.shank.z_m": zero + body.position_m[1],
            "body.shank.angle_rad": zero + body.angle_rad,
            "tool.shank.force_x_newton": push,
            "tool.shank.force_z_newton": zero,
            "tool.shank.torque_y_newton_m": -0.4 * push,
        }
        run = SimpleNamespace(series=Series(columns, "run", 0.0), scene=scene)
        force = cycle_frequency.over_the_travel(run, levers, 1000.0, soil_newton_per_m)
        held = 1000.0 * (0.25 + 0.4) / 0.25
        if falls:
            assert force[times < 0.9] == pytest.approx(held, rel=1e-6)
            assert force.min() < -0.5 * held  # a damping ratio of 0.13 leaves 0.66 of the first swing
            assert force[-1] == pytest.approx(0.0, abs=1.0)
        else:
            assert force == pytest.approx(held, rel=1e-6)


def test_pooled_scatter():
    """Two cases of two seeds, 10 and 5 % off their means, have a freedom each; a case of one seed has
    none."""
    rows = [
        {"case": case, "x": value}
        for case, value in (("a", 9.0), ("a", 11.0), ("b", 19.0), ("b", 21.0), ("c", 5.0))
    ]
    scatter, freedoms = cycle.pooled_scatter(rows, "x")
    assert freedoms == 2
    assert scatter == pytest.approx(math.sqrt((2.0 * 0.1**2 + 2.0 * 0.05**2) / 2.0))
