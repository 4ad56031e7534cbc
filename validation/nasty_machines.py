"""M8 to M13: machines that fixed steps of the usual size compute wrongly, and machines with wrong input."""

import copy
import math
import warnings

import numpy as np
from scipy.special import ellipj, ellipk

from subsoil_ros.errors import PhysicsError
from subsoil_ros.mbd.assembly import MovedBodiesWarning
from subsoil_ros.mbd.equilibrium import UnstableEquilibriumWarning
from subsoil_ros.mbd.machine_arrays import PART_COUNT

from .cases import REFUSED, RIGHT, STOPPED, Cases, Outcome, must, refused, right, right_or_stopped, stopped
from .four_bars import HIGH_PRECISION_JOULE, energy_drift
from .laboratory import GRAVITY, Document, Laboratory
from .machines import SEVEN_BODIES, body, pin, rail
from .mechanism import after, book, stored
from .squeezer import REFERENCE, REFERENCE_RATES, relative, squeezer

CASES = Cases()

USUAL_NS = 500_000
START_RAD = 1.2


def pendulum(**more: object) -> Document:
    """A rod of 2 kg on a pin, 0.5 m from its centre, at rest at START_RAD."""
    centre = (0.5 * math.sin(START_RAD), -0.5 * math.cos(START_RAD))
    return {
        "bodies": {"rod": body(*centre, 2.0, 0.06, angle_rad=START_RAD)},
        "joints": {"pin": pin("ground", "rod", 0.0, 0.0)}, **more,
    }  # fmt: skip


@CASES.add("M8a", RIGHT)
def a_step_as_long_as_the_swing(laboratory: Laboratory) -> Outcome:
    """Pendulum at steps of 0.5 s, with a tolerance as scenes have it."""
    engine = laboratory.machine(pendulum(), 500_000_000)
    state = after(engine, 20, 500_000_000)
    frequency, k = math.sqrt(2.0 * GRAVITY * 0.5 / (0.06 + 0.5)), math.sin(0.5 * START_RAD)
    angle = 2.0 * math.asin(k * ellipj(ellipk(k * k) + frequency * 10.0, k * k)[0])
    off = abs(state.bodies[0].angle_rad - angle)
    must(off < 4e-5, f"off by {off} rad")
    return right(f"off by {off:.1g} rad after 10 s, {int(engine.arrays.counters[PART_COUNT])} parts of steps")


@CASES.add("M8b", STOPPED)
def fixed_steps_too_long(laboratory: Laboratory) -> Outcome:
    """The same at fixed steps."""
    engine = laboratory.machine(pendulum(tolerance=None), 500_000_000)
    return stopped(lambda: after(engine, 20, 500_000_000), "balance of energy is open by")


@CASES.add("M8c", RIGHT)
def fast_squeezer(laboratory: Laboratory) -> Outcome:
    """Andrews' squeezer at the usual step."""
    engine = laboratory.machine(squeezer(), USUAL_NS, gravity=0.0)
    state = after(engine, 60, USUAL_NS)
    angles = relative([part.angle_rad for part in state.bodies])
    rates = relative([part.angular_velocity_rad_per_s for part in state.bodies])
    off = float(np.abs(angles / REFERENCE - 1.0).max())
    slow = float(np.abs(rates - REFERENCE_RATES).max() / np.abs(REFERENCE_RATES).max())
    must(max(off, slow) < 1e-6, f"angles off by {off}, speeds by {slow}")
    return right(f"angles off by {off:.1g}, speeds by {slow:.1g}")


@CASES.add("M8d", RIGHT, STOPPED)
def a_force_beyond_bounds(laboratory: Laboratory) -> Outcome:
    """1e12 N on the pendulum at the usual step."""
    tip = [0.5 * math.sin(START_RAD), -0.5 * math.cos(START_RAD)]
    pull = {
        "kind": "point_load", "body": "rod", "point_m": tip,
        "force_x_newton": {"kind": "constant", "value": 1e12},
    }  # fmt: skip
    engine, largest = laboratory.machine(pendulum(forces={"pull": pull}), USUAL_NS), 0.5e12

    def follow() -> str:
        worst = 0.0
        first = book(engine.state("", -1, 0))
        for tick in range(20):
            worst = max(worst, abs(book(after(engine, 1, USUAL_NS, tick)) - first))
        must(worst < 1e-3 * largest, f"energy off by {worst} J")
        return f"energy off by {worst / largest:.1g} of it"

    return right_or_stopped(follow, "mechanism.tolerance|balance of energy")


