"""A wrench from outside, constant in a tick and new in the next: impulse, position, work."""

import math

import numpy as np
import pytest

import subsoil_ros as subsoil
from subsoil_ros.mbd.machine_arrays import LARGEST, RESIDUAL
from subsoil_ros.messages import ToolWrench
from tests.outside import GRAVITY, MASS_KG, STIFFNESS, SpringField, depth_m, document

TICKS, INTERVAL_NS = 400, 50_000
MASS, INERTIA = 3.0, 0.2


def _wrench(force_x, force_z, torque_y, tool="block_tool"):
    return ToolWrench(tool, force_x, 7.0, force_z, 5.0, torque_y, -3.0, work_joule=0.0, contact_count=1)


def _block(order, joints=()):
    return {
        "bodies": {"block": {"mass_kg": MASS, "inertia_kg_m2": INERTIA, "position_m": (0.3, 0.4)}},
        "joints": dict(joints),
        "integrator_order": order,
    }


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("order", [2, 3, 4])
def test_free_body_takes_the_impulse_of_random_wrenches(mechanism_engine, order, steps):
    """Momentum gained is the sum of wrench x interval, and the path that of a piecewise constant force."""
    engine = mechanism_engine(_block(order), INTERVAL_NS, steps, tools=["block"], gravity_m_per_s2=0.0)
    wrenches = np.random.default_rng(order).normal(size=(TICKS, 3)) * [500.0, 300.0, 40.0]
    interval = INTERVAL_NS * 1e-9
    position, velocity = np.array([0.3, 0.4, 0.0]), np.zeros(3)
    for tick, (fx, fz, torque) in enumerate(wrenches):
        motion = engine.advance(tick, (_wrench(fx, fz, torque),))[0]
        acceleration = np.array([fx / MASS, fz / MASS, -torque / INERTIA])
        position = position + interval * (velocity + 0.5 * interval * acceleration)
        velocity = velocity + interval * acceleration
    # a few roundings per step of numbers as large as the sum of magnitudes
    largest = np.abs(wrenches / [MASS, MASS, INERTIA]).sum(axis=0) * interval
    gained = [motion.velocity_x_m_per_s, motion.velocity_z_m_per_s, motion.angular_velocity_rad_per_s]
    assert np.all(np.abs(np.array(gained) - velocity) < 1e-14 * largest * steps)
    reached = np.array([motion.x_m, motion.z_m, motion.angle_rad])
    np.testing.assert_allclose(reached, position, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("order", [2, 3, 4])
def test_sliding_body_takes_the_impulse_along_its_rail(mechanism_engine, order, steps):
    """On an oblique rail the momentum gained is the impulse along it; the rail takes the rest."""
    rail = {
        "kind": "prismatic",
        "body_a": "ground",
        "body_b": "block",
        "point_m": (0.3, 0.4),
        "axis": (0.6, 0.8),
    }
    machine = _block(order, {"rail": rail})
    engine = mechanism_engine(machine, INTERVAL_NS, steps, tools=["block"], gravity_m_per_s2=0.0)
    wrenches = np.random.default_rng(10 + order).normal(size=(TICKS, 3)) * [500.0, 300.0, 40.0]
    for tick, wrench in enumerate(wrenches):
        motion = engine.advance(tick, (_wrench(*wrench),))[0]
    interval = INTERVAL_NS * 1e-9
    impulse = interval * (wrenches[:, 0] * 0.6 + wrenches[:, 1] * 0.8)
    gained = MASS * (0.6 * motion.velocity_x_m_per_s + 0.8 * motion.velocity_z_m_per_s)
    assert abs(gained - impulse.sum()) < 1e-14 * np.abs(impulse).sum() * steps
    state = engine.state("run", TICKS - 1, TICKS * INTERVAL_NS)
    fx, fz, torque = wrenches[-1]
    across = -0.8 * fx + 0.6 * fz
    reaction = state.joints[0]
    assert reaction.force_x_newton == pytest.approx(0.8 * across, rel=1e-9)
    assert reaction.force_z_newton == pytest.approx(-0.6 * across, rel=1e-9)
    assert reaction.moment_newton_m == pytest.approx(torque, rel=1e-9)


def test_a_predicted_motion_is_corrected_by_the_wrench_of_its_tick(mechanism_engine):
    """Poses go on at constant velocity; the answer to them acts from the start of their tick. Rows of the
    series have the state that the last answer would make of the tick that waits for its own."""
    engine = mechanism_engine(_block(4), tools=["block"], gravity_m_per_s2=0.0, force="predicted")
    place, speed, interval = 0.3, 0.0, 1e-3
    for tick, force in enumerate([999.0, 60.0, -30.0, 90.0]):  # the first is of the time before the run
        if tick > 0:
            place += interval * (speed + 0.5 * interval * force / MASS)
            speed += interval * force / MASS
        (motion,) = engine.advance(tick, (_wrench(force, 0.0, 0.0),))
        assert motion.x_m == pytest.approx(place + interval * speed, rel=1e-14)
        assert motion.velocity_x_m_per_s == pytest.approx(speed, rel=1e-14)
        (body,) = engine.state("run", tick, 0).bodies
        assert body.velocity_x_m_per_s == pytest.approx(speed + interval * force / MASS, rel=1e-14)


def test_planar_moment_is_minus_torque_y(mechanism_engine):
    """A torque about +y turns a body clockwise in the x-z plane; torques about x and z do nothing."""
    engine = mechanism_engine(_block(4), tools=["block"], gravity_m_per_s2=0.0)
    motion = engine.advance(0, (_wrench(0.0, 0.0, 2.0),))[0]
    assert motion.angular_velocity_rad_per_s == pytest.approx(-2.0 / INERTIA * 1e-3, rel=1e-12)
    assert (motion.velocity_x_m_per_s, motion.velocity_z_m_per_s) == (0.0, 0.0)
    assert motion.y_m == 0.0


def test_work_of_wrenches_is_force_times_displacement(mechanism_engine, subsoiler):
    """On the machine, external work is the sum over ticks of wrench x displacement, and the book closes."""
    del subsoiler["forces"]["left"], subsoiler["forces"]["right"]
    machine = subsoiler
    generator = np.random.default_rng(3)
    gaps = []
    noise = generator.normal(size=(200, 3)) * [100.0, 50.0, 10.0]
    machine["initial"] = {}
    machine["forces"]["holder"] = {
        "kind": "coordinate_spring",
        "body": "frame",
        "coordinate": "z",
        "target": {"kind": "constant", "value": 0.53},
        "stiffness_newton_per_m": 1e5,
        "damping_newton_s_per_m": 2e3,
    }
    for steps in (4, 8, 16):
        engine = mechanism_engine(machine, 1_000_000, steps, tools=["shank"])
        first = engine.state("run", -1, 0)
        before, work = engine.initial_motions()[0], 0.0
        for tick, (fx, fz, torque) in enumerate(noise):
            after = engine.advance(tick, (_wrench(fx - 300.0, fz, torque, "shank_tool"),))[0]
            work += (fx - 300.0) * (after.x_m - before.x_m) + fz * (after.z_m - before.z_m)
            work -= torque * (after.angle_rad - before.angle_rad)
            before = after
        state = engine.state("run", 199, 200_000_000)
        assert state.external_work_joule == pytest.approx(work, abs=1e-10)
        stored = [
            s.kinetic_energy_joule + s.gravity_energy_joule + s.spring_energy_joule for s in (first, state)
        ]
        supplied = state.driver_work_joule + state.external_work_joule - state.dissipated_joule
        gaps.append(abs(stored[1] - stored[0] - supplied))
    # jumps of the wrench leave kinks that the history is shifted over: second order, not fourth
    assert gaps[2] < 0.3 * gaps[1] < 0.3 * 0.3 * gaps[0]
    assert gaps[2] < 1e-4 * abs(work)


def test_shift_keeps_the_order_on_a_spring_under_steps_of_force(mechanism_engine):
    """A mass on a spring under a force that jumps every tick is followed at the order of the method."""
    machine = {**_block(4), "tolerance": None}
    machine["forces"] = {
        "spring": {
            "kind": "coordinate_spring",
            "body": "block",
            "coordinate": "x",
            "target": {"kind": "constant", "value": 0.3},
            "stiffness_newton_per_m": 3e3,
        }
    }
    forces = 200.0 * np.sin(0.9 * np.arange(100))
    frequency = math.sqrt(3e3 / MASS)
    x, v, errors = 0.0, 0.0, []
    turn = frequency * 2e-3
    for force in forces:
        rest = force / 3e3
        x, v = (
            rest + (x - rest) * math.cos(turn) + v / frequency * math.sin(turn),
            v * math.cos(turn) - (x - rest) * frequency * math.sin(turn),
        )
    for steps in (4, 8, 16):
        engine = mechanism_engine(machine, 2_000_000, steps, tools=["block"], gravity_m_per_s2=0.0)
        for tick, force in enumerate(forces):
            motion = engine.advance(tick, (_wrench(force, 0.0, 0.0),))[0]
        errors.append(abs(motion.x_m - 0.3 - x) + abs(motion.velocity_x_m_per_s - v) / frequency)
    # the change of acceleration is the same all along the past, so the shifted history is the true one
    observed = np.log2(np.array(errors[:-1]) / errors[1:])
    assert observed == pytest.approx(4.0, abs=0.25)


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("order", [2, 3, 4])
def test_the_balance_of_energy_closes_under_wrenches_that_jump(mechanism_engine, order, steps):
    """A load's work over a block that random wrenches push about is booked to round-off; so is a damper's, to
    the error of a quadrature."""
    machine = _block(order)
    machine["forces"] = {
        "load": {
            "kind": "point_load", "body": "block", "point_m": (0.3, 0.4),
            "force_x_newton": {"kind": "constant", "value": 100.0},
        },
    }  # fmt: skip
    damper = {
        "kind": "coordinate_spring", "body": "block", "coordinate": "z", "damping_newton_s_per_m": 50.0,
        "stiffness_newton_per_m": 0.0, "target": {"kind": "constant", "value": 0.4},
    }  # fmt: skip
    wrenches = np.random.default_rng(order).normal(size=(TICKS, 3)) * [500.0, 300.0, 0.0]
    rounding = TICKS * 1000.0 * 0.4 * 2.2e-16  # of wrench times place [J]
    for part, forces in ((0.0, {}), (1e-5, {"damper": damper})):
        machine["forces"].update(forces)
        engine = mechanism_engine(machine, INTERVAL_NS, steps, tools=["block"], gravity_m_per_s2=0.0)
        for tick, (fx, fz, torque) in enumerate(wrenches):
            engine.advance(tick, (_wrench(fx, fz, torque),))
            balance = engine.arrays.balance
            assert abs(balance[RESIDUAL]) < rounding + part * balance[LARGEST]


def test_a_mechanism_stands_on_a_soil_from_outside() -> None:
    """The block as a body of our own mechanism: the same closed form."""
    scene = document(
        mechanism={
            "bodies": {"block": {"mass_kg": MASS_KG, "inertia_kg_m2": 1.0, "position_m": [0.0, 0.0]}},
            "joints": {
                "rail": {
                    "kind": "prismatic", "body_a": "ground", "body_b": "block",
                    "point_m": [0.0, 0.0], "axis": [0.0, 1.0],
                }
            },
        },
        tools={"foot": {"body": "block", "groups": document()["tools"]["foot"]["groups"]}},
    )  # fmt: skip
    run = subsoil.run(scene, soil=SpringField())
    error = np.abs(-run.series["tool.foot.z_m"] - depth_m(run.series["time_s"]))
    assert error.max() < 0.01 * MASS_KG * GRAVITY / STIFFNESS
    assert "mechanism.kinetic_energy_joule" in run.series
