"""One-freedom machines against closed forms: position, velocity, acceleration, reactions, order."""

import math

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

ORDERS = (2, 3, 4)


def _advance(engine, ticks):
    for tick in range(ticks):
        engine.advance(tick, ())
    return engine


# --- pendulum ---------------------------------------------------------------------------------------

MASS, INERTIA, ARM, AMPLITUDE = 2.0, 0.06, 0.5, 1.2


def _pendulum(order=4):
    """A rod hung at the origin, at rest at AMPLITUDE; its angle is 0 when it hangs."""
    return {
        "bodies": {
            "rod": {
                "mass_kg": MASS,
                "inertia_kg_m2": INERTIA,
                "position_m": (ARM * math.sin(AMPLITUDE), -ARM * math.cos(AMPLITUDE)),
                "angle_rad": AMPLITUDE,
            }
        },
        "joints": {"pin": {"kind": "revolute", "body_a": "ground", "body_b": "rod", "point_m": (0.0, 0.0)}},
        "integrator_order": order,
    }


def _pendulum_angle(time):
    """Angle, rate and acceleration of a physical pendulum from rest (Jacobi's elliptic functions)."""
    frequency_2 = MASS * 9.81 * ARM / (INERTIA + MASS * ARM**2)
    frequency = math.sqrt(frequency_2)
    k = math.sin(0.5 * AMPLITUDE)
    sn, cn, _, _ = ellipj(ellipk(k * k) + frequency * time, k * k)
    angle = 2.0 * math.asin(k * sn)
    return angle, 2.0 * frequency * k * cn, -frequency_2 * math.sin(angle)


