"""Random machines without soil: trees and closed chains of bodies, with springs, dampers, drivers and loads.

Each moves for TICKS, or is refused with one message. Energy must be accounted for and joints stay closed; the
machine in another order, moved along, and turned (its weight as loads) must move alike. Every second machine
is smooth, without kinks, drivers and what is bound to the world's axes: it can be turned.
"""

import math
import random
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np
from hypothesis import strategies as st

from dev.fuzz import outcome
from subsoil_ros import load_scene
from subsoil_ros.errors import PhysicsError, SceneError, SingularMechanismError
from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.messages import MechanismState
from subsoil_ros.scene.scene import Scene

TICKS, TICK_NS = 40, 1_000_000
GRAVITY = 9.81
TOLERANCE = 1e-8
"""Of a step, finer than by default: fast modes add up the errors of many steps."""
SAME = 1e-4
"""Part of the largest way or speed by which equivalent machines may differ."""
SENSITIVE = 10.0
"""Times by which they may differ more than the motion does at ten times the tolerance."""
UNACCOUNTED = 1e-3
"""Part of the work and energy turned over by which the balance may be open; the engine allows 1 %."""
CLOSED_M = 1e-8
LEAST_GAIN = 4.0
"""By which the error of energy must shrink where fixed steps of order 4 are halved (16 in theory). It may
change its sign at one length of the step, so the last of three is judged by the larger of the others."""
RESOLVED = 1e-5
"""Part of the stored energy above which steps are too long for a motion to show their order."""

Machine = dict[str, Any]
Law = dict[str, Any]

tenths = st.integers(-10, 10).map(lambda k: k / 10.0)
points = st.tuples(tenths, tenths)
sizes = st.sampled_from([0.01, 0.1, 1.0, 10.0, 100.0])
axes = st.sampled_from([(1.0, 0.0), (0.0, 1.0), (3.0, 4.0), (-1.0, 2.0)])


@st.composite
def laws(draw: st.DrawFn) -> Law:
    """A constant or a sine."""
    if draw(st.booleans()):
        return {"kind": "constant", "value": draw(tenths)}
    return {"kind": "sine", "amplitude": draw(tenths), "frequency_hz": draw(st.integers(1, 20)) / 2.0}


def _maybe(draw: st.DrawFn, part: dict[str, Any]) -> dict[str, Any]:
    return part if draw(st.integers(0, 3)) == 0 else {}


def _joint(draw: st.DrawFn, kind: str, pair: tuple[str, str], *, smooth: bool) -> dict[str, Any]:
    """A joint of the kind between two bodies."""
    joint = {"kind": kind, "body_a": pair[0], "body_b": pair[1], "point_m": draw(points)}
    if kind in ("prismatic", "point_on_line"):
        joint["axis"] = draw(axes)
    if smooth or kind == "fixed":
        return joint
    about = kind == "revolute"
    unit, per, rate = ("rad", "newton_m_per_rad", "newton_m_s_per_rad") if about else (
        "m", "newton_per_m", "newton_s_per_m"
    )  # fmt: skip
    stops = {f"upper_{unit}": 0.05, f"lower_{unit}": -0.02, f"stiffness_{per}": 1e3, f"damping_{rate}": 5.0}
    stick = _maybe(draw, {f"stick_stiffness_{per}": 1e3, f"stick_damping_{rate}": 1.0})
    friction = {"preload_newton_m" if about else "preload_newton": draw(sizes) / 10.0, **stick}
    return joint | _maybe(draw, {"stops": stops}) | _maybe(draw, {"friction": friction})


