"""Forces and reactions whose answer is known by hand: welds, wheels, chains, drivers."""

import math

import pytest

BODY = {"mass_kg": 4.0, "inertia_kg_m2": 0.3, "position_m": (0.5, 0.2)}


def _advance(engine, ticks):
    for tick in range(ticks):
        engine.advance(tick, ())
    return engine


@pytest.mark.parametrize(("body_a", "body_b", "sign"), [("ground", "block", 1.0), ("block", "ground", -1.0)])
def test_weld_carries_weight_and_its_moment(mechanism_engine, body_a, body_b, sign):
    """A body welded at the origin needs m g upwards and m g x arm counter-clockwise, on body_b."""
    weld = {"kind": "fixed", "body_a": body_a, "body_b": body_b, "point_m": (0.0, 0.0)}
    engine = mechanism_engine({"bodies": {"block": BODY}, "joints": {"weld": weld}})
    reaction = _advance(engine, 5).state("run", 4, 5_000_000).joints[0]
    assert reaction.force_x_newton == pytest.approx(0.0, abs=1e-10)
    assert reaction.force_z_newton == pytest.approx(sign * 4.0 * 9.81, rel=1e-12)
    assert reaction.moment_newton_m == pytest.approx(sign * 4.0 * 9.81 * 0.5, rel=1e-12)


def test_prismatic_moment_is_about_the_joint_point(mechanism_engine):
    """A block hanging off a level rail beside its joint point is held by m g and by m g x arm."""
    rail = {
        "kind": "prismatic",
        "body_a": "ground",
        "body_b": "block",
        "point_m": (0.1, 0.2),
        "axis": (-1.0, 0.0),
    }
    engine = mechanism_engine({"bodies": {"block": BODY}, "joints": {"rail": rail}})
    reaction = engine.state("run", -1, 0).joints[0]
    assert reaction.force_z_newton == pytest.approx(4.0 * 9.81, rel=1e-12)
    assert reaction.moment_newton_m == pytest.approx(4.0 * 9.81 * 0.4, rel=1e-12)


def test_driver_lifts_with_weight_and_inertia(mechanism_engine):
    """A driver ramping its speed pulls m (g + a); its work is the energy gained; restarts at the corners."""
    driver = {
        "kind": "driver",
        "body": "block",
        "coordinate": "z",
        "speed": {"kind": "ramp", "end_value": 0.3, "start_s": 0.0105, "end_s": 0.1105},
    }
    machine = {"bodies": {"block": BODY}, "joints": {"lift": driver}}
    engine = _advance(mechanism_engine(machine), 60)
    state = engine.state("run", 59, 60_000_000)
    assert state.joints[0].force_z_newton == pytest.approx(4.0 * (9.81 + 3.0), rel=1e-10)
    assert state.bodies[0].z_m == pytest.approx(0.2 + 0.5 * 3.0 * 0.0495**2, abs=1e-12)
    gained = 4.0 * 9.81 * 0.5 * 3.0 * 0.0495**2 + 0.5 * 4.0 * (3.0 * 0.0495) ** 2
    assert state.driver_work_joule == pytest.approx(gained, rel=1e-9)
    for tick in range(60, 200):
        engine.advance(tick, ())
    state = engine.state("run", 199, 200_000_000)
    assert state.joints[0].force_z_newton == pytest.approx(4.0 * 9.81, rel=1e-10)
    assert state.bodies[0].z_m == pytest.approx(0.2 + 0.3 * 0.05 + 0.3 * (0.2 - 0.1105), abs=1e-12)
    assert state.driver_work_joule == pytest.approx(
        4.0 * 9.81 * (state.bodies[0].z_m - 0.2) + 0.5 * 4.0 * 0.09, rel=1e-9
    )


def _wheel(friction, **body):
    return {
        "bodies": {"wheel": {"mass_kg": 10.0, "inertia_kg_m2": 0.2, "position_m": (0.0, 0.2), **body}},
        "forces": {
            "tread": {
                "kind": "wheel_contact",
                "body": "wheel",
                "radius_m": 0.2,
                "stiffness_newton_per_m": 20_000.0,
                "damping_newton_s_per_m": 500.0,
                "friction": friction,
            }
        },
        "initial": {"static_equilibrium": True},
    }


def test_sliding_wheel_comes_to_roll(mechanism_engine):
    """Friction turns a sliding wheel until it rolls at v m R^2 / (I + m R^2), spinning clockwise."""
    engine = mechanism_engine(_wheel(0.3, velocity_m_per_s=(1.0, 0.0)), 500_000)
    state = _advance(engine, 2000).state("run", 1999, 1_000_000_000)
    rolling = 10.0 * 0.04 / (0.2 + 10.0 * 0.04)
    body = state.bodies[0]
    assert body.velocity_x_m_per_s == pytest.approx(rolling, abs=1e-9)
    assert body.angular_velocity_rad_per_s == pytest.approx(-rolling / 0.2, abs=1e-8)
    # what is lost went into friction
    lost = 0.5 * 10.0 - 0.5 * 10.0 * rolling**2 - 0.5 * 0.2 * (rolling / 0.2) ** 2
    assert state.dissipated_joule == pytest.approx(lost, rel=1e-6)
    assert state.forces[0].load == pytest.approx(98.1, rel=1e-9)
    assert state.forces[0].coordinate == pytest.approx(98.1 / 20_000.0, rel=1e-9)