@CASES.add("M9a", RIGHT)
def hopping_wheels(laboratory: Laboratory) -> Outcome:
    """The paper's machine dropped by 80 mm, friction 0.5, slip 0.02 m/s, usual step."""
    machine = copy.deepcopy(SEVEN_BODIES)
    machine["initial"] = {"coordinates": {"frame.z_m": 0.60}}
    for name in ("left", "right"):
        machine["forces"][name]["friction"] = 0.5
    drafts = []
    for steps, more in ((1, {}), (50, {"tolerance": None})):
        engine = laboratory.machine({**machine, **more}, USUAL_NS, coupling={"mechanism_steps": steps})
        drafts.append([after(engine, 1, USUAL_NS, tick).draft_newton for tick in range(800)])
    found, exact = np.array(drafts)
    off = float(np.abs(found - exact).max() / np.abs(exact).max())
    must(off < 2e-3, f"draft off by {off} of the largest")
    return right(f"draft off by {off:.1g} of the largest, {np.abs(exact).max():.0f} N")


def pressed(**friction: object) -> Document:
    """A block on a level rail at 0.5 m/s, pulled by 10 N, pressed on it by 5 kN after 0.1 s."""
    table = {"kind": "table", "times_s": [0.0, 0.1, 0.12], "values": [0.0, 0.0, -5000.0]}
    press = {
        "kind": "point_load", "body": "block", "point_m": [0.0, 0.0], "force_z_newton": table,
        "force_x_newton": {"kind": "constant", "value": 10.0},
    }  # fmt: skip
    guide = {**rail("block", 0.0, 0.0), "friction": {"coefficient": 0.5, **friction}}
    block = body(0.0, 0.0, 2.0, 0.3, velocity_m_per_s=[0.5, 0.0])
    return {"bodies": {"block": block}, "joints": {"rail": guide}, "forces": {"press": press}}


@CASES.add("M9b", RIGHT)
def rail_pressed_later(laboratory: Laboratory) -> Outcome:
    """Rail pressed by 5 kN after 0.1 s, slip 1 mm/s, usual step."""
    engine = laboratory.machine(pressed(slip_speed_m_per_s=1e-3), USUAL_NS)
    speed = after(engine, 400, USUAL_NS).bodies[0].velocity_x_m_per_s
    creep = 1e-3 * math.atanh(10.0 / (0.5 * (5000.0 + 2.0 * GRAVITY)))
    must(abs(speed / creep - 1.0) < 1e-3, f"creeps at {speed} m/s, {creep} expected")
    return right(f"creeps at {1e6 * speed:.4f} um/s ({1e6 * creep:.4f})")


@CASES.add("M9c", RIGHT)
def rail_that_sticks(laboratory: Laboratory) -> Outcome:
    """The same with a stick stiffness of 2e6 N/m: it stops."""
    sticks = {"stick_stiffness_newton_per_m": 2e6, "stick_damping_newton_s_per_m": 4e3}
    engine = laboratory.machine(pressed(**sticks), USUAL_NS)
    stood = after(engine, 800, USUAL_NS).bodies[0].x_m
    state = after(engine, 4000, USUAL_NS, 800)
    crept = abs(state.bodies[0].x_m - stood)
    must(crept < 1e-12, f"creeps by {crept} m")
    return right(f"crept by {crept:.1g} m in 2 s")


@CASES.add("M10a", RIGHT)
def spring_through_its_anchor(laboratory: Laboratory) -> Outcome:
    """Block on a rail, its spring passing through its own anchor."""
    stiffness, mass, free, start = 100.0, 4.0, 0.3, 0.8
    spring = {
        "kind": "spring_damper", "body_a": "ground", "point_a_m": [0.0, 0.0], "body_b": "block",
        "point_b_m": [start, 0.0], "stiffness_newton_per_m": stiffness, "free_length_m": free,
    }  # fmt: skip
    machine = {
        "bodies": {"block": body(start, 0.0, mass)}, "joints": {"rail": rail("block", start, 0.0)},
        "forces": {"spring": spring},
    }  # fmt: skip
    engine, omega, wide = laboratory.machine(machine, USUAL_NS), math.sqrt(stiffness / mass), start - free
    first = stored(engine.state("", -1, 0))
    state = after(engine, 12_000, USUAL_NS)
    across = math.acos(-free / wide) / omega
    turns, left = divmod(6.0 + across, 2.0 * across)
    place = (free + wide * math.cos(omega * (left - across))) * (-1.0) ** turns
    off, gap = abs(state.bodies[0].x_m - place), abs(stored(state) / first - 1.0)
    must(off < 1e-7 and gap < 1e-8, f"off by {off} m, energy by {gap}")
    return right(f"{turns:.0f} times through it: off by {off:.1g} m, energy by {gap:.1g}")


@CASES.add("M10b", REFUSED)
def spring_of_no_direction(laboratory: Laboratory) -> Outcome:
    """A spring with a free length, its ends in one place at the start."""
    spring = {
        "kind": "spring_damper", "body_a": "ground", "point_a_m": [0.0, 0.0], "body_b": "block",
        "point_b_m": [0.0, 0.0], "stiffness_newton_per_m": 100.0, "free_length_m": 0.3,
    }  # fmt: skip
    machine = {"bodies": {"block": body(0.0, 0.0)}, "forces": {"spring": spring}}
    return refused(lambda: laboratory.machine(machine, USUAL_NS), "forces.spring: its two points coincide")


