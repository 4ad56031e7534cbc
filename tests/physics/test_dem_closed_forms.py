"""Collisions, sliding, rolling, inclines, columns and pull-off against closed forms, by the soil engine."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.physics.impacts import laboratory, linear

RADIUS, DENSITY, GRAVITY = 0.01, 1800.0, 9.81
MASS = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3
INERTIA = 0.4 * MASS * RADIUS**2


def room(soil, law, step_ns, gravity=GRAVITY, length=12.0, **changes):
    """An engine with spheres of 10 mm; `length` of the bin in radii."""
    return laboratory(soil, law, RADIUS, DENSITY, step_ns, length=length, gravity_m_per_s2=gravity, **changes)


def directions(turn):
    """Along a plate turned by `turn` [rad] and normal to it, world axes."""
    return (
        np.array((math.cos(turn), 0.0, math.sin(turn))),
        np.array((-math.sin(turn), 0.0, math.cos(turn))),
    )


def advance(engine, steps, motions=()):
    """`steps` ticks with the tools standing at `motions`."""
    for tick in range(steps):
        engine.advance(tick, motions)


@pytest.mark.parametrize(("damping", "order"), [(0.0, 2.0), (20.0, 1.0)])
def test_order_of_convergence_within_an_impact(soil, damping, order):
    """Half-way through a linear impact on the floor z is v/w e^(-b t) sin(w t) below touch: second order
    by velocity Verlet, first with a dashpot, which sees the half-step velocity."""
    stiffness, speed, time_ns = 1e5, 0.2, 400_000
    decay = damping / (2.0 * MASS)
    omega = math.sqrt(stiffness / MASS - decay**2)
    time = time_ns * 1e-9
    exact = speed / omega * math.exp(-decay * time) * math.sin(omega * time)
    errors = []
    for step_ns in (4000, 2000, 1000):
        engine = room(soil, linear(stiffness, c_n=damping), step_ns, gravity=0.0)
        floor = engine.bed.lower_m[2]
        engine.place([(0.06, 0.0, floor + RADIUS)], [(0.0, 0.0, -speed)])
        engine.start(())
        advance(engine, time_ns // step_ns)
        errors.append(abs(floor + RADIUS - engine.positions_m()[0, 2] - exact))
    observed = np.log2(np.divide(errors[:-1], errors[1:]))
    assert_allclose(observed, order, atol=0.1)


@pytest.mark.parametrize("surface", ["floor", "facets"])
@pytest.mark.parametrize("damping", [0.0, 4.0])
def test_friction_impulse_of_gross_sliding_is_mu_times_the_normal_impulse(soil, at, one, damping, surface):
    """v_t' = v_t - mu (1 + e) v_n with the e that comes out: to round-off without a dashpot, whose pull
    at the end of the impact friction does not see."""
    friction, vn, vt, turn = 0.2, 0.1, 1.0, 0.4
    law = linear(1e5, k_t=8e4, c_n=damping, mu=friction)
    if surface == "floor":
        turn, motions = 0.0, ()
        engine = room(soil, law, 2000, gravity=0.0, length=60.0)
        place = np.array((0.1, 0.0, engine.bed.lower_m[2] + RADIUS))
    else:
        motions = at(0.3, -0.06, turn)
        engine = room(soil, law, 2000, gravity=0.0, length=60.0, tools=one(soil.box(0.2, 0.08, 0.02)))
    along, normal = directions(turn)
    if surface == "facets":
        place = np.array((0.3, 0.0, -0.06)) - 0.05 * along + (0.01 + RADIUS + 1e-7) * normal
    engine.place([place], [vt * along - vn * normal])
    engine.start(motions)
    advance(engine, 600, motions)
    v, w = engine.velocities_m_per_s()[0], engine.angular_velocities_rad_per_s()[0, 1]
    gained = v @ normal + vn
    assert_allclose(gained, 2.0 * vn if damping == 0.0 else 1.8 * vn, rtol=0.02)
    assert_allclose(vt - v @ along, friction * gained, rtol=0.01 if damping else 1e-9)
    # the arm shortens by half the overlap, v_n / omega at most
    overlap = vn * math.sqrt(MASS / 1e5)
    assert_allclose(w, 2.5 * friction * gained / RADIUS, rtol=0.5 * overlap / RADIUS + 0.01)


@pytest.mark.parametrize("ratio", [2.0 / 7.0, 0.5, 0.8])
def test_tangential_restitution_of_a_sticking_impact(soil, ratio):
    """Two linear springs: beta = -cos(pi sqrt(7/2 k_t / k_n)) (J. Schaefer, S. Dippel, D.E. Wolf, J. Phys. I
    6 (1996) 5-20); 2/7 turns the surface's velocity round."""
    stiffness, step_ns, vn, vt = 1e5, 1000, 0.01, 0.005
    engine = room(soil, linear(stiffness, k_t=ratio * stiffness, mu=1e3), step_ns, gravity=0.0)
    engine.place([(0.06, 0.0, engine.bed.lower_m[2] + RADIUS)], [(vt, 0.0, -vn)])
    engine.start(())
    advance(engine, 1000)
    v, w = engine.velocities_m_per_s()[0], engine.angular_velocities_rad_per_s()[0, 1]
    assert_allclose(v[2], vn, rtol=1e-4)
    beta = -(v[0] - RADIUS * w) / vt
    # the end of contact is met to one step, omega_t dt of a period; the arm is short by 1e-4
    tolerance = math.sqrt(3.5 * ratio * stiffness / MASS) * step_ns * 1e-9 + 1e-3
    assert_allclose(beta, -math.cos(math.pi * math.sqrt(3.5 * ratio)), atol=tolerance)