def _force(draw: st.DrawFn, bodies: list[str], *, smooth: bool) -> dict[str, Any]:
    """A force element on one or two of the bodies."""
    kinds = ["spring_damper", "torsion_spring", "point_load"]
    kind = draw(st.sampled_from(kinds if smooth else [*kinds, "coordinate_spring", "wheel_contact"]))
    body = draw(st.sampled_from(bodies))
    others = [other for other in ("ground", *bodies) if other != body]
    pair = {"body_a": draw(st.sampled_from(others)), "body_b": body}
    stiffness, damping = draw(sizes) * 100.0, draw(st.sampled_from([0.0, 1.0, 20.0]))
    if kind == "spring_damper":
        one_way = (
            {} if smooth else _maybe(draw, {"acts_in": draw(st.sampled_from(["tension", "compression"]))})
        )
        return {
            "kind": kind, **pair, "point_a_m": draw(points), "point_b_m": draw(points),
            "stiffness_newton_per_m": stiffness, "damping_newton_s_per_m": damping,
            "free_length_m": draw(st.integers(0, 10)) / 10.0, "locked": draw(st.integers(0, 9)) == 0,
            **one_way,
        }  # fmt: skip
    if kind == "torsion_spring":
        return {
            "kind": kind, **pair,
            "stiffness_newton_m_per_rad": stiffness, "damping_newton_m_s_per_rad": damping,
            "rest_angle_rad": draw(tenths), "locked": draw(st.integers(0, 9)) == 0,
        }  # fmt: skip
    if kind == "coordinate_spring":
        return {
            "kind": kind, "body": body, "coordinate": "z", "target": draw(laws()),
            "stiffness_newton_per_m": stiffness, "damping_newton_s_per_m": damping,
            "acts_in": draw(st.sampled_from(["both", "pull_up", "push_down"])),
        }  # fmt: skip
    if kind == "wheel_contact":
        return {
            "kind": kind, "body": body, "radius_m": 0.3, "ground_z_m": draw(tenths), "friction": 0.5,
            "stiffness_newton_per_m": stiffness, "damping_newton_s_per_m": damping,
        }  # fmt: skip
    return {
        "kind": kind, "body": body, "point_m": draw(points), "force_x_newton": draw(laws()),
        "force_z_newton": draw(laws()), "moment_newton_m": draw(laws()),
    }  # fmt: skip


class Case(NamedTuple):
    """A machine, and by what its equivalents differ from it."""

    machine: Machine
    smooth: bool
    shift_m: float
    angle_rad: float
    seed: int


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Random machines of one to five bodies."""
    smooth = draw(st.booleans())
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    kinds = st.sampled_from(["revolute", "revolute", "revolute", "prismatic", "point_on_line", "fixed"])
    for k in range(draw(st.integers(1, 5))):
        mass = draw(sizes)
        name, parent = f"body{k}", draw(st.sampled_from(["ground", *bodies]))
        bodies[name] = {
            "mass_kg": mass, "inertia_kg_m2": mass * draw(st.sampled_from([1e-3, 0.02, 0.3])),
            "position_m": draw(points),
            **_maybe(draw, {"velocity_m_per_s": draw(points), "angular_velocity_rad_per_s": draw(tenths)}),
        }  # fmt: skip
        if draw(st.integers(0, 9)):  # else it is free
            joints[f"joint{k}"] = _joint(draw, draw(kinds), (parent, name), smooth=smooth)
    names = list(bodies)
    if draw(st.integers(0, 2)) == 0 and len(names) > 1:  # closes a chain
        pair = (draw(st.sampled_from(["ground", *names[:-1]])), names[-1])
        joints["closing"] = _joint(draw, draw(kinds), pair, smooth=smooth)
    if not smooth and draw(st.booleans()):
        joints["driver"] = {
            "kind": "driver", "body": draw(st.sampled_from(names)), "speed": draw(laws()),
            "coordinate": draw(st.sampled_from(["x", "z", "angle"])),
        } | _maybe(draw, {"relative_to": "ground"})  # fmt: skip
    forces = {f"force{k}": _force(draw, names, smooth=smooth) for k in range(draw(st.integers(0, 4)))}
    integrator = draw(st.sampled_from(["adams_moulton", "adams_moulton", "runge_kutta_4"]))
    machine = {
        "bodies": bodies,
        "joints": joints,
        "forces": forces,
        "integrator": integrator,
        "tolerance": TOLERANCE,
    }
    turn = draw(st.integers(1, 12)) / 2.0
    return Case(machine, smooth, draw(tenths), turn, draw(st.integers(0, 999)))


def reordered(machine: Machine, seed: int) -> Machine:
    """The machine with bodies, joints and forces in another order of the file."""
    chance, other = random.Random(seed), dict(machine)
    for section in ("bodies", "joints", "forces"):
        items = list(machine[section].items())
        chance.shuffle(items)
        other[section] = dict(items)
    return other


def carried(machine: Machine, angle_rad: float, shift_m: float) -> Machine:
    """The machine turned about the origin, then moved along x."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)

    def turned(way: tuple[float, float]) -> tuple[float, float]:
        return cosine * way[0] - sine * way[1], sine * way[0] + cosine * way[1]

    def placed(part: dict[str, Any]) -> dict[str, Any]:
        other = {**part}
        for key in {"position_m", "point_m", "point_a_m", "point_b_m"} & part.keys():
            x, z = turned(part[key])
            other[key] = x + shift_m, z
        for key in {"velocity_m_per_s", "axis"} & part.keys():
            other[key] = turned(part[key])
        if "mass_kg" in part:
            other["angle_rad"] = part.get("angle_rad", 0.0) + angle_rad
        if part.get("kind") == "point_load" and angle_rad:
            x, z = part["force_x_newton"], part["force_z_newton"]
            other["force_x_newton"] = _sum((x, cosine), (z, -sine))
            other["force_z_newton"] = _sum((x, sine), (z, cosine))
        return other

    sections = ("bodies", "joints", "forces")
    return machine | {s: {name: placed(part) for name, part in machine[s].items()} for s in sections}


