"""Twisting friction: spin about the normal against a spring with a slider, in closed form."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.contact_laws.base import YES, Features
from subsoil_ros.contact_laws.linear.law import LinearNumbers
from subsoil_ros.dem.pairs import contact_of_pair

from ..soils import NEGLIGIBLE
from .impacts import laboratory, linear
from .test_dem_sizes import INERTIA as INERTIAS
from .test_dem_sizes import LARGE, LINEAR, REDUCED_RADIUS, SMALL, TANGENTIAL, run, two_spheres

RADIUS, DENSITY, GRAVITY = 0.01, 1800.0, 9.81
MASS = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3
INERTIA = 0.4 * MASS * RADIUS**2
K_N, K_T = 1e5, 8e4
NUMBERS = LinearNumbers(
    stiffness=K_N, tangential_stiffness=K_T, damping=0.0, tangential_damping=0.0, static_friction=0.5,
    sliding_friction=0.5, rolling_stiffness=K_T * (0.5 * RADIUS) ** 2, rolling_arm=0.2 * 0.5 * RADIUS,
    twisting_arm=0.1 * 0.5 * RADIUS,
)  # fmt: skip
TWISTS, ROLLS, BOTH = (
    Features(YES, YES if rolling else np.zeros(1), YES, twisting=YES if twisting else np.zeros(1))
    for rolling, twisting in ((False, True), (True, False), (True, True))
)
NONE = (0.0, 0.0, 0.0)


def twisting(law, friction):
    """`law` with this twisting friction in both rows."""
    return law | {row: law[row] | {"twisting_friction": friction} for row in ("particle", "boundary")}


def spinning(soil, at, one, surface, friction, spin, rolling, step_ns):
    """A sphere that rests on the floor or on a facet and spins about the vertical, started."""
    law = twisting(linear(K_N, K_T, 0.0, 0.0, 0.5, rolling or NEGLIGIBLE), friction)
    overlap, before, motions, tools = MASS * GRAVITY / K_N, (), (), {}
    if surface == "facets":  # from outside into the sphere, which a tool may not overlap at the start
        before, motions = at(0.06, -0.02 - overlap - 1e-9, 0.0), at(0.06, -0.02, 0.0)
        tools = {"tools": one(soil.box(0.1, 0.08, 0.02))}
    engine = laboratory(soil, law, RADIUS, DENSITY, step_ns, True, gravity_m_per_s2=GRAVITY, **tools)
    ground = -0.01 if tools else engine.bed.lower_m[2]
    place = (0.06, 0.0, ground + RADIUS - overlap)
    engine.place([place], None, [(0.0, 0.0, spin)])
    engine.start(before)
    return engine, motions


@pytest.mark.parametrize("surface", ["floor", "facets"])
def test_below_its_limit_twist_is_a_spring(soil, at, one, surface):
    """I w' = -K_t r^2 angle: the spin is a cosine, and the sphere stays where it is."""
    spin, step_ns, steps = 0.01, 2000, 1000
    engine, motions = spinning(soil, at, one, surface, 10.0, spin, 0.3, step_ns)
    place = engine.positions_m()[0]
    run(engine, steps, motions)
    omega, time = math.sqrt(K_T * RADIUS**2 / INERTIA), steps * step_ns * 1e-9
    phase = (omega * step_ns * 1e-9) ** 2 / 24.0 * omega * time  # of Verlet
    w = engine.angular_velocities_rad_per_s()[0]
    assert omega * time > 2.0 * math.pi
    assert_allclose(w, (0.0, 0.0, spin * math.cos(omega * time)), atol=2.0 * spin * phase)
    # the first half step falls freely where the tool is not there yet
    assert_allclose(engine.positions_m()[0], place, atol=1e-12 if surface == "floor" else 1e-8)