def test_a_sphere_thrown_sliding_rolls_after_the_closed_form_time(soil):
    """It slows at mu g and spins up at 5/2 mu g / r till t = 2 v / (7 mu g), then rolls at 5/7 v."""
    speed, friction, step_ns = 0.35, 0.3, 20_000
    engine = room(soil, linear(1e5, 8e4, 10.0, 10.0, friction), step_ns, length=60.0)
    engine.place([(0.05, 0.0, engine.bed.lower_m[2] + RADIUS - MASS * GRAVITY / 1e5)], [(speed, 0.0, 0.0)])
    engine.start(())
    rolls = 2.0 * speed / (7.0 * friction * GRAVITY)
    for tick in range(2500):
        engine.advance(tick, ())
        time = (tick + 1) * step_ns * 1e-9
        # the slip ends while the spring still holds mu m g: it swings for some m / C
        if abs(time - rolls) > 3e-3:
            slid = min(time, rolls)
            v, w = engine.velocities_m_per_s()[0, 0], engine.angular_velocities_rad_per_s()[0, 1]
            assert_allclose(v, speed - friction * GRAVITY * slid, rtol=2e-3)
            assert_allclose(RADIUS * w, 2.5 * friction * GRAVITY * slid, rtol=2e-3, atol=2e-3 * speed)
    assert_allclose(v, 5.0 / 7.0 * speed, rtol=1e-3)


def test_below_its_limit_rolling_friction_is_a_spring(soil):
    """A resting sphere turned a little rocks on its tangential and its rolling spring, two coupled
    oscillators without loss: m x'' = -k s, I w' = a k s - k_r phi, s' = x' - a w."""
    stiffness, step_ns, steps, spin = 8e4, 2000, 2500, 0.01
    engine = room(soil, linear(1e5, k_t=stiffness, mu=10.0, mu_r=0.5), step_ns)
    height = RADIUS - MASS * GRAVITY / 1e5
    engine.place([(0.06, 0.0, engine.bed.lower_m[2] + height)], None, [(0.0, spin, 0.0)])
    engine.start(())
    advance(engine, steps)
    arm, k_r = 0.5 * (RADIUS + height), stiffness * RADIUS**2
    # in x sqrt(m) and phi sqrt(I): a symmetric matrix of stiffness
    scale = np.array((MASS, INERTIA)) ** -0.5
    matrix = np.array(((stiffness, -arm * stiffness), (-arm * stiffness, arm**2 * stiffness + k_r)))
    squares, modes = np.linalg.eigh(scale[:, None] * matrix * scale)
    omega, time = np.sqrt(squares), steps * step_ns * 1e-9
    start = modes.T @ (np.array((0.0, spin)) / scale)
    v, w = scale * (modes @ (start * np.cos(omega * time)))
    # Verlet runs fast by (omega dt)^2 / 24
    phase = (omega * step_ns * 1e-9) ** 2 / 24.0 * omega * time
    assert_allclose(engine.angular_velocities_rad_per_s()[0, 1], w, atol=2.0 * spin * phase.max())
    assert_allclose(engine.velocities_m_per_s()[0, 0], v, atol=2.0 * spin * RADIUS * phase.max())