@pytest.mark.parametrize("order", ORDERS)
def test_pendulum_converges_with_the_order_of_the_method(mechanism_engine, order):
    """The angle after 1.6 s comes nearer to the elliptic functions by 2^order per halved step."""
    errors = []
    for ticks in (400, 800, 1600):
        engine = _advance(mechanism_engine(_pendulum(order), 1_600_000_000 // ticks), ticks)
        body = engine.state("run", ticks - 1, 1_600_000_000).bodies[0]
        angle, rate, _ = _pendulum_angle(1.6)
        errors.append(math.hypot(body.angle_rad - angle, body.angular_velocity_rad_per_s - rate))
    observed = np.log2(np.array(errors[:-1]) / errors[1:])
    # the leading term dominates at these steps (0.02 to 0.005 rad per step) to a quarter of an order
    assert observed == pytest.approx(order, abs=0.25)


def test_pendulum_pin_carries_weight_and_centripetal_force(mechanism_engine):
    """The pin's force on the rod is m (a + g) of the closed form, everywhere on the swing."""
    engine = mechanism_engine(_pendulum())
    for tick in range(1600):
        engine.advance(tick, ())
        if tick % 100 != 99:
            continue
        state = engine.state("run", tick, (tick + 1) * 1_000_000)
        angle, rate, acceleration = _pendulum_angle((tick + 1) * 1e-3)
        along = np.array([math.cos(angle), math.sin(angle)])  # of increasing angle
        inward = np.array([-math.sin(angle), math.cos(angle)])
        force = MASS * ARM * (acceleration * along + rate**2 * inward) + [0.0, MASS * 9.81]
        pin = state.joints[0]
        # 4th order at 1 ms: 1e-8 rad in angle, times stiffness of force with angle (about 40 N)
        np.testing.assert_allclose([pin.force_x_newton, pin.force_z_newton], force, atol=1e-6)
        assert pin.unique
        assert state.position_residual_m < 1e-12


# --- oscillator -------------------------------------------------------------------------------------

STIFFNESS, DAMPING, FREE, START = 800.0, 6.0, 0.5, 0.62


def _oscillator(order=4):
    """A mass on a rail along x, on a spring-damper to the ground at the origin, released at START."""
    return {
        "bodies": {"slider": {"mass_kg": MASS, "inertia_kg_m2": INERTIA, "position_m": (START, 0.0)}},
        "joints": {
            "rail": {
                "kind": "prismatic",
                "body_a": "ground",
                "body_b": "slider",
                "point_m": (0.0, 0.0),
                "axis": (2.0, 0.0),
            }
        },
        "forces": {
            "spring": {
                "kind": "spring_damper",
                "body_a": "ground",
                "point_a_m": (0.0, 0.0),
                "body_b": "slider",
                "point_b_m": (START, 0.0),
                "stiffness_newton_per_m": STIFFNESS,
                "damping_newton_s_per_m": DAMPING,
                "free_length_m": FREE,
            }
        },
        "integrator_order": order,
    }


def _oscillator_position(time):
    """Position and velocity of the damped oscillator from rest."""
    decay = 0.5 * DAMPING / MASS
    frequency = math.sqrt(STIFFNESS / MASS - decay**2)
    wave = math.cos(frequency * time) + decay / frequency * math.sin(frequency * time)
    slope = -(STIFFNESS / MASS) / frequency * math.sin(frequency * time)
    fade = (START - FREE) * math.exp(-decay * time)
    return FREE + fade * wave, fade * slope


@pytest.mark.parametrize("order", ORDERS)
def test_oscillator_converges_with_the_order_of_the_method(mechanism_engine, order):
    """Position and speed of a spring-damper oscillator follow the closed form with the right order."""
    errors = []
    for ticks in (400, 800, 1600):
        engine = _advance(
            mechanism_engine({**_oscillator(order), "tolerance": None}, 1_000_000_000 // ticks), ticks
        )
        body = engine.state("run", ticks - 1, 1_000_000_000).bodies[0]
        position, velocity = _oscillator_position(1.0)
        errors.append(math.hypot(20.0 * (body.x_m - position), body.velocity_x_m_per_s - velocity))
    observed = np.log2(np.array(errors[:-1]) / errors[1:])
    assert observed == pytest.approx(order, abs=0.25)


def test_oscillator_reports_its_spring(mechanism_engine):
    """Length, rate, force (compression positive), stored and dissipated energy agree with the closed form."""
    engine = _advance(mechanism_engine(_oscillator(), 500_000), 1000)
    state = engine.state("run", 999, 500_000_000)
    position, velocity = _oscillator_position(0.5)
    spring = state.forces[0]
    assert spring.coordinate == pytest.approx(position, abs=1e-8)
    assert spring.rate == pytest.approx(velocity, abs=1e-7)
    force = STIFFNESS * (FREE - position) - DAMPING * velocity
    assert spring.load == pytest.approx(force, abs=1e-5)
    stored = 0.5 * STIFFNESS * (position - FREE) ** 2
    assert state.spring_energy_joule == pytest.approx(stored, abs=1e-6)
    lost = 0.5 * STIFFNESS * (START - FREE) ** 2 - stored - 0.5 * MASS * velocity**2
    assert state.dissipated_joule == pytest.approx(lost, abs=1e-6)


# --- slider-crank -----------------------------------------------------------------------------------

CRANK, ROD, ANGLE = 0.2, 0.5, 0.7
SPEED, SWING, SWING_HZ = 6.0, 2.0, 1.5


def _crank_angle(time):
    """Integral of the driver's law, mean plus sine."""
    turn = 2.0 * math.pi * SWING_HZ
    return ANGLE + SPEED * time + SWING / turn * (1.0 - np.cos(turn * time))


def _slider_crank_pose(time):
    """Coordinates (9,) of crank, rod and slider from the driven angle; works for complex times."""
    angle = _crank_angle(time)
    cx, cz = CRANK * np.cos(angle), CRANK * np.sin(angle)
    lean = -np.arcsin(cz / ROD)
    x = cx + ROD * np.cos(lean)
    return np.array([0.5 * cx, 0.5 * cz, angle, 0.5 * (cx + x), 0.5 * cz, lean, x, 0.0 * x, 0.0 * x])


def _slider_crank():
    crank, rod, slider = np.real(_slider_crank_pose(0.0)).reshape(3, 3)
    end = (2.0 * crank[0], 2.0 * crank[1])
    return {
        "bodies": {
            "crank": {
                "mass_kg": 3.0,
                "inertia_kg_m2": 0.02,
                "position_m": tuple(crank[:2]),
                "angle_rad": crank[2],
            },
            "rod": {"mass_kg": 1.5, "inertia_kg_m2": 0.04, "position_m": tuple(rod[:2]), "angle_rad": rod[2]},
            "slider": {"mass_kg": 4.0, "inertia_kg_m2": 0.1, "position_m": tuple(slider[:2])},
        },
        "joints": {
            "main": {"kind": "revolute", "body_a": "ground", "body_b": "crank", "point_m": (0.0, 0.0)},
            "big_end": {"kind": "revolute", "body_a": "crank", "body_b": "rod", "point_m": end},
            "small_end": {
                "kind": "revolute",
                "body_a": "rod",
                "body_b": "slider",
                "point_m": (slider[0], 0.0),
            },
            "rail": {
                "kind": "prismatic",
                "body_a": "slider",
                "body_b": "ground",
                "point_m": (slider[0], 0.0),
                "axis": (1.0, 0.0),
            },
            "motor": {
                "kind": "driver",
                "body": "crank",
                "coordinate": "angle",
                "speed": {"kind": "sine", "mean": SPEED, "amplitude": SWING, "frequency_hz": SWING_HZ},
            },
        },
    }


MASSES = np.array([3.0, 3.0, 0.02, 1.5, 1.5, 0.04, 4.0, 4.0, 0.1])


def _rate(time):
    """Exact velocities by a complex step."""
    return np.imag(_slider_crank_pose(time + 1e-30j)) / 1e-30


def test_driven_slider_crank_follows_its_closed_form(mechanism_engine):
    """Without a freedom, pose, velocity and acceleration are those of the linkage to round-off."""
    engine = mechanism_engine(_slider_crank(), 2_000_000)
    assert engine.topology.freedom_count == 0
    for tick in range(500):
        engine.advance(tick, ())
        if tick % 25 != 24:
            continue
        time = (tick + 1) * 2e-3
        state = engine.state("run", tick, (tick + 1) * 2_000_000)
        q, v, a = (
            np.array([[getattr(body, key) for key in keys] for body in state.bodies]).reshape(-1)
            for keys in (
                ("x_m", "z_m", "angle_rad"),
                ("velocity_x_m_per_s", "velocity_z_m_per_s", "angular_velocity_rad_per_s"),
                ("acceleration_x_m_per_s2", "acceleration_z_m_per_s2", "angular_acceleration_rad_per_s2"),
            )
        )
        np.testing.assert_allclose(q, _slider_crank_pose(time), atol=1e-12)
        np.testing.assert_allclose(v, _rate(time), atol=1e-10)
        # central difference of exact velocities: h^2/6 of a third derivative of about 500 m/s^4, h = 1e-5
        differences = (_rate(time + 1e-5) - _rate(time - 1e-5)) / 2e-5
        np.testing.assert_allclose(a, differences, atol=1e-6)


def _driver_moment(time):
    """Power of inertia and gravity over the driver's speed."""

    def energy(at):
        return 0.5 * MASSES @ _rate(at) ** 2 + 9.81 * MASSES[1::3] @ _slider_crank_pose(at)[1::3]

    power = (energy(time + 1e-4) - energy(time - 1e-4)) / 2e-4
    return power / (SPEED + SWING * math.sin(2.0 * math.pi * SWING_HZ * time))


def test_driven_slider_crank_needs_the_moment_of_inverse_dynamics(mechanism_engine):
    """The driver's multiplier is the moment that the change of energy asks for; its work is that energy."""
    engine = mechanism_engine(_slider_crank(), 2_000_000)
    first = engine.state("run", -1, 0)
    for tick in range(500):
        engine.advance(tick, ())
        if tick % 50 != 49:
            continue
        state = engine.state("run", tick, (tick + 1) * 2_000_000)
        motor = state.joints[-1]
        # energy differences: h^2/6 of a third derivative of about 1e5 W/s^2, h = 1e-4, over 4 rad/s
        assert motor.moment_newton_m == pytest.approx(_driver_moment((tick + 1) * 2e-3), abs=1e-4)
        gained = (
            state.kinetic_energy_joule
            - first.kinetic_energy_joule
            + state.gravity_energy_joule
            - first.gravity_energy_joule
        )
        # Adams-Moulton of order 4 on a power that turns at 6 to 8 rad/s: (h w)^4 x 19/720 x power
        assert state.driver_work_joule == pytest.approx(gained, abs=1e-5)


def test_rail_reaction_on_the_ground_is_minus_that_on_the_slider(mechanism_engine):
    """A joint's reaction acts on body_b: exchanging the bodies turns its sign."""
    exchanged = _slider_crank()
    exchanged["joints"]["rail"].update(body_a="ground", body_b="slider")
    forces = [
        mechanism_engine(m).state("run", -1, 0).joints[3].force_z_newton for m in (_slider_crank(), exchanged)
    ]
    assert forces[0] == pytest.approx(-forces[1], abs=1e-9)
    assert abs(forces[0]) > 10.0