@pytest.mark.parametrize("slip", [-0.5, 0.02, 0.5])
def test_friction_follows_its_law(mechanism_engine, slip):
    """A wheel with slip is held back by mu N tanh(slip / slip speed), at its rim."""
    body = mechanism_engine(_wheel(0.3, velocity_m_per_s=(slip, 0.0))).state("run", -1, 0).bodies[0]
    friction = -0.3 * 98.1 * math.tanh(slip / 0.02)
    assert body.acceleration_x_m_per_s2 == pytest.approx(friction / 10.0, rel=1e-9)
    assert body.angular_acceleration_rad_per_s2 == pytest.approx(0.2 * friction / 0.2, rel=1e-9)


def test_dropped_wheel_never_pulls_on_the_ground(mechanism_engine):
    """A wheel dropped from 0.1 m bounces: the ground only pushes, and the book of energy closes."""
    machine = _wheel(0.0)
    machine["forces"]["tread"]["damping_newton_s_per_m"] = 100.0
    machine["initial"] = {"coordinates": {"wheel.z_m": 0.3}}
    engine = mechanism_engine(machine, 100_000)
    start = 98.1 * 0.3
    airborne = 0
    for tick in range(10_000):
        engine.advance(tick, ())
        if tick % 20 == 19:
            state = engine.state("run", tick, (tick + 1) * 100_000)
            force = state.forces[0].load
            assert force >= 0.0
            airborne += force == 0.0
            book = state.kinetic_energy_joule + state.gravity_energy_joule + state.spring_energy_joule
            # a switch inside a step costs at most that step's work of the damper: 200 W x 0.1 ms
            assert book + state.dissipated_joule == pytest.approx(start, abs=0.02)
    assert airborne > 80  # 143 ms of first fall, sampled every 2 ms, and bounces


def test_one_way_chain_lowers_and_goes_slack(mechanism_engine):
    """A chain carries m g while it lowers a body on the ground's spring, and nothing once that carries it."""
    machine = _wheel(0.0)
    machine["initial"] = {"coordinates": {"wheel.z_m": 0.2995095}}
    machine["forces"]["chain"] = {
        "kind": "coordinate_spring",
        "body": "wheel",
        "coordinate": "z",
        "target": {"kind": "ramp", "start_value": 0.3, "end_value": 0.1, "start_s": 0.2, "end_s": 1.2},
        "stiffness_newton_per_m": 200_000.0,
        "damping_newton_s_per_m": 2000.0,
        "acts_in": "pull_up",
    }
    engine = mechanism_engine(machine, 100_000)
    state = _advance(engine, 1500).state("run", 1499, 150_000_000)
    assert state.forces[1].load == pytest.approx(98.1, rel=1e-9)
    assert state.spring_energy_joule == pytest.approx(0.5 * 98.1**2 / 200_000.0, rel=1e-9)
    for tick in range(1500, 5000):
        engine.advance(tick, ())
    state = engine.state("run", 4999, 500_000_000)
    assert state.forces[1].load == pytest.approx(98.1, rel=1e-3)
    assert state.bodies[0].velocity_z_m_per_s == pytest.approx(-0.2, rel=1e-3)
    for tick in range(5000, 15_000):
        engine.advance(tick, ())
    state = engine.state("run", 14_999, 1_500_000_000)
    assert state.forces[1].load == 0.0
    assert state.bodies[0].z_m == pytest.approx(0.2 - 98.1 / 20_000.0, abs=1e-9)
    # lowered and at rest: gravity's energy left through the chain's target and the dampers
    book = state.gravity_energy_joule + state.spring_energy_joule + state.dissipated_joule
    start = 98.1 * 0.2995095 + 0.5 * 98.1**2 / 200_000.0
    assert book - state.driver_work_joule == pytest.approx(start, abs=0.01)


def test_point_load_acts_at_its_point(mechanism_engine):
    """A force off the centre of mass turns the body with its arm; prescribed loads do external work."""
    load = {
        "kind": "point_load",
        "body": "block",
        "point_m": (0.5, 0.5),
        "force_x_newton": {"kind": "constant", "value": 6.0},
        "moment_newton_m": {"kind": "constant", "value": 0.5},
    }
    machine = {"bodies": {"block": BODY}, "forces": {"push": load}}
    engine = mechanism_engine(machine, gravity_m_per_s2=0.0)
    state = engine.state("run", -1, 0)
    assert state.bodies[0].acceleration_x_m_per_s2 == pytest.approx(1.5, rel=1e-12)
    assert state.bodies[0].angular_acceleration_rad_per_s2 == pytest.approx(
        (0.5 - 6.0 * 0.3) / 0.3, rel=1e-12
    )
    state = _advance(engine, 300).state("run", 299, 300_000_000)
    assert state.external_work_joule == pytest.approx(state.kinetic_energy_joule, rel=1e-9)
    assert state.forces == ()  # a load is given, not found
    assert math.isclose(state.draft_newton, 0.0)