@pytest.mark.parametrize("surface", ["floor", "facets"])
@pytest.mark.parametrize("rolling", [0.0, 0.3])
def test_beyond_its_limit_twist_slows_at_a_constant_rate(soil, at, one, surface, rolling):
    """I w' = -mu_t r m g; kinetic energy lost = stored + sunk, whether there is rolling friction or not."""
    friction, spin, step_ns, steps = 0.1, 20.0, 2000, 10_000
    engine, motions = spinning(soil, at, one, surface, friction, spin, rolling, step_ns)
    start = engine.energy()
    run(engine, steps, motions)
    time = steps * step_ns * 1e-9
    rate = friction * RADIUS * MASS * GRAVITY / INERTIA
    w = engine.angular_velocities_rad_per_s()[0]
    # the torque begins in the first step, so the first half kick is without it
    assert_allclose(w, (0.0, 0.0, spin - rate * time), atol=rate * step_ns * 1e-9)
    end = engine.energy()
    lost = 0.5 * INERTIA * (spin**2 - w[2] ** 2)
    assert_allclose(end.sinks_joule["rolling"] - start.sinks_joule["rolling"], lost, rtol=1e-4)
    # where the tool came into the sphere, it bounces with 1e-8 of this
    assert_allclose(start.kinetic_joule - end.kinetic_joule, lost, rtol=1e-9 if surface == "floor" else 1e-7)


@pytest.mark.full
def test_torques_of_unequal_spheres_are_opposite_and_have_the_reduced_radius(soil):
    """-K_t R^2 times the angle on one, the same with the other sign on the other."""
    x = [(0.1, 0, -0.15), (0.1 + SMALL + LARGE - 1e-4, 0, -0.15)]
    w = np.array((10.0, 4.0))
    law = twisting(LINEAR, 0.1)
    engine = two_spheres(soil, 1000, x, w=[(w[0], 0, 0), (w[1], 0, 0)], law=law)
    run(engine, 1)
    torque = INERTIAS * (engine.angular_velocities_rad_per_s()[:, 0] - w) / 0.5e-6  # the second half kick
    expected = TANGENTIAL * REDUCED_RADIUS**2 * (w[0] - w[1]) * 1e-6
    assert_allclose(torque, [-expected, expected], rtol=1e-6)
    run(engine, 10)  # the limit; the spheres part slowly
    overlap = SMALL + LARGE - np.ptp(engine.positions_m()[:, 0])
    before = engine.angular_velocities_rad_per_s()[:, 0]
    run(engine, 1)
    torque = INERTIAS * (engine.angular_velocities_rad_per_s()[:, 0] - before) / 1e-6
    assert_allclose(torque[0], -torque[1], rtol=1e-9)
    assert abs(torque[0]) <= 1.05 * 0.1 * REDUCED_RADIUS * 1e5 * overlap


def applied(spin, roll, features, apart=(0.0199, 0.0, 0.0), relative=NONE, spin_j=NONE, step=1e-5):
    """Torque on i and springs of a pair of spheres."""
    _, _, on_i, on_j, _, roll, _, _ = contact_of_pair.py_func(
        apart, relative, spin, spin_j, RADIUS, RADIUS, NONE, roll, (), step, NUMBERS, features
    )
    return np.array(on_i), np.array(on_j), roll


def test_rolling_and_twisting_leave_each_other_alone():
    """Torques about the normal are those without rolling friction, those across it those without twisting."""
    roll, twist = (0.0, 1e-4, -2e-4), (3e-4, 0.0, 0.0)
    both = applied(NONE, (3e-4, 1e-4, -2e-4), BOTH)[0]
    assert_allclose(both[0], applied(NONE, twist, TWISTS)[0][0], rtol=1e-12)
    assert_allclose(both[1:], applied(NONE, roll, ROLLS)[0][1:], rtol=1e-12)
    assert both[0] != 0.0


@pytest.mark.parametrize("other", [False, True], ids=["one side", "seen from the other"])
def test_twist_turns_with_the_pair(other):
    """A pair that turns as a rigid body keeps its twist about the normal and gets no rolling from it."""
    steps, angle = 200, 1e-5
    turn = 0.5 * math.pi / steps
    step, distance = 1e-5, 2.0 * RADIUS - 1e-4
    side = -1.0 if other else 1.0
    spin = np.array((0.0, 0.0, turn / step))
    roll = (side * angle, 0.0, 0.0)
    place = side * np.array((distance, 0.0, 0.0))
    features = BOTH
    for k in range(1, steps + 1):
        now = side * distance * np.array((math.cos(k * turn), math.sin(k * turn), 0.0))
        relative = tuple(-(now - place) / step)  # as the drift goes: straight within a step
        place = now
        _, _, roll = applied(tuple(spin), roll, features, tuple(now), relative, tuple(spin), step)
    assert_allclose(roll, (0.0, side * angle, 0.0), atol=1e-12 * angle + 1e-18)
