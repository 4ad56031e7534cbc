"""Machines with many freedoms: the multiplier equations solved as a whole, in a narrow band."""

import numpy as np
import pytest

GRAVITY = 9.81


def _pin(body_a, body_b, x, z):
    return {"kind": "revolute", "body_a": body_a, "body_b": body_b, "point_m": (x, z)}


def _chain(count, masses=None):
    """Level rods of 0.1 m hung on one another at the origin; `masses` of the rods [kg]."""
    names = ["ground", *(f"rod{i}" for i in range(count))]
    masses = np.full(count, 0.1) if masses is None else masses
    bodies = {
        name: {"mass_kg": mass, "inertia_kg_m2": mass * 1e-3, "position_m": (0.1 * i + 0.05, 0.0)}
        for i, (name, mass) in enumerate(zip(names[1:], map(float, masses), strict=True))
    }
    joints = {f"pin{i}": _pin(names[i], names[i + 1], 0.1 * i, 0.0) for i in range(count)}
    return {"bodies": bodies, "joints": joints}


def _ladder(rungs):
    """Two level chains, joined by an upright rung at every pin: closed loops and many freedoms."""
    bodies, joints = {}, {}
    rod = {"mass_kg": 0.1, "inertia_kg_m2": 1e-4}
    for side, z in (("low", 0.0), ("high", 0.1)):
        last = "ground"
        for i in range(rungs):
            name = f"{side}{i}"
            bodies[name] = {**rod, "position_m": (0.1 * i + 0.05, z)}
            joints[f"{name}_pin"] = _pin(last, name, 0.1 * i, z)
            last = name
    for i in range(rungs):
        bodies[f"rung{i}"] = {**rod, "position_m": (0.1 * i + 0.1, 0.05)}
        for side, z in (("low", 0.0), ("high", 0.1)):
            joints[f"rung{i}_{side}"] = _pin(f"{side}{i}", f"rung{i}", 0.1 * i + 0.1, z)
    return {"bodies": bodies, "joints": joints}


def _energy(state):
    return state.kinetic_energy_joule + state.gravity_energy_joule


def _drift(engine, ticks, communication_step_ns):
    start, worst = _energy(engine.state("run", -1, 0)), 0.0
    for tick in range(ticks):
        engine.advance(tick, ())
        if (tick + 1) % (ticks // 10) == 0:
            state = engine.state("run", tick, (tick + 1) * communication_step_ns)
            worst = max(worst, abs(_energy(state) - start))
            assert state.position_residual_m < 1e-11
            assert state.velocity_residual_m_per_s < 1e-10
    return worst


@pytest.mark.parametrize(("count", "decades"), [(30, 0.0), (30, 4.0), (100, 0.0)])
def test_chain_starts_to_fall_as_the_full_equations_say(mechanism_engine, count, decades):
    """Accelerations and pins' forces of a released chain are those of all equations solved at once by numpy.

    `decades`: masses alternate by this power of ten. The numbers differ by round-off times the condition of
    the chain, whose freedoms spread over count^2.
    """
    masses = 0.1 * 10.0 ** (decades * (np.arange(count) % 2))
    state = mechanism_engine(_chain(count, masses)).state("run", -1, 0)
    jacobian, unknown = np.zeros((2 * count, 3 * count)), np.repeat(masses, 3)
    unknown[2::3] *= 1e-3
    for i in range(count):
        jacobian[2 * i, 3 * i] = jacobian[2 * i + 1, 3 * i + 1] = 1.0
        jacobian[2 * i + 1, 3 * i + 2] = -0.05
        if i > 0:
            jacobian[2 * i, 3 * i - 3] = jacobian[2 * i + 1, 3 * i - 2] = -1.0
            jacobian[2 * i + 1, 3 * i - 1] = -0.05
    matrix = np.block([[np.diag(unknown), jacobian.T], [jacobian, np.zeros((2 * count, 2 * count))]])
    weight = np.zeros(5 * count)
    weight[1 : 3 * count : 3] = -GRAVITY * masses
    exact = np.linalg.solve(matrix, weight)
    ours = [(b.acceleration_x_m_per_s2, b.acceleration_z_m_per_s2, b.angular_acceleration_rad_per_s2)
            for b in state.bodies]  # fmt: skip
    scale = np.abs(exact[: 3 * count]).max()
    np.testing.assert_allclose(np.ravel(ours), exact[: 3 * count], atol=1e-11 * count**2 * scale)
    pins = np.ravel([(j.force_x_newton, j.force_z_newton) for j in state.joints])
    scale = np.abs(exact[3 * count :]).max()
    np.testing.assert_allclose(pins, -exact[3 * count :], atol=1e-11 * count**2 * scale)


@pytest.mark.parametrize("machine", [_chain(24), _ladder(12)], ids=["chain", "ladder"])
def test_falling_chain_and_ladder_keep_their_energy(mechanism_engine, machine):
    """The energy of free fall drifts 2^4 less at half the step, and constraints stay closed."""
    drifts = [_drift(mechanism_engine(machine, ns), 200_000_000 // ns, ns) for ns in (1_000_000, 500_000)]
    assert np.log2(drifts[0] / drifts[1]) > 3.5
    assert drifts[1] < 1e-6


def test_few_and_many_freedoms_move_alike(mechanism_engine):
    """Nine separate pendulums are solved as a whole, one of them alone is not: the same motion."""
    bob = {"mass_kg": 2.0, "inertia_kg_m2": 0.06, "angular_velocity_rad_per_s": 3.0}
    bodies = {f"bob{i}": {**bob, "position_m": (float(i) + 0.3, -0.4)} for i in range(9)}
    joints = {f"pin{i}": _pin("ground", f"bob{i}", float(i), 0.0) for i in range(9)}
    many = mechanism_engine({"bodies": bodies, "joints": joints})
    one = mechanism_engine(
        {"bodies": {"bob": bodies["bob0"]}, "joints": {"pin": _pin("ground", "bob", 0.0, 0.0)}}
    )
    for engine in (many, one):
        for tick in range(300):
            engine.advance(tick, ())
    expected, several = (engine.state("run", 299, 300_000_000) for engine in (one, many))
    assert expected.bodies[0].angle_rad != 0.0
    for i in range(9):
        assert several.bodies[i].angle_rad == pytest.approx(expected.bodies[0].angle_rad, abs=1e-11)
        for key in ("force_x_newton", "force_z_newton"):
            assert getattr(several.joints[i], key) == pytest.approx(
                getattr(expected.joints[0], key), abs=1e-8
            )


def test_redundant_joint_among_many_freedoms_shares_the_load(mechanism_engine):
    """A pin given twice moves nothing; each of the two carries half (the smallest multipliers)."""
    single, double = _chain(12), _chain(12)
    double["joints"]["again"] = _pin("ground", "rod0", 0.0, 0.0)
    with pytest.warns(UserWarning, match="pin0, again"):
        engines = [mechanism_engine(single), mechanism_engine(double)]
    states = []
    for engine in engines:
        for tick in range(100):
            engine.advance(tick, ())
        states.append(engine.state("run", 99, 100_000_000))
    for alone, both in zip(states[0].bodies, states[1].bodies, strict=True):
        assert both.angle_rad == pytest.approx(alone.angle_rad, abs=1e-10)
    pins = {joint.name: joint for joint in states[1].joints}
    for name in ("pin0", "again"):
        assert not pins[name].unique
        half = 0.5 * states[0].joints[0].force_z_newton
        assert pins[name].force_z_newton == pytest.approx(half, rel=1e-6)
