"""The seven-body machine under a soil force, against an integration of its four free coordinates.

These are the angles of lower link, shank and both wheels. All poses follow in closed form (two circles
meet in the four-bar of the hitch); velocities are their derivatives, by complex step. No constraint, no
multiplier, no partition: reactions come from Newton's law for a body.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

GRAVITY = 9.81
SHANK, LEFT, RIGHT, LOWER, TROLLEY, UPPER, FRAME = range(7)
MASS = np.array([35.2, 25.0, 25.0, 7.8, 100.0, 10.0, 68.0])
INERTIA = np.array([2.662, 0.5585, 0.5585, 0.3104, 8e4, 0.1896, 7.022])
CENTRE = np.array([[0.02, 0.15], [0.55, 0.2], [0.55, 0.2], [1.145, 0.425], [1.6, 0.68], [1.0872, 0.885],
                   [0.35, 0.52]])  # fmt: skip
H2, H3, H4, H5 = map(np.array, ([1.49, 0.45], [1.3244, 0.91], [0.80, 0.40], [0.85, 0.86]))
AXLE, HINGE, TIP = np.array([0.55, 0.20]), np.array([0.0, 0.40]), np.array([0.06, -0.22])
SPRING_FRAME, SPRING_SHANK = np.array([0.40, 0.65]), np.array([0.0, 0.65])
SPEED = 0.5


def _turned(angle, vector):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def _turn_of(start, end):
    """Angle by which the vector `start` was turned into `end`; analytic, for complex steps."""
    return np.arctan((start[0] * end[1] - start[1] * end[0]) / (start[0] * end[0] + start[1] * end[1]))


def _pose(y, time):
    """Coordinates (21, ...) of all bodies at y (4, ...)."""
    lower, shank, left, right = y
    trolley = np.array([1.60 + SPEED * time, 0.68 + 0.0 * time])
    hitch_low, hitch_high = ((trolley.T + (point - CENTRE[TROLLEY])).T for point in (H2, H3))
    lower_centre = hitch_low + _turned(lower, CENTRE[LOWER] - H2)
    knee = hitch_low + _turned(lower, H4 - H2)
    # the other knee: to_high from the high hitch, to_low from the low knee
    span, to_high, to_low = knee - hitch_high, np.sum((H5 - H3) ** 2), np.sum((H5 - H4) ** 2)
    square = span[0] ** 2 + span[1] ** 2
    along = 0.5 * (square + to_high - to_low) / square
    first = H4 - H3
    side = np.sign(first[0] * (H5 - H3)[1] - first[1] * (H5 - H3)[0])
    high = hitch_high + along * span
    high = high + side * np.sqrt(to_high / square - along**2) * np.array([-span[1], span[0]])
    upper, frame = _turn_of(H5 - H3, high - hitch_high), _turn_of(H5 - H4, high - knee)
    axle, hinge = (knee + _turned(frame, point - H4) for point in (AXLE, HINGE))
    still = 0.0 * lower
    parts = {
        SHANK: (*(hinge + _turned(shank, CENTRE[SHANK] - HINGE)), shank),
        LEFT: (*axle, left),
        RIGHT: (*axle, right),
        LOWER: (*lower_centre, lower),
        TROLLEY: (*(trolley + still), still),
        UPPER: (*(hitch_high + _turned(upper, CENTRE[UPPER] - H3)), upper),
        FRAME: (*(knee + _turned(frame, CENTRE[FRAME] - H4)), frame),
    }
    return np.array([part for body in range(7) for part in parts[body]])


def _speeds(y, u, time):
    """Velocities (21,) at y, y' = u, and their derivatives (21, 4) by u; complex steps."""
    size = 1e-30
    steps = 1j * size * np.eye(5)
    tangents = _pose(y[:, None] + steps[:4], time + steps[4]).imag / size
    return tangents[:, 4] + tangents[:, :4] @ u, tangents[:, :4]


def _bias(y, u, time):
    """Accelerations (21,) with y'' = 0: fourth-order central difference of the velocities along the motion.

    At 0.5 ms its error is 1e-3 of (0.5 ms)^4 times the sixth power of some 10 rad/s: far below 1e-9.
    """
    step = 5e-4
    weights = ((1.0, -2), (-8.0, -1), (8.0, 1), (-1.0, 2))
    total = sum(w * _speeds(y + k * step * u, u, time + k * step)[0] for w, k in weights)
    return total / (12.0 * step)


def _soil(time):
    wave = 1.0 - np.cos(2.0 * np.pi * 3.0 * time)
    return -900.0 * wave, -200.0 * wave


