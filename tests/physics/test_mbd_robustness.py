"""Machines at the edges: extreme masses and stiffness, toggles, contradictions, bad input."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from subsoil_ros.errors import PhysicsError, SceneError, SingularMechanismError, SubsoilError
from subsoil_ros.mbd.machine_arrays import EVENT_COUNT
from subsoil_ros.scene.mechanism import Mechanism


def _body(x, z, mass=1.0, inertia=0.1, **rest):
    return {"mass_kg": mass, "inertia_kg_m2": inertia, "position_m": (x, z), **rest}


def _pin(body_a, body_b, x, z, **rest):
    return {"kind": "revolute", "body_a": body_a, "body_b": body_b, "point_m": (x, z), **rest}


def _run(engine, ticks):
    for tick in range(ticks):
        engine.advance(tick, ())


def _energy(state):
    return state.kinetic_energy_joule + state.gravity_energy_joule + state.spring_energy_joule


def test_masses_and_stiffness_over_many_decades(mechanism_engine):
    """1e-3 and 1e5 kg pinned together on a spring of 1e9 N/m: rings at its frequency, keeps its energy."""
    machine = {
        "bodies": {"block": _body(0.0, -1.0, 1e5, 1e4), "pointer": _body(0.05, -1.0, 1e-3, 1e-6)},
        "joints": {
            "rail": {"kind": "prismatic", "body_a": "ground", "body_b": "block", "point_m": (0.0, 0.0),
                     "axis": (0.0, 1.0)},
            "pin": _pin("block", "pointer", 0.0, -1.0),
        },
        "forces": {"spring": {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0),
                              "body_b": "block", "point_b_m": (0.0, -1.0), "free_length_m": 0.999,
                              "stiffness_newton_per_m": 1e9}},
    }  # fmt: skip
    engine = mechanism_engine(machine, 100_000, gravity_m_per_s2=0.0)
    first = _energy(engine.state("run", -1, 0))
    for tick in range(2000):
        engine.advance(tick, ())
    state = engine.state("run", 1999, 200_000_000)
    assert state.bodies[0].z_m == pytest.approx(-0.999 - 1e-3 * math.cos(100.0 * 0.2), abs=1e-8)
    assert _energy(state) == pytest.approx(first, rel=1e-6)
    assert state.position_residual_m < 1e-11


def test_toggle_is_passed_or_named(mechanism_engine):
    """A crank driven through both dead centres of its slider follows the closed form."""
    machine = {
        "bodies": {"crank": _body(0.0, 0.5), "rod": _body(0.6, 0.5), "slider": _body(1.2, 0.0)},
        "joints": {
            "main": _pin("ground", "crank", 0.0, 0.0), "big": _pin("crank", "rod", 0.0, 1.0),
            "small": _pin("rod", "slider", 1.2, 0.0),
            "rail": {"kind": "prismatic", "body_a": "ground", "body_b": "slider", "point_m": (1.2, 0.0),
                     "axis": (1.0, 0.0)},
            "motor": {"kind": "driver", "body": "crank", "coordinate": "angle",
                      "speed": {"kind": "constant", "value": 5.0}},
        },
    }  # fmt: skip
    engine = mechanism_engine(machine, 1_000_000)
    rod = math.hypot(1.2, 1.0)
    for tick in range(1300):
        engine.advance(tick, ())
        if tick % 100 == 99:
            state = engine.state("run", tick, (tick + 1) * 1_000_000)
            angle = 0.5 * math.pi + 5e-3 * (tick + 1)
            place = math.cos(angle) + math.sqrt(rod**2 - math.sin(angle) ** 2)
            assert state.bodies[2].x_m == pytest.approx(place, abs=1e-10)


@pytest.mark.parametrize(("speed", "communication_step_ns", "settings", "words"), [
    (1.0, 1_000_000, {}, "knee"), (0.01, 5_000_000, {}, "knee"),
    (0.01, 5_000_000, {"tolerance": None}, "the joints cannot be closed any more.*knee")])  # fmt: skip
def test_overlong_drive_against_a_linkage_ends_by_name(
    mechanism_engine, speed, communication_step_ns, settings, words
):
    """A relative driver that asks a knee for more than it can stretch names the joints, never NaN."""
    machine = {
        "bodies": {"upper": _body(0.3, 0.4), "lower": _body(0.9, 0.4), "foot": _body(1.2, 0.0)},
        "joints": {
            "hip": _pin("ground", "upper", 0.0, 0.0), "knee": _pin("upper", "lower", 0.6, 0.8),
            "ankle": _pin("lower", "foot", 1.2, 0.0),
            "rail": {"kind": "prismatic", "body_a": "ground", "body_b": "foot", "point_m": (1.2, 0.0),
                     "axis": (1.0, 0.0)},
            "pull": {"kind": "driver", "body": "foot", "coordinate": "x", "relative_to": "ground",
                     "speed": {"kind": "constant", "value": speed}},
        },
        **settings,
    }  # fmt: skip
    engine = mechanism_engine(machine, communication_step_ns)
    with pytest.raises(SingularMechanismError, match=words):
        _run(engine, 20_000)
    assert np.isfinite(engine.arrays.q).all()
    assert np.isfinite(engine.arrays.a).all()


def test_machine_that_comes_to_rest_in_a_singular_pose_ends_by_name(mechanism_engine):
    """A parallelogram pulled flat by a damped spring stays where its pins say too little: never NaN."""
    machine = {
        "bodies": {"left": _body(0.0, 0.5), "right": _body(1.0, 0.5), "bar": _body(0.5, 1.0)},
        "joints": {
            "a": _pin("ground", "left", 0.0, 0.0), "b": _pin("left", "bar", 0.0, 1.0),
            "c": _pin("bar", "right", 1.0, 1.0), "d": _pin("ground", "right", 1.0, 0.0),
        },
        "forces": {"fold": {"kind": "torsion_spring", "body_a": "ground", "body_b": "left",
                            "stiffness_newton_m_per_rad": 400.0, "damping_newton_m_s_per_rad": 60.0,
                            "rest_angle_rad": -0.5 * math.pi}},
    }  # fmt: skip
    engine = mechanism_engine(machine, 1_000_000, gravity_m_per_s2=0.0)
    with pytest.raises(SingularMechanismError, match=r"joints .*singular position"):
        _run(engine, 5000)
    assert engine.arrays.q[2] == pytest.approx(-0.5 * math.pi, abs=2e-3)
    assert np.isfinite(engine.arrays.q).all()


def test_resting_contact_does_not_chatter(mechanism_engine):
    """A dropped wheel comes to rest on its damped contact; the switches end, and it carries its weight."""
    contact = {"kind": "wheel_contact", "body": "wheel", "radius_m": 0.2, "stiffness_newton_per_m": 2e4,
               "damping_newton_s_per_m": 150.0, "friction": 0.3}  # fmt: skip
    machine = {"bodies": {"wheel": _body(0.0, 0.25, 10.0)}, "forces": {"tread": contact}}
    engine = mechanism_engine(machine, 500_000)
    for tick in range(3000):
        engine.advance(tick, ())
    events = engine.arrays.counters[EVENT_COUNT]
    for tick in range(3000, 4000):
        engine.advance(tick, ())
    assert engine.arrays.counters[EVENT_COUNT] == events < 20
    state = engine.state("run", 3999, 2_000_000_000)
    assert state.forces[0].load == pytest.approx(98.1, rel=1e-5)


def test_relative_drivers_that_disagree_contradict_each_other(mechanism_engine):
    """An absolute and a relative driver of one angle with two speeds are refused by name."""
    machine = {
        "bodies": {"wheel": _body(0.0, 0.0)},
        "joints": {
            "pin": _pin("ground", "wheel", 0.0, 0.0),
            "one": {"kind": "driver", "body": "wheel", "coordinate": "angle",
                    "speed": {"kind": "constant", "value": 1.0}},
            "two": {"kind": "driver", "body": "wheel", "coordinate": "angle", "relative_to": "ground",
                    "speed": {"kind": "constant", "value": 2.0}},
        },
    }  # fmt: skip
    with pytest.raises(SceneError, match="one, two contradict each other"):
        mechanism_engine(machine)


def test_friction_of_a_reaction_that_is_not_unique_is_refused(mechanism_engine):
    """Three parallel links share the load in no unique way: a coefficient has no meaning there."""
    machine = {"bodies": {"bar": _body(0.5, 1.0)}, "joints": {}}
    for name, x in (("left", 0.0), ("middle", 0.5), ("right", 1.0)):
        machine["bodies"][name] = _body(x, 0.5)
        machine["joints"][f"{name}_foot"] = _pin("ground", name, x, 0.0)
        machine["joints"][f"{name}_head"] = _pin(name, "bar", x, 1.0)
    machine["joints"]["left_foot"]["friction"] = {"coefficient": 0.1, "radius_m": 0.01}
    with pytest.raises(SceneError, match=r"left_foot\.friction\.coefficient.*not unique"):
        mechanism_engine(machine)


def test_locked_spring_of_no_length_is_refused(mechanism_engine):
    """A rod needs a length; the error says what to use instead."""
    spring = {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0), "body_b": "bob",
              "point_b_m": (0.0, 0.0), "free_length_m": 1.0, "stiffness_newton_per_m": 1.0,
              "locked": True}  # fmt: skip
    with pytest.raises(SceneError, match=r"forces\.spring\.locked.*revolute"):
        mechanism_engine({"bodies": {"bob": _body(0.0, 0.0)}, "forces": {"spring": spring}})


SPRING = {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0), "body_b": "bob",
          "point_b_m": (0.0, -1.0), "free_length_m": 1.0}  # fmt: skip
TABLE = {"compressions_m": (0.0, 1.0), "forces_newton": (0.0, 5.0)}


@pytest.mark.parametrize(("section", "part", "words"), [
    ("forces", SPRING, "needs one of stiffness_newton_per_m"),
    ("forces", {**SPRING, "stiffness_newton_per_m": 1.0, "table": TABLE}, "needs one of"),
    ("forces", {**SPRING, "table": TABLE, "acts_in": "tension"}, "does not go with a table"),
    ("forces", {**SPRING, "table": {**TABLE, "compressions_m": (1.0, 0.0)}}, "compressions_m must increase"),
    ("forces", {**SPRING, "stiffness_newton_per_m": 1.0, "stops": {"stiffness_newton_per_m": 1.0}},
     "give lower_m, upper_m or both"),
    ("forces", {**SPRING, "stiffness_newton_per_mm": 1.0}, "stiffness_newton_per_mm"),
    ("forces", {**SPRING, "body_b": "bop", "stiffness_newton_per_m": 1.0}, "no body 'bop'"),
    ("joints", _pin("ground", "bob", 0.0, 0.0, friction={"coefficient": 0.1}), "needed together"),
    ("joints", _pin("ground", "bob", 0.0, 0.0, stops={"lower_rad": 1.0, "upper_rad": 0.0,
                                                     "stiffness_newton_m_per_rad": 1.0}), "must be larger"),
    ("joints", {"kind": "point_on_line", "body_a": "ground", "body_b": "bob", "point_m": (0.0, 0.0),
                "axis": (0.0, 0.0)}, "has no direction"),
    ("joints", {"kind": "driver", "body": "bob", "coordinate": "x", "relative_to": "bob",
                "speed": {"kind": "constant", "value": 0.0}}, "is the driven body itself"),
    ("joints", {"kind": "ball", "body_a": "ground", "body_b": "bob"}, "ball"),
    ("bodies", {"mass_kg": 0.0, "inertia_kg_m2": 1.0, "position_m": (0.0, 0.0)}, "greater than 0"),
])  # fmt: skip
def test_bad_part_is_refused(section, part, words):
    """What cannot be is refused by the model, with the reason."""
    machine = {"bodies": {"bob": _body(0.0, -1.0)}, "joints": {}, "forces": {}}
    machine[section]["part"] = part
    with pytest.raises((ValidationError, SubsoilError), match=words):
        Mechanism.model_validate(machine)


@pytest.mark.parametrize("start", [(0.3, 0.0), (0.3, 0.4), (0.0, 0.0)])
def test_a_spring_of_no_free_length(mechanism_engine, start):
    """Force -k (x, z): without gravity x and z swing with sqrt(k / m), each by itself, through the anchor and
    from it."""
    omega, x, z = math.sqrt(100.0 / 4.0), *start
    machine = {
        "bodies": {"ball": _body(x, z, 4.0, velocity_m_per_s=(1.0, -0.5), angular_velocity_rad_per_s=0.0)},
        "forces": {"spring": {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0),
                              "body_b": "ball", "point_b_m": start, "free_length_m": 0.0,
                              "stiffness_newton_per_m": 100.0}},
    }  # fmt: skip
    engine = mechanism_engine(machine, 1_000_000, gravity_m_per_s2=0.0)
    for tick in range(2000):
        engine.advance(tick, ())
    ball = engine.state("run", 1999, 2_000_000_000).bodies[0]
    sine, cosine = math.sin(omega * 2.0), math.cos(omega * 2.0)
    assert ball.x_m == pytest.approx(x * cosine + 1.0 / omega * sine, abs=1e-8)
    assert ball.z_m == pytest.approx(z * cosine - 0.5 / omega * sine, abs=1e-8)
    assert engine.arrays.counters[EVENT_COUNT] == 0  # its law has no kink


@pytest.mark.parametrize("integrator", ["adams_moulton", "runge_kutta_4", "generalized_alpha"])
def test_a_spring_through_its_own_anchor(mechanism_engine, integrator):
    """On a rail through the anchor k (L_0 - |x|) turns about at x = 0: arcs of cosines, mirrored."""
    mass, stiffness, free, start = 4.0, 100.0, 0.3, 0.8
    spring = {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0), "body_b": "ball",
              "point_b_m": (start, 0.0), "stiffness_newton_per_m": stiffness,
              "free_length_m": free}  # fmt: skip
    rail = {"kind": "prismatic", "body_a": "ground", "body_b": "ball", "point_m": (start, 0.0),
            "axis": (1.0, 0.0)}  # fmt: skip
    machine = {"bodies": {"ball": _body(start, 0.0, mass)}, "joints": {"rail": rail},
               "forces": {"spring": spring}, "integrator": integrator}  # fmt: skip
    engine = mechanism_engine(machine, 1_000_000)
    omega, wide = math.sqrt(stiffness / mass), start - free
    across = math.acos(-free / wide) / omega  # from the turning point to the anchor
    first, worst = _energy(engine.state("run", -1, 0)), 0.0
    for tick in range(5000):
        engine.advance(tick, ())
        state = engine.state("run", tick, 0)
        worst = max(worst, abs(_energy(state) - first))
    turns, left = divmod(5.0 + across, 2.0 * across)
    place = (free + wide * math.cos(omega * (left - across))) * (-1.0) ** turns
    bound = 1e-3 if integrator == "generalized_alpha" else 1e-7
    assert state.bodies[0].x_m == pytest.approx(place, abs=bound)
    # the kink is found to the order of the method: an instant wrong by the cube of the step would add 3e-8
    assert worst < (bound if integrator == "generalized_alpha" else 1e-9) * first
    assert engine.arrays.counters[EVENT_COUNT] == 3 * turns  # a step before, there, and a step beyond


@pytest.mark.parametrize("aside", [1e-12, 1e-8, 1e-6, 1e-3])
def test_a_spring_that_all_but_meets_its_anchor(mechanism_engine, aside):
    """Thrown past the anchor at a distance: energy and moment of momentum about it stay."""
    spring = {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 0.0), "body_b": "ball",
              "point_b_m": (0.8, aside), "free_length_m": 0.3, "stiffness_newton_per_m": 100.0}  # fmt: skip
    ball = _body(0.8, aside, 4.0, velocity_m_per_s=(-3.0, 0.0), angular_velocity_rad_per_s=0.0)
    machine = {"bodies": {"ball": ball}, "forces": {"spring": spring}}
    engine = mechanism_engine(machine, 500_000, gravity_m_per_s2=0.0)
    first, worst = _energy(engine.state("run", -1, 0)), 0.0
    for tick in range(1000):
        engine.advance(tick, ())
        state = engine.state("run", tick, 0)
        worst = max(worst, abs(_energy(state) / first - 1.0))
    ball = state.bodies[0]
    moment = ball.x_m * ball.velocity_z_m_per_s - ball.z_m * ball.velocity_x_m_per_s
    assert ball.x_m < -0.2
    assert worst < 1e-5  # some parts of steps, each within 1e-6 of the velocity
    assert moment == pytest.approx(3.0 * aside, abs=1e-6)


def _strained(**more):
    """A mass of 1 kg on 1e9 N/m, 1 mm off its free length."""
    spring = {"kind": "spring_damper", "body_a": "ground", "point_a_m": (0.0, 1.0), "body_b": "mass",
              "point_b_m": (0.0, -0.001), "free_length_m": 1.0, "stiffness_newton_per_m": 1e9}  # fmt: skip
    return {"bodies": {"mass": _body(0.0, -0.001)}, "forces": {"spring": spring}, **more}


def test_a_refused_step_advises_what_its_machine_was_tried_with(mechanism_engine):
    """The tolerance that is advised passes; where no part of a step follows, none is advised."""
    with pytest.raises(SceneError, match=r"at least 124 steps .* or a mechanism\.tolerance of 1e-06"):
        mechanism_engine(_strained(tolerance=None), 500_000)
    _run(mechanism_engine(_strained(), 500_000), 20)
    hopeless = _strained(tolerance=None)
    hopeless["bodies"]["mass"]["mass_kg"] = 1e-9
    with pytest.raises(SceneError, match=r"at least \d+ steps in an interval of 0\.0005 s\.$"):
        mechanism_engine(hopeless, 500_000)


def test_where_newton_fails_what_was_tried_is_advised(mechanism_engine):
    """Two rods strained by 5 MJ: generalized_alpha fails, and names an integrator that passes."""
    spring = {"kind": "spring_damper", "body_a": "ground", "point_a_m": (2.0, 0.0), "body_b": "second",
              "point_b_m": (1.0, 1.0), "stiffness_newton_per_m": 1e9,
              "free_length_m": math.sqrt(2.0) + 0.1}  # fmt: skip
    machine = {
        "bodies": {"first": _body(0.0, 0.5, 1.0, 1.0 / 12.0), "second": _body(0.5, 1.0, 1.0, 1.0 / 12.0)},
        "joints": {"one": _pin("ground", "first", 0.0, 0.0), "two": _pin("first", "second", 0.0, 1.0)},
        "forces": {"spring": spring},
    }
    with pytest.raises(
        PhysicsError, match=r"not converge .* With mechanism\.integrator: adams_moulton and a"
    ):
        _run(mechanism_engine({**machine, "integrator": "generalized_alpha"}, 500_000), 4)
    engine = mechanism_engine(machine, 500_000)
    first = _energy(engine.state("run", -1, 0))
    _run(engine, 4)
    assert _energy(engine.state("run", 3, 2_000_000)) == pytest.approx(first, rel=1e-4)


def test_a_machine_without_joints_that_is_too_stiff_ends_by_name(mechanism_engine):
    """A damper whose rate no part of a step resolves, where there are no joints to name."""
    damper = {"kind": "torsion_spring", "body_a": "ground", "body_b": "rotor", "rest_angle_rad": 0.1,
              "stiffness_newton_m_per_rad": 1e3, "damping_newton_m_s_per_rad": 1e3}  # fmt: skip
    engine = mechanism_engine(
        {"bodies": {"rotor": _body(-0.7, 0.6, 0.1, 1e-4)}, "forces": {"damper": damper}}, 1_000_000
    )
    with pytest.raises(PhysicsError, match=r"error of a step stays above mechanism\.tolerance"):
        _run(engine, 40)