@CASES.add("M11", RIGHT)
def four_bars(laboratory: Laboratory) -> Outcome:
    """Forty four-bars that fold flat together, 10 s at the usual step, both explicit methods."""
    found = []
    for integrator in ("adams_moulton", "runge_kutta_4"):
        drift = energy_drift(laboratory, 40, USUAL_NS, integrator=integrator)
        must(drift < HIGH_PRECISION_JOULE, f"{integrator}: energy off by {drift} J")
        found.append(f"{integrator}: energy off by {drift:.1g} J")
    return right("; ".join(found))


def strained(mass: float, **more: object) -> Document:
    """Two rods of this mass on pins, the end of the second on a spring of 1e9 N/m, 0.1 m too long."""
    spring = {
        "kind": "spring_damper", "body_a": "ground", "point_a_m": [2.0, 0.0], "body_b": "second",
        "point_b_m": [1.0, 1.0], "stiffness_newton_per_m": 1e9, "free_length_m": math.sqrt(2.0) + 0.1,
    }  # fmt: skip
    bodies = {
        name: body(x, z, mass, mass / 12.0) for name, x, z in (("first", 0.0, 0.5), ("second", 0.5, 1.0))
    }
    joints = {"one": pin("ground", "first", 0.0, 0.0), "two": pin("first", "second", 0.0, 1.0)}
    return {"bodies": bodies, "joints": joints, "forces": {"spring": spring}, **more}


@CASES.add("M12", RIGHT, STOPPED)
def stiff_linkages(laboratory: Laboratory) -> Outcome:
    """Linkage strained by 5 MJ at 1e9 N/m, rods of 1 kg and of 1e-9 kg, usual step, every integrator."""
    found = []
    for mass in (1.0, 1e-9):
        for integrator in ("adams_moulton", "runge_kutta_4", "generalized_alpha"):
            engine = laboratory.machine(strained(mass, integrator=integrator), USUAL_NS)
            try:
                energy = stored(after(engine, 4, USUAL_NS)) / 5e6
            except PhysicsError:
                found.append(f"{mass:g} kg, {integrator}: stopped")
                continue
            lost = integrator == "generalized_alpha"
            must(
                energy < 1.01 and (lost or energy > 0.99), f"{mass} kg, {integrator}: {energy} of the energy"
            )
            found.append(f"{mass:g} kg, {integrator}: {energy:.6f} of the energy")
    return right("; ".join(found))


def loop(gap_m: float, **more: object) -> Document:
    """A square of four bars, its last pin open by `gap_m`."""
    bodies = {"left": body(0.0, 0.5), "top": body(0.5, 1.0), "right": body(1.0, 0.5, **more)}
    joints = {
        "a": pin("ground", "left", 0.0, 0.0), "b": pin("left", "top", 0.0, 1.0),
        "c": pin("top", "right", 1.0, 1.0),
        "d": {**pin("ground", "right", 1.0, 0.0), "point_b_m": [1.0 + gap_m, 0.0]},
    }  # fmt: skip
    return {"bodies": bodies, "joints": joints}


def warned(laboratory: Laboratory, machine: Document, kind: type[Warning], words: str) -> None:
    """WrongEndError unless the machine starts with such a warning."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        laboratory.machine(machine, USUAL_NS)
    told = [str(item.message) for item in caught if issubclass(item.category, kind)]
    must(any(words in text for text in told), f"no warning '{words}', but {told}")


@CASES.add("M13a", RIGHT)
def what_start_is_changed(laboratory: Laboratory) -> Outcome:
    """A loop open by 1 mm; start velocities that joints forbid; a pendulum that stands upright."""
    warned(laboratory, loop(1e-3), MovedBodiesWarning, "d are 1 mm apart")
    fast = loop(0.0, velocity_m_per_s=[0.0, 1.0])
    warned(laboratory, fast, MovedBodiesWarning, "which joints and drivers do not allow")
    upright = {
        "bodies": {"rod": body(0.0, 0.5, 2.0, 0.06)}, "joints": {"pin": pin("ground", "rod", 0.0, 0.0)},
        "initial": {"static_equilibrium": True},
    }  # fmt: skip
    warned(laboratory, upright, UnstableEquilibriumWarning, "unstable equilibrium: body 'rod'")
    return right("each starts with a warning that names the joint or body")


@CASES.add("M13b", REFUSED)
def a_loop_that_is_open(laboratory: Laboratory) -> Outcome:
    """A loop open by 200 mm."""
    return refused(
        lambda: laboratory.machine(loop(0.2), USUAL_NS), "joints.d: its two points are 0.2 m apart"
    )


@CASES.add("M13c", REFUSED)
def one_name_for_two(laboratory: Laboratory) -> Outcome:
    """A force named as the friction of a joint."""
    machine = pressed()
    machine["forces"]["rail.friction"] = machine["forces"].pop("press")
    return refused(lambda: laboratory.machine(machine, USUAL_NS), "forces.rail.friction: is the name")