def _forces(q, v, time):
    """Generalised forces (7, 3) of weight, spring, wheels and soil."""
    q, v, total = q.reshape(7, 3), v.reshape(7, 3), np.zeros((7, 3))
    total[:, 1] -= GRAVITY * MASS

    def push(body, point, force):
        arm = _turned(q[body, 2], point - CENTRE[body])
        total[body] += [force[0], force[1], arm[0] * force[1] - arm[1] * force[0]]

    ends = []
    for body, point in ((FRAME, SPRING_FRAME), (SHANK, SPRING_SHANK)):
        arm = _turned(q[body, 2], point - CENTRE[body])
        ends.append((q[body, :2] + arm, v[body, :2] + v[body, 2] * np.array([-arm[1], arm[0]])))
    span, rate = ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]
    length = np.linalg.norm(span)
    tension = 176_500.0 * (length - 0.38735) + 1000.0 * (span / length) @ rate
    push(FRAME, SPRING_FRAME, tension * span / length)
    push(SHANK, SPRING_SHANK, -tension * span / length)
    for wheel in (LEFT, RIGHT):
        normal = 60_000.0 * (0.2 - q[wheel, 1]) - 1500.0 * v[wheel, 1]
        assert normal > 0.0, "the comparison needs wheels that stay on the ground"
        rub = -0.4 * normal * np.tanh((v[wheel, 0] + 0.2 * v[wheel, 2]) / 0.02)
        total[wheel] += [rub, normal, 0.2 * rub]
    push(SHANK, TIP, _soil(time))
    return total


def _motion(y, u, time):
    """q, v, a (21,) and the applied forces (7, 3); y'' solves the projection of Newton's law."""
    v, tangent = _speeds(y, u, time)
    q, bias = _pose(y, time), _bias(y, u, time)
    masses, forces = np.stack([MASS, MASS, INERTIA], axis=1).reshape(-1), _forces(q, v, time)
    weighted = tangent.T * masses
    spin = np.linalg.solve(weighted @ tangent, tangent.T @ forces.reshape(-1) - weighted @ bias)
    return q, v, bias + tangent @ spin, forces, spin


def _slope(time, state):
    return np.concatenate([state[4:], _motion(state[:4], state[4:], time)[4]])


def _loaded(machine):
    sine = {"kind": "sine", "frequency_hz": 3.0, "phase_rad": 0.5 * np.pi}
    machine["forces"]["soil"] = {
        "kind": "point_load",
        "body": "shank",
        "point_m": tuple(TIP),
        "force_x_newton": {**sine, "mean": -900.0, "amplitude": 900.0},
        "force_z_newton": {**sine, "mean": -200.0, "amplitude": 200.0},
    }
    return machine


def _arrays(state):
    q = [(b.x_m, b.z_m, b.angle_rad) for b in state.bodies]
    v = [(b.velocity_x_m_per_s, b.velocity_z_m_per_s, b.angular_velocity_rad_per_s) for b in state.bodies]
    return np.ravel(q), np.ravel(v)


@pytest.fixture
def machine(subsoiler):
    """The machine under the soil's force."""
    return _loaded(subsoiler)


def test_machine_follows_its_minimal_coordinates(mechanism_engine, machine):
    """0.5 s under a swinging soil force: positions, draft and the hinge's reaction at five times.

    At 0.25 ms the method's own error (order 4) is below 1e-8 m; forces follow with the spring's 1.8e5 N/m.
    """
    engine = mechanism_engine(machine, 250_000)
    q, v = _arrays(engine.state("run", -1, 0))
    chosen = [3 * body + 2 for body in (LOWER, SHANK, LEFT, RIGHT)]
    np.testing.assert_allclose(_pose(q[chosen], 0.0), q, atol=1e-11)  # the same assembly
    times = np.linspace(0.1, 0.5, 5)
    run = solve_ivp(_slope, (0.0, 0.5), np.concatenate([q[chosen], v[chosen]]), "DOP853", times, rtol=1e-9,
                    atol=1e-11)  # fmt: skip
    tick = -1
    for time, y in zip(times, run.y.T, strict=True):
        while tick < round(time / 250e-6) - 1:
            tick += 1
            engine.advance(tick, ())
        state = engine.state("run", tick, (tick + 1) * 250_000)
        exact_q, exact_v, exact_a, forces, _ = _motion(y[:4], y[4:], time)
        ours, rates = _arrays(state)
        np.testing.assert_allclose(ours, exact_q, atol=1e-7)
        np.testing.assert_allclose(rates, exact_v, atol=1e-5)
        sums = np.sum(MASS * exact_a[0::3]) - forces[:, 0].sum()
        assert state.draft_newton == pytest.approx(sums, abs=0.05)
        hinge = next(joint for joint in state.joints if joint.name == "H8")
        needed = MASS[SHANK] * exact_a[:2] - forces[SHANK, :2]
        np.testing.assert_allclose((hinge.force_x_newton, hinge.force_z_newton), needed, atol=0.05)
    assert state.draft_newton > 500.0