def _sum(*terms: tuple[Law, float]) -> Law:
    """Laws times factors, added up."""
    scaled = [
        {key: value * factor if key in ("value", "amplitude") else value for key, value in law.items()}
        for law, factor in terms
    ]
    return {"kind": "sum", "terms": scaled}


def weighed(machine: Machine) -> Machine:
    """The machine with its weight as loads."""
    other = deepcopy(machine)
    for name, body in machine["bodies"].items():
        zero = {"kind": "constant", "value": 0.0}
        weight = {"kind": "constant", "value": -GRAVITY * body["mass_kg"]}
        other["forces"][f"weight_{name}"] = {
            "kind": "point_load", "body": name, "point_m": body["position_m"], "force_x_newton": zero,
            "force_z_newton": weight,
        }  # fmt: skip
    return other


class Run(NamedTuple):
    """How a machine moved: how it ended before its end, or "" and its last state."""

    fault: str
    state: MechanismState | None

    @property
    def motion(self) -> np.ndarray:
        """(bodies, 6), x, z, angle and their rates, bodies by name."""
        rows = sorted(self.state.bodies, key=lambda body: body.name)
        return np.array([
            (b.x_m, b.z_m, b.angle_rad, b.velocity_x_m_per_s, b.velocity_z_m_per_s,
             b.angular_velocity_rad_per_s)
            for b in rows
        ])  # fmt: skip


def moved(machine: Machine, gravity: float = GRAVITY, steps: int = 1) -> Run:
    """Advance a machine. Raises InputError where it is refused."""
    document = {"name": "machine", "duration_s": 1.0, "gravity_m_per_s2": gravity, "mechanism": machine}
    timing = Timing(TICK_NS, tick_count=TICKS, soil_steps=0, mechanism_steps=steps)
    try:
        engine = MechanismEngine(Scene.model_validate(document), timing)
        for tick in range(TICKS):
            engine.advance(tick, ())
    except (PhysicsError, SingularMechanismError) as error:
        if not str(error).strip():
            raise AssertionError("ended without a message") from error
        return Run(type(error).__name__, None)
    return Run("", engine.state("", TICKS - 1, TICKS * TICK_NS))