@pytest.mark.parametrize(("slope", "motion"), [(0.08, "stays"), (0.3, "rolls"), (0.6, "slides")])
def test_a_sphere_on_an_incline_with_rolling_friction(soil, at, one, slope, motion):
    """It stays below tan a = mu_r, then rolls at g (sin a - mu_r cos a) / (7/5), and slides at
    g (sin a - mu cos a) where tan a > (7/2 mu - 5/2 mu_r)."""
    friction, rolling, step_ns, steps = 0.2, 0.1, 40_000, 4000
    assert math.atan(0.08) < math.atan(rolling) < 0.3 < math.atan(3.5 * friction - 2.5 * rolling) < 0.6
    law = linear(1e5, 8e4, 10.0, 10.0, friction, rolling)
    engine = room(soil, law, step_ns, length=120.0, tools=one(soil.box(0.9, 0.08, 0.02)))
    here = np.array((0.6, 0.0, 0.3))
    along, normal = directions(slope)
    engine.place([here + 0.3 * along + (0.01 + RADIUS + 1e-9) * normal])
    motions = at(here[0], here[2], slope)
    engine.start(motions)
    advance(engine, steps // 4, motions)
    first = engine.velocities_m_per_s()[0] @ along
    place = engine.positions_m()[0]
    advance(engine, steps, motions)
    gained = (first - engine.velocities_m_per_s()[0] @ along) / (steps * step_ns * 1e-9)
    down = {
        "stays": 0.0,
        "rolls": GRAVITY * (math.sin(slope) - rolling * math.cos(slope)) / 1.4,
        "slides": GRAVITY * (math.sin(slope) - friction * math.cos(slope)),
    }[motion]
    # overlaps are 1e-4 of the radius; the springs have swung out in the first quarter
    assert_allclose(gained, down, rtol=1e-3, atol=1e-3)
    if motion == "stays":
        # it swings on its rolling spring, by at most twice m g r sin a / k_r in angle
        swing = 2.0 * MASS * GRAVITY * RADIUS * math.sin(slope) / (8e4 * RADIUS**2) * RADIUS
        assert_allclose(engine.positions_m()[0], place, atol=swing)


@pytest.mark.parametrize("kind", ["linear", "wet"])
def test_overlaps_of_a_column_are_the_weight_above_over_the_stiffness(soil, kind):
    """Contact n from the top carries n m g: beyond rest it overlaps by n m g / K."""
    count, step = 5, 5e-5
    if kind == "linear":
        engine = room(soil, linear(2e4, c_n=8.0), round(step * 1e9))
        stiffness, boundary, rest = 2e4, 2e4, 0.0
    else:
        engine = soil.engine(f"soil.time_step_s={step}", "soil.bin.depth_m=0.12")
        stiffness, boundary, rest = 5e3, 1e4 * 1.6e4 / 2.6e4, 0.002
    floor = engine.bed.lower_m[2]
    gaps = np.full(count, 2.0 * RADIUS - rest)
    gaps[0] -= RADIUS
    engine.place([(0.06, 0.0, floor + z) for z in np.cumsum(gaps)])
    engine.start(())
    advance(engine, 20_000)
    z = np.sort(engine.positions_m()[:, 2]) - floor
    carried = MASS * GRAVITY * np.arange(count, 0, -1)
    overlaps = gaps - np.diff(z, prepend=0.0)
    assert_allclose(overlaps, carried / np.array([boundary] + [stiffness] * (count - 1)), rtol=1e-6)


@pytest.mark.parametrize("load", [0.98, 1.02])
def test_pull_off_force_is_the_peak_of_the_wet_law(soil, at, one, load):
    """A sphere hangs under a plate at delta_c - m g / K_C while m g < K_B delta_B, and falls beyond."""
    adhesion = 7_000.0 * 3_000.0 / 10_000.0
    gravity = load * adhesion * 0.002 / MASS
    engine = soil.engine(
        f"gravity_m_per_s2={gravity}", "soil.bin.depth_m=0.1",
        tools=one(soil.box(0.08, 0.08, 0.02)),
    )  # fmt: skip
    overlap = max(0.002 - load * 0.002, 1e-6)
    motions = at(0.06, 0.0)
    engine.place([(0.06, 0.0, -0.01 - RADIUS + overlap)])
    engine.start(motions)
    advance(engine, 1000, motions)
    sunk = -0.01 - RADIUS + overlap - engine.positions_m()[0, 2]
    if load < 1.0:
        assert_allclose(sunk, 0.0, atol=1e-8)  # corners of the mesh are float32
    else:
        assert sunk > 0.01


@pytest.mark.parametrize("share", [0.9, 1.5])
def test_work_of_pull_off_is_the_area_under_the_wet_law(soil, share):
    """Two spheres part from rest only with more than W = (K_B delta_B^2 + K_C delta_c^2) / 2, and keep
    what is over; nothing is damped on the way."""
    work = 0.5 * 3_500.0 * 0.002**2 * 2.0
    engine = soil.engine("gravity_m_per_s2=0", "soil.time_step_s=1e-5")
    speed = math.sqrt(share * work / MASS)  # of each: m v^2 together
    gap = 2.0 * RADIUS - 0.002 + 1e-12
    engine.place([(0.05, 0, -0.05), (0.05 + gap, 0, -0.05)], [(-speed, 0, 0), (speed, 0, 0)])
    engine.start(())
    kinetic = []
    for tick in range(1200):
        engine.advance(tick, ())
        kinetic.append(MASS * engine.velocities_m_per_s()[1, 0] ** 2)
    apart = np.linalg.norm(np.diff(engine.positions_m(), axis=0)) - 2.0 * RADIUS
    if share > 1.0:
        assert apart > 0.002
        # second order in omega dt = 0.01; the kinks of the law are met to one step
        assert_allclose(kinetic[-1], (share - 1.0) * work, rtol=1e-3)
    else:
        assert apart < 0.002
        assert min(kinetic) < 1e-3 * work
