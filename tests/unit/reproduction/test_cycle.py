"""The study of the cycle scene: its cases load, its passive shank is a linear oscillator, its scatter that
of seeds."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from reproduction.yuan_yu_2020 import cycle, cycle_frequency, cycle_record, cycle_runs
from reproduction.yuan_yu_2020.levers import levers_of
from subsoil_ros.analysis.series import Series
from subsoil_ros.loading.loader import load_scene


@pytest.mark.full
def test_cases_load(tmp_path):
    """Every sprung case has a scene of its own, and those with a seed another bed."""
    cases = [case for case in cycle_runs.cases() if not case.locked]
    hashes = {case.key: load_scene(cycle_runs.scene_of(case, tmp_path)).scene_hash for case in cases}
    assert len(set(hashes.values())) == len(cases) >= 17
    base = load_scene(cycle_runs.SCENE)
    assert base.timing.soil_step_s == pytest.approx(cycle_runs.STEP_S)
    half = next(case for case in cases if case.name == "half the step")
    timing = load_scene(cycle_runs.scene_of(half, tmp_path)).timing
    assert timing.soil_step_s == pytest.approx(cycle_runs.STEP_S / 2.0, rel=1e-4)


def test_ground_keeps_the_depth(tmp_path):
    """On a stiffer ground that stands higher the wheels bear the same weight at the same height."""
    cases = {case.name: case for case in cycle_runs.cases()}
    path = cycle_runs.scene_of(cases["wheel ground times 4"], tmp_path)
    force = load_scene(path).scene.mechanism.forces["ground_left"]
    axle_m = 0.20 - cycle_runs.SINKAGE_M
    assert force.stiffness_newton_per_m == 4.0 * 28000.0
    sunk = force.ground_z_m + force.radius_m - axle_m
    assert force.stiffness_newton_per_m * sunk == pytest.approx(28000.0 * cycle_runs.SINKAGE_M)


@pytest.mark.full
def test_springs_are_as_long(tmp_path):
    """Under the mean force every spring has the length of the declared one, and its damping ratio."""

    def spring_of(path):
        return load_scene(path).scene.mechanism.forces["H9_spring"]

    def at_work_m(spring):
        return spring.free_length_m - cycle_runs.SPRING_NEWTON / spring.stiffness_newton_per_m

    declared = spring_of(cycle_runs.SCENE)
    for case in cycle_runs.cases():
        if case.name.startswith("spring times"):
            other = spring_of(cycle_runs.scene_of(case, tmp_path))
            factor = other.stiffness_newton_per_m / declared.stiffness_newton_per_m
            assert factor == pytest.approx(float(case.name.split()[-1]))
            assert at_work_m(other) == pytest.approx(at_work_m(declared))
            ratio = other.damping_newton_s_per_m / declared.damping_newton_s_per_m
            assert ratio == pytest.approx(math.sqrt(factor))


def test_stiffer_contacts_are_as_strong(tmp_path):
    """Attraction and friction are those of the declared law."""
    cases = {case.name: case for case in cycle_runs.cases()}
    path = cycle_runs.scene_of(cases["stiffness times 4"], tmp_path)
    stiff, plain = (load_scene(one).document["soil"]["law"]["particle"] for one in (path, cycle_runs.SCENE))
    assert stiff["stiffness_newton_per_m"] == 4.0 * plain["stiffness_newton_per_m"]
    for row in (stiff, plain):
        row["attraction"] = row["stiffness_newton_per_m"] * row["equilibrium_overlap_m"]
    for key in ("attraction", "cohesive_stiffness_newton_per_m", "cohesion_range_m", "static_friction"):
        assert stiff[key] == pytest.approx(plain[key])


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
        run = SimpleNamespace(series=Series(columns, "run", 0.0), scene=scene, tip_m=(0.5 * times, zero))
        force = cycle_frequency.over_the_travel(run, levers, 1000.0, soil_newton_per_m)
        held = 1000.0 * (0.25 + 0.4) / 0.25
        if falls:
            assert force[times < 0.9] == pytest.approx(held, rel=1e-6)
            assert force.min() < -0.5 * held  # a damping ratio of 0.13 leaves 0.66 of the first swing
            assert force[-1] == pytest.approx(0.0, abs=1.0)
        else:
            assert force == pytest.approx(held, rel=1e-6)


def test_phases():
    """A spring that follows the draft by 20 ms, an angle that is its opposite."""
    times = np.arange(0.0, 6.0, 2e-3)
    draft = np.sin(2.0 * math.pi * 2.0 * times) + np.sin(2.0 * math.pi * 3.1 * times)
    columns = {
        "time_s": times,
        "draft_newton": draft,
        "tool.shank.force_x_newton": -draft,
        "spring.H9_spring.force_newton": np.interp(times - 0.02, times, draft),
        "body.shank.angle_rad": -draft,
        "body.shank.z_m": draft,
    }
    run = SimpleNamespace(
        series=Series(columns, "run", 0.0),
        case=cycle_runs.Case("a", {}),
        column=lambda name, _: columns[name],
    )
    found = {row["quantity"]: row for row in cycle.phases(run)}
    assert found["spring force"]["lag_s"] == pytest.approx(0.02)
    assert found["spring force"]["largest"] == pytest.approx(1.0, abs=0.01)
    assert found["share angle"]["correlation"] == pytest.approx(-1.0)
    assert found["height of the shank"]["lag_s"] == pytest.approx(0.0, abs=1e-9)


def test_over_travel():
    """A tip that stands and is thrown on: what it meets is laid over the way it has come."""
    tip = np.r_[np.linspace(0.0, 1.0, 500), np.full(300, 1.0), np.linspace(1.0, 3.0, 200)]
    run = SimpleNamespace(tip_m=(tip, tip), rows=np.ones(len(tip), bool))
    step, values = cycle_record.Run.over_travel(run, 10.0 * tip)
    assert step * len(values) == pytest.approx(3.0)
    assert values == pytest.approx(10.0 * step * np.arange(len(values)), abs=0.05)