def judge(case: Case) -> str:
    """Raise AssertionError unless the machine keeps what a machine must."""
    found: list[Run] = []
    document = {"name": "machine", "duration_s": 1.0, "mechanism": case.machine}
    if outcome(lambda: load_scene(document)) == "refused":
        return "refused"
    result = outcome(lambda: found.append(moved(case.machine)))
    other = outcome(lambda: found.append(moved(reordered(case.machine, case.seed))))
    assert result == other, "in another order it is refused, or no longer"
    if result == "refused":
        return result
    run, again = found
    assert run.fault == again.fault, f"in another order it ends otherwise: {run.fault}, {again.fault}"
    if run.fault:
        return run.fault
    _check_state(run)
    _compare(run.motion, again, "in another order", case)
    if case.smooth:
        base, turned = weighed(case.machine), carried(weighed(case.machine), case.angle_rad, case.shift_m)
        _compare(run.motion, moved(base, 0.0), "with its weight as loads", case)
        _compare(_carried_motion(run.motion, case), moved(turned, 0.0), "turned", case)
        _check_order(case.machine)
    return "smooth" if case.smooth else "with kinks"


def _carried_motion(motion: np.ndarray, case: Case) -> np.ndarray:
    cosine, sine = math.cos(case.angle_rad), math.sin(case.angle_rad)
    turn = np.array([(cosine, -sine), (sine, cosine)])
    other = motion.copy()
    other[:, :2], other[:, 3:5] = motion[:, :2] @ turn.T + (case.shift_m, 0.0), motion[:, 3:5] @ turn.T
    other[:, 2] += case.angle_rad
    return other


def _check_state(run: Run) -> None:
    state = run.state
    assert np.isfinite(run.motion).all(), "its motion is no number"
    assert state.position_residual_m < CLOSED_M, f"a joint is open by {state.position_residual_m:.3g} m"
    turned = state.kinetic_energy_joule + abs(state.dissipated_joule) + abs(state.driver_work_joule) + abs(
        state.external_work_joule
    )  # fmt: skip
    part = abs(state.energy_residual_joule) / max(turned, 1e-6)
    assert part < UNACCOUNTED, f"energy is open by {part:.3g} of what is turned over"


def _compare(motion: np.ndarray, other: Run, how: str, case: Case) -> None:
    assert not other.fault, f"{how} it ends otherwise: {other.fault}"
    off = _difference(motion, other.motion)
    assert off < SAME or off < SENSITIVE * _sensitivity(case.machine), (
        f"{how} it moves otherwise, by {off:.3g} of its largest value"
    )


def _difference(motion: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(motion - other).max() / max(1.0, np.abs(motion).max()))


def _sensitivity(machine: Machine) -> float:
    """By how much the motion changes with the tolerance: much where it is chaotic."""
    coarser = moved(machine | {"tolerance": 10.0 * TOLERANCE})
    return _difference(moved(machine).motion, coarser.motion) if not coarser.fault else math.inf


def _check_order(machine: Machine) -> None:
    """The error of energy of fixed steps, where they are short enough, must shrink with them down to what
    round-off leaves."""
    fixed = machine | {"tolerance": None, "integrator": "runge_kutta_4"}
    errors = []
    for steps in (4, 8, 16):
        try:
            state = moved(fixed, steps=steps).state
        except SceneError:  # too long steps for the stiffest spring
            return
        if state is None:
            return
        stored = state.kinetic_energy_joule + abs(state.spring_energy_joule) + abs(state.gravity_energy_joule)
        errors.append(abs(state.energy_residual_joule) / max(stored, 1e-3))
    coarse = max(errors[:2])
    assert coarse > RESOLVED or errors[2] < max(coarse / LEAST_GAIN, 1e-9), (
        f"halved steps change the error of energy to {errors}"
    )
