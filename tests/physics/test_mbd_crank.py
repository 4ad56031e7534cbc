"""A slider-crank driven by a torque against a gas force: one freedom, its inertia J(theta) by hand."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

CRANK, ROD = 0.1, 0.35  # lengths [m]
M1, I1, M2, I2, M3, I3 = 2.0, 0.03, 1.2, 0.012, 1.5, 0.01  # crank, rod, slider
START, SPEED = 0.5, 12.0  # crank angle [rad] and rate [rad/s]
TORQUE, GAS, SWING, FREQUENCY = 1.5, -10.0, 15.0, 3.0  # the gas pushes with GAS + SWING sin(2 pi f t)
GRAVITY = 9.81


def _along(angle):
    return np.array([math.cos(angle), math.sin(angle)])


def _across(angle):
    return np.array([-math.sin(angle), math.cos(angle)])


def _gas(time):
    return GAS + SWING * math.sin(2.0 * math.pi * FREQUENCY * time)


def _linkage(theta):
    """Rod angle, slider place, rod centre: first and second derivatives by the crank angle."""
    beta = math.asin(-CRANK / ROD * math.sin(theta))
    beta1 = -CRANK * math.cos(theta) / (ROD * math.cos(beta))
    beta2 = (CRANK * math.sin(theta) + ROD * math.sin(beta) * beta1**2) / (ROD * math.cos(beta))
    slider1 = -CRANK * math.sin(theta) - ROD * math.sin(beta) * beta1
    slider2 = -CRANK * math.cos(theta) - ROD * (math.cos(beta) * beta1**2 + math.sin(beta) * beta2)
    rod1 = CRANK * _across(theta) + 0.5 * ROD * beta1 * _across(beta)
    rod2 = -CRANK * _along(theta) + 0.5 * ROD * (beta2 * _across(beta) - beta1**2 * _along(beta))
    return beta, beta1, beta2, slider1, slider2, rod1, rod2


def _acceleration(time, theta, rate):
    """theta'' of J theta'' + J' theta'^2 / 2 = torque + gas + gravity, each times its own transmission."""
    _, beta1, beta2, slider1, slider2, rod1, rod2 = _linkage(theta)
    inertia = I1 + 0.25 * M1 * CRANK**2 + M2 * rod1 @ rod1 + I2 * beta1**2 + M3 * slider1**2
    half_slope = M2 * rod1 @ rod2 + I2 * beta1 * beta2 + M3 * slider1 * slider2
    weight = -GRAVITY * (0.5 * M1 * CRANK * math.cos(theta) + M2 * rod1[1])
    return (TORQUE + _gas(time) * slider1 + weight - half_slope * rate**2) / inertia


def _rail_force(time, theta, rate):
    """Force of the rail on the slider along z, by Newton and Euler for slider and rod."""
    beta, beta1, beta2, slider1, slider2, rod1, rod2 = _linkage(theta)
    spin = _acceleration(time, theta, rate)
    push_x = M3 * (slider1 * spin + slider2 * rate**2) - _gas(time)  # of the rod on the slider
    inertia = M2 * (rod1 * spin + rod2 * rate**2 + [0.0, GRAVITY])  # what both pins put on the rod
    turning = -2.0 * I2 * (beta1 * spin + beta2 * rate**2) / ROD
    # moments about the rod's centre: e x (2 push + inertia) = turning
    x, z = _along(beta)
    push_z = 0.5 * ((turning + z * (2.0 * push_x + inertia[0])) / x - inertia[1])
    return M3 * GRAVITY - push_z


def _machine():
    pin = CRANK * _along(START)
    beta = _linkage(START)[0]
    end = pin + ROD * _along(beta)
    revolute = {"kind": "revolute"}
    sine = {"kind": "sine", "mean": GAS, "amplitude": SWING, "frequency_hz": FREQUENCY}
    torque = {"kind": "constant", "value": TORQUE}
    return {
        "bodies": {
            "crank": {"mass_kg": M1, "inertia_kg_m2": I1, "position_m": tuple(0.5 * pin), "angle_rad": START,
                      "angular_velocity_rad_per_s": SPEED},
            "rod": {"mass_kg": M2, "inertia_kg_m2": I2, "position_m": tuple(0.5 * (pin + end)),
                    "angle_rad": beta},
            "slider": {"mass_kg": M3, "inertia_kg_m2": I3, "position_m": tuple(end)},
        },
        "joints": {
            "main": {**revolute, "body_a": "ground", "body_b": "crank", "point_m": (0.0, 0.0)},
            "big": {**revolute, "body_a": "crank", "body_b": "rod", "point_m": tuple(pin)},
            "small": {**revolute, "body_a": "rod", "body_b": "slider", "point_m": tuple(end)},
            "rail": {"kind": "prismatic", "body_a": "ground", "body_b": "slider", "point_m": tuple(end),
                     "axis": (1.0, 0.0)},
        },
        "forces": {
            "motor": {"kind": "point_load", "body": "crank", "point_m": (0.0, 0.0),
                      "moment_newton_m": torque},
            "gas": {"kind": "point_load", "body": "slider", "point_m": tuple(end), "force_x_newton": sine},
        },
    }  # fmt: skip


def _run(engine, ticks):
    for tick in range(ticks):
        engine.advance(tick, ())
    return engine.state("run", ticks - 1, 600_000_000)


@pytest.fixture(scope="module")
def exact():
    """Crank angle and rate after 0.6 s."""
    run = solve_ivp(lambda t, y: (y[1], _acceleration(t, *y)), (0.0, 0.6), (START, SPEED), "DOP853",
                    rtol=1e-12, atol=1e-12)  # fmt: skip
    return run.y[:, -1]


def test_crank_follows_its_own_equation(mechanism_engine, exact):
    """Angle and rate agree with the equation in the crank's angle, by 2^4 better at half the step."""
    errors = []
    for ticks in (600, 1200, 2400):
        crank = _run(mechanism_engine(_machine(), 600_000_000 // ticks), ticks).bodies[0]
        errors.append(
            math.hypot(crank.angle_rad - exact[0], 0.05 * (crank.angular_velocity_rad_per_s - exact[1]))
        )
    assert exact[0] > START + 2.0 * math.pi  # it passes both dead centres
    observed = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (observed > 3.5).all()
    assert errors[-1] < 1e-8


def test_crank_accelerations_and_rail_follow_newton_and_euler(mechanism_engine, exact):
    """Acceleration and the rail's reaction are those of the state reached, to the error of the state."""
    state = _run(mechanism_engine(_machine(), 250_000), 2400)
    crank = state.bodies[0]
    spin = _acceleration(0.6, *exact)
    assert crank.angular_acceleration_rad_per_s2 == pytest.approx(spin, abs=1e-4)
    rail = next(joint for joint in state.joints if joint.name == "rail")
    assert rail.force_z_newton == pytest.approx(_rail_force(0.6, *exact), abs=1e-4)
    assert rail.force_x_newton == pytest.approx(0.0, abs=1e-9)


def test_work_of_torque_and_gas_is_the_energy(mechanism_engine):
    """Kinetic and gravity energy grow by torque times angle and by the work of the gas."""
    engine = mechanism_engine(_machine(), 250_000)
    first = engine.state("run", -1, 0)
    last = _run(engine, 2400)
    gained = last.kinetic_energy_joule + last.gravity_energy_joule
    gained -= first.kinetic_energy_joule + first.gravity_energy_joule
    assert abs(gained) > 1.0
    assert last.external_work_joule == pytest.approx(gained, abs=1e-6)
