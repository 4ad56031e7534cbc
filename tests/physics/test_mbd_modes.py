"""Statics and modes against closed forms and the engine's own motion; steps above the stability bound."""

import argparse
import math

import numpy as np
import pytest

from subsoil_ros.cli import check
from subsoil_ros.cli.main import main
from subsoil_ros.errors import PhysicsError, SceneError
from subsoil_ros.mbd.statics import survey
from subsoil_ros.scene.mechanism import Mechanism

MASS, INERTIA, ARM = 2.0, 0.06, 0.5


def _survey(machine):
    return survey(Mechanism.model_validate(machine))


def _pin(body_a, body_b, x, z):
    return {"kind": "revolute", "body_a": body_a, "body_b": body_b, "point_m": (x, z)}


def _rod(x, z, **rest):
    return {"mass_kg": MASS, "inertia_kg_m2": INERTIA, "position_m": (x, z), **rest}


def _slider(damping):
    """A mass hanging on a vertical spring-damper of 800 N/m."""
    return {
        "bodies": {"mass": _rod(0.0, -0.6)},
        "joints": {"rail": {"kind": "prismatic", "body_a": "ground", "body_b": "mass", "point_m": (0.0, 0.0),
                            "axis": (0.0, 1.0)}},
        "forces": {"spring": {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0),
                              "body_b": "mass", "point_b_m": (0.0, -0.6), "free_length_m": 0.5,
                              "stiffness_newton_per_m": 800.0, "damping_newton_s_per_m": damping}},
    }  # fmt: skip


def test_pendulum_swings_at_its_frequency():
    """A hanging rod: sqrt(m g d / J), undamped; its stiffness comes from the loaded pin alone."""
    machine = {"bodies": {"rod": _rod(0.3, -0.4)}, "joints": {"pin": _pin("ground", "rod", 0.0, 0.0)}}
    rest = _survey(machine).rest
    (mode,) = rest.modes
    frequency = math.sqrt(MASS * 9.81 * ARM / (INERTIA + MASS * ARM**2)) / (2.0 * math.pi)
    assert mode.frequency_hz == pytest.approx(frequency, rel=1e-7)
    assert mode.damping_ratio == pytest.approx(0.0, abs=1e-9)
    assert rest.bodies[0].z_m == pytest.approx(-ARM, abs=1e-9)
    assert rest.joints[0].force_z_newton == pytest.approx(MASS * 9.81, rel=1e-9)


def test_prescribed_loads_are_left_out_at_rest():
    """A hanging rod that something pulls down hangs in its pin by its weight alone."""
    load = {"kind": "point_load", "body": "rod", "point_m": (0.0, -1.0),
            "force_z_newton": {"kind": "constant", "value": -50.0}}  # fmt: skip
    machine = {"bodies": {"rod": _rod(0.0, -0.5)}, "joints": {"pin": _pin("ground", "rod", 0.0, 0.0)},
               "forces": {"pull": load}}  # fmt: skip
    rest = _survey(machine).rest
    assert rest.joints[0].force_z_newton == pytest.approx(MASS * 9.81, rel=1e-9)
    assert rest.forces == ()


def test_double_pendulum_has_its_two_modes():
    """Two equal rods hung on one another: roots of det(K - w^2 M) of the minimal coordinates."""
    machine = {
        "bodies": {"upper": _rod(0.0, -0.5), "lower": _rod(0.0, -1.5)},
        "joints": {"top": _pin("ground", "upper", 0.0, 0.0), "knee": _pin("upper", "lower", 0.0, -1.0)},
    }
    mass = np.array([[INERTIA + MASS * 1.25, MASS * 0.5], [MASS * 0.5, INERTIA + MASS * 0.25]])
    stiffness = np.diag([1.5, 0.5]) * MASS * 9.81
    expected = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)))) / (2.0 * np.pi)
    modes = _survey(machine).rest.modes
    np.testing.assert_allclose([mode.frequency_hz for mode in modes], expected, rtol=1e-6)
    assert modes[0].words.startswith("lower ")


@pytest.mark.parametrize("damping", [0.0, 16.0])
def test_oscillator_has_its_damping_ratio(damping):
    """Spring and damper under a mass: sqrt(k / m) and c / (2 sqrt(k m)); the spring carries the weight."""
    rest = _survey(_slider(damping)).rest
    (mode,) = rest.modes
    assert mode.frequency_hz == pytest.approx(20.0 / (2.0 * math.pi), rel=1e-7)
    assert mode.damping_ratio == pytest.approx(damping / 80.0, abs=1e-8)
    assert mode.words == "mass z 1"
    assert rest.forces[0].load == pytest.approx(-MASS * 9.81, rel=1e-9)
    assert rest.forces[0].coordinate == pytest.approx(0.5 + MASS * 9.81 / 800.0, rel=1e-9)


def test_overdamped_and_free_motions_are_no_oscillations():
    """A strong damper leaves two creeping motions; a wheel that nothing turns moves freely."""
    rest = _survey(_slider(200.0)).rest
    rates = [50.0 - math.sqrt(2500.0 - 400.0), 50.0 + math.sqrt(2500.0 - 400.0)]
    assert not any(mode.oscillates for mode in rest.modes)
    np.testing.assert_allclose([-mode.eigenvalue.real for mode in rest.modes], rates, rtol=1e-6)
    machine = {"bodies": {"wheel": _rod(0.0, 0.0)}, "joints": {"pin": _pin("ground", "wheel", 0.0, 0.0)}}
    assert all(mode.eigenvalue == 0.0 for mode in _survey(machine).rest.modes)


def test_statics_are_the_start_of_a_run_in_equilibrium(mechanism_engine, subsoiler):
    """Pose and joint forces of the survey are those the engine starts with from static equilibrium."""
    subsoiler["joints"]["H10"]["speed"]["value"] = 0.0
    for wheel in ("wheel_left", "wheel_right"):
        subsoiler["bodies"][wheel].pop("angular_velocity_rad_per_s")
    state = mechanism_engine(subsoiler).state("run", -1, 0)
    subsoiler["initial"]["static_equilibrium"] = False
    rest = _survey(subsoiler).rest
    for ours, theirs in zip(rest.joints, state.joints, strict=True):
        assert ours.force_x_newton == pytest.approx(theirs.force_x_newton, abs=1e-5)
        assert ours.force_z_newton == pytest.approx(theirs.force_z_newton, abs=1e-5)
        assert ours.moment_newton_m == pytest.approx(theirs.moment_newton_m, abs=1e-5)


def test_shank_rings_at_the_frequency_of_its_mode(mechanism_engine, subsoiler):
    """The machine knocked at the share rings as the survey says of the mode of the shank's angle."""
    subsoiler["joints"]["H10"]["speed"]["value"] = 0.0
    for wheel in ("wheel_left", "wheel_right"):
        subsoiler["bodies"][wheel].pop("angular_velocity_rad_per_s")
    mode = next(m for m in _survey(subsoiler).rest.modes if m.oscillates and m.words.startswith("shank"))
    knock = {"kind": "half_sine", "peak": -30.0, "duration_s": 0.02}
    subsoiler["forces"]["knock"] = {"kind": "point_load", "body": "shank", "point_m": (0.06, -0.22),
                                    "force_x_newton": knock}  # fmt: skip
    engine = mechanism_engine(subsoiler, 500_000)
    turns = []
    for tick in range(1200):
        engine.advance(tick, ())
        body = engine.state("run", tick, (tick + 1) * 500_000).bodies
        turns.append(body[0].angular_velocity_rad_per_s)
    signal = np.array(turns[60:])
    crossings = np.flatnonzero(signal[1:] * signal[:-1] < 0.0)
    crossings = crossings + signal[crossings] / (signal[crossings] - signal[crossings + 1])
    damped = mode.frequency_hz * math.sqrt(1.0 - mode.damping_ratio**2)
    half_periods = np.diff(crossings)[:6] * 5e-4
    # the slower modes of the frame shift single crossings by a few per cent
    assert 0.5 / half_periods.mean() == pytest.approx(damped, rel=0.03)


def test_no_rest_is_said_and_the_rest_still_told():
    """A machine that nothing holds has freedoms but no static equilibrium, and the reason is given."""
    found = _survey({"bodies": {"stone": _rod(0.0, 0.0)}})
    assert found.rest is None
    assert "'stone' is still pulled" in found.no_rest
    assert found.topology.freedom_count == 3


SCENE = """
name: linkage
duration_s: 0.1
mechanism:
  bodies:
    left: {mass_kg: 1.0, inertia_kg_m2: 0.1, position_m: [0.1, -0.5]}
    middle: {mass_kg: 1.0, inertia_kg_m2: 0.1, position_m: [0.6, -0.5]}
    right: {mass_kg: 1.0, inertia_kg_m2: 0.1, position_m: [1.1, -0.5]}
    bar: {mass_kg: 1.0, inertia_kg_m2: 0.1, position_m: [0.7, -1.0]}
  joints:
    A: {kind: revolute, body_a: ground, body_b: left, point_m: [0.0, 0.0]}
    B: {kind: revolute, body_a: ground, body_b: middle, point_m: [0.5, 0.0]}
    C: {kind: revolute, body_a: ground, body_b: right, point_m: [1.0, 0.0]}
    D: {kind: revolute, body_a: left, body_b: bar, point_m: [0.2, -1.0]}
    E: {kind: revolute, body_a: middle, body_b: bar, point_m: [0.7, -1.0]}
    F: {kind: revolute, body_a: right, body_b: bar, point_m: [1.2, -1.0]}
"""


def test_check_prints_statics_and_modes(tmp_path, capsys):
    """`subsoil check`: freedoms, redundant joints by name, pose, joint forces, modes in words."""
    path = tmp_path / "linkage.yaml"
    path.write_text(SCENE)
    parser = argparse.ArgumentParser()
    check.add_arguments(parser)
    assert check.run(parser.parse_args([str(path)])) == 0
    text = capsys.readouterr().out
    for words in ("degrees of freedom  1", "reactions not unique: A, B, C, D, E, F", "static equilibrium",
                  "not unique", "frequency Hz", "damping ratio", " angle 1"):  # fmt: skip
        assert words in text


def test_check_marks_modes_that_the_step_does_not_resolve(tmp_path, capsys):
    """The linkage swings as a pendulum; with fewer than 20 steps a period its swing is the integrator's."""
    path = tmp_path / "linkage.yaml"
    path.write_text(SCENE)
    slow = [
        "--set",
        "mechanism.integrator=generalized_alpha",
        "--set",
        "coupling.communication_step_ns=100000000",
    ]
    found = []
    for words in ([], slow):
        assert main(["check", str(path), *words]) == 0
        lines = capsys.readouterr().out.splitlines()
        row = lines[next(k for k, line in enumerate(lines) if "frequency Hz" in line) + 1]
        hertz, _, steps = row.split()[:3]
        found.append((float(hertz), float(steps.rstrip(",")), "not resolved" in row))
    (hertz, steps, coarse), (_, slow_steps, slow_coarse) = found
    assert steps == pytest.approx(1.0 / (hertz * 0.5e-3), rel=0.01)
    assert slow_steps == pytest.approx(1.0 / (hertz * 0.1), rel=0.01)
    assert slow_steps < 20.0 < steps
    assert (coarse, slow_coarse) == (False, True)


# --- stability bounds -------------------------------------------------------------------------------


@pytest.mark.parametrize(("integrator", "order", "reach", "growth"), [
    ("adams_moulton", 2, 1.836, 5e-8), ("adams_moulton", 3, 0.125, 4.5e-6),
    ("adams_moulton", 4, 0.1275, 5e-8),
    ("runge_kutta_4", 4, 2.828, 5e-8),
])  # fmt: skip
def test_step_above_the_bound_is_refused_and_below_it_is_stable(
    mechanism_engine, integrator, order, reach, growth
):
    """An oscillator of 20 rad/s: refused just above the bound, with a mode and an advice; no growth below.

    Fifty steps a period are always taken, also by order 3, which makes an undamped mode grow. What is stable
    need not be right: a method that damps the mode is stopped by the balance of energy.
    """
    machine = _slider(0.0) | {"integrator": integrator, "integrator_order": order, "tolerance": None}
    with pytest.raises(SceneError, match=r"stability bound.*3\.18 Hz \(mass z 1\).*mechanism\.tolerance"):
        mechanism_engine(machine, round(1.03 * reach / 20.0 * 1e9))
    interval = round(0.97 * reach / 20.0 * 1e9)
    engine = mechanism_engine(machine, interval)
    for tick in range(2000):
        try:
            engine.advance(tick, ())
        except PhysicsError:
            break
    state = engine.state("run", tick, (tick + 1) * interval)
    assert abs(state.bodies[0].z_m + 0.5245) < 0.0755 * (1.0 + growth) ** 2000


def test_bound_counts_forces_that_do_not_act_yet(mechanism_engine):
    """A wheel in the air over hard ground: the step is judged by the contact to come."""
    contact = {"kind": "wheel_contact", "body": "wheel", "radius_m": 0.2, "stiffness_newton_per_m": 2e7,
               "damping_newton_s_per_m": 10.0, "friction": 0.0}  # fmt: skip
    machine = {"bodies": {"wheel": _rod(0.0, 0.5)}, "forces": {"tread": contact}, "tolerance": None}
    with pytest.raises(SceneError, match=r"stability bound.*wheel z 1"):
        mechanism_engine(machine, 1_000_000)
    mechanism_engine(machine, 100_000)
    mechanism_engine(machine | {"integrator": "generalized_alpha"}, 1_000_000)
