"""M1 to M7: machines at the ends of geometry, stiffness, mass and time."""

import copy
import math
import re

import numpy as np
from scipy.optimize import brentq

from subsoil_ros.errors import PhysicsError, SceneError
from subsoil_ros.mbd.machine_arrays import PART_COUNT
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.messages import DriverCommand, MechanismState

from .cases import REFUSED, RIGHT, STOPPED, Cases, Outcome, must, refused, right, stopped
from .laboratory import GRAVITY, Document, Laboratory
from .machines import SEVEN_BODIES, body, motor, pin, rail

CASES = Cases()


def after(engine: MechanismEngine, ticks: int, communication_step_ns: int, first: int = 0) -> MechanismState:
    """The state `ticks` ticks later."""
    for tick in range(first, first + ticks):
        engine.advance(tick, ())
    return engine.state("", first + ticks - 1, (first + ticks) * communication_step_ns)


def stored(state: MechanismState) -> float:
    """Kinetic, gravity and spring energy [J]."""
    return state.kinetic_energy_joule + state.gravity_energy_joule + state.spring_energy_joule


def book(state: MechanismState) -> float:
    """What stays constant [J]."""
    return stored(state) + state.dissipated_joule - state.driver_work_joule - state.external_work_joule


@CASES.add("M1a", RIGHT)
def dead_centres(laboratory: Laboratory) -> Outcome:
    """Crank driven through both dead centres of its slider."""
    machine = {
        "bodies": {"crank": body(0.0, 0.5), "rod": body(0.6, 0.5), "slider": body(1.2, 0.0)},
        "joints": {
            "main": pin("ground", "crank", 0.0, 0.0), "big": pin("crank", "rod", 0.0, 1.0),
            "small": pin("rod", "slider", 1.2, 0.0), "rail": rail("slider", 1.2, 0.0),
            "motor": motor("crank", 5.0),
        },
    }  # fmt: skip
    engine, rod, worst = laboratory.machine(machine, 1_000_000), math.hypot(1.2, 1.0), 0.0
    for k in range(26):
        state = after(engine, 50, 1_000_000, 50 * k)
        angle = 0.5 * math.pi + 5e-3 * 50 * (k + 1)
        place = math.cos(angle) + math.sqrt(rod**2 - math.sin(angle) ** 2)
        worst = max(worst, abs(state.bodies[2].x_m - place))
    must(worst < 1e-10, f"off by {worst} m")
    return right(f"off by {worst:.1g} m at most")


@CASES.add("M1b", RIGHT)
def nearly_flat(laboratory: Laboratory) -> Outcome:
    """Four-bar that misses folding flat by 1e-6, driven past it."""
    short, coupler, rocker, base = 0.5, 1.0, 0.5 + 1e-6, 1.0
    start, speed, communication_step_ns = -0.02, 5.0, 5000

    def end_of(angle: float) -> tuple[float, float]:
        """Joint of coupler and rocker, on the branch that turns the same way throughout."""
        ax, az = short * math.cos(angle), short * math.sin(angle)
        dx, dz = base - ax, -az
        far = math.hypot(dx, dz)
        along = (coupler**2 - rocker**2 + far**2) / (2.0 * far)
        across = math.sqrt(coupler**2 - along**2)
        return ax + (along * dx - across * dz) / far, az + (along * dz + across * dx) / far

    ax, az = short * math.cos(start), short * math.sin(start)
    bx, bz = end_of(start)
    machine = {
        "bodies": {
            "crank": body(0.5 * ax, 0.5 * az), "coupler": body(0.5 * (ax + bx), 0.5 * (az + bz)),
            "rocker": body(bx, bz),
        },
        "joints": {
            "a": pin("ground", "crank", 0.0, 0.0), "b": pin("crank", "coupler", ax, az),
            "c": pin("coupler", "rocker", bx, bz), "d": pin("ground", "rocker", base, 0.0),
            "motor": motor("crank", speed),
        },
    }  # fmt: skip
    engine, worst = laboratory.machine(machine, communication_step_ns, gravity=0.0), 0.0
    for k in range(160):
        state = after(engine, 10, communication_step_ns, 10 * k)
        x, z = end_of(start + speed * communication_step_ns * 1e-9 * 10 * (k + 1))
        worst = max(worst, math.hypot(state.bodies[2].x_m - x, state.bodies[2].z_m - z))
    must(worst < 1e-8, f"off by {worst} m")
    return right(f"off by {worst:.1g} m at most")


@CASES.add("M1c", STOPPED)
def singular(laboratory: Laboratory) -> Outcome:
    """Parallelogram coming to rest flat; knee stretched beyond its length."""
    fold = {
        "kind": "torsion_spring", "body_a": "ground", "body_b": "left", "stiffness_newton_m_per_rad": 400.0,
        "damping_newton_m_s_per_rad": 60.0, "rest_angle_rad": -0.5 * math.pi,
    }  # fmt: skip
    flat = {
        "bodies": {"left": body(0.0, 0.5), "right": body(1.0, 0.5), "bar": body(0.5, 1.0)},
        "joints": {
            "a": pin("ground", "left", 0.0, 0.0), "b": pin("left", "bar", 0.0, 1.0),
            "c": pin("bar", "right", 1.0, 1.0), "d": pin("ground", "right", 1.0, 0.0),
        },
        "forces": {"fold": fold},
    }  # fmt: skip
    knee = {
        "bodies": {"upper": body(0.3, 0.4), "lower": body(0.9, 0.4), "foot": body(1.2, 0.0)},
        "joints": {
            "hip": pin("ground", "upper", 0.0, 0.0), "knee": pin("upper", "lower", 0.6, 0.8),
            "ankle": pin("lower", "foot", 1.2, 0.0), "rail": rail("foot", 1.2, 0.0),
            "pull": {
                "kind": "driver", "body": "foot", "coordinate": "x",
                "speed": {"kind": "constant", "value": 1.0},
            },
        },
    }  # fmt: skip
    engines = [laboratory.machine(flat, 1_000_000, gravity=0.0), laboratory.machine(knee, 1_000_000)]
    found = [
        stopped(lambda engine=engine: after(engine, 5000, 1_000_000), "joints .*(singular|closed)").found
        for engine in engines
    ]
    must(all(np.isfinite(engine.arrays.q).all() for engine in engines), "coordinates that are no numbers")
    return Outcome(STOPPED, "; ".join(text.split(".")[0] + "." + text.split(".")[1][:60] for text in found))


def stiff(mass: float = 1.0, stiffness: float = 1e9, **more: object) -> Document:
    """A mass on a vertical rail and a spring of this stiffness, 1 mm off its free length."""
    spring = {
        "kind": "spring_damper", "body_a": "ground", "point_a_m": [0.0, 1.0], "body_b": "mass",
        "point_b_m": [0.0, -0.001], "free_length_m": 1.0, "stiffness_newton_per_m": stiffness,
    }  # fmt: skip
    return {
        "bodies": {"mass": body(0.0, -0.001, mass)},
        "joints": {"rail": rail("mass", 0.0, -0.001, (0.0, 1.0))},
        "forces": {"spring": spring}, **more,
    }  # fmt: skip


@CASES.add("M2a", REFUSED)
def stiff_spring_at_a_coarse_step(laboratory: Laboratory) -> Outcome:
    """1 kg on 1e9 N/m at fixed steps of 0.5 ms."""
    return refused(
        lambda: laboratory.machine(stiff(tolerance=None), 500_000),
        "above the stability bound .* at least .* steps",
    )


@CASES.add("M2b", RIGHT)
def stiff_spring_at_the_bound(laboratory: Laboratory) -> Outcome:
    """1 kg on 1e9 N/m with the steps that the refusal names, 1e5 of them, both explicit methods.

    Adams-Moulton keeps the energy of the swing. Runge-Kutta does not at so few steps a period: stable, but
    the swing is no result, and the balance of energy stops it.
    """
    found = []
    for integrator in ("adams_moulton", "runge_kutta_4"):
        machine = stiff(integrator=integrator, tolerance=None)
        try:
            laboratory.machine(machine, 500_000)
            steps = 0
        except SceneError as error:
            steps = int(re.findall(r"at least (\d+) steps", str(error))[0])
        engine = laboratory.machine(machine, 500_000, gravity=0.0, coupling={"mechanism_steps": steps})
        before = stored(engine.state("", -1, 0))
        try:
            energy = stored(after(engine, 100_000 // steps, 500_000))
        except PhysicsError as error:
            must("balance of energy" in str(error), str(error))
            found.append(f"{integrator}: {steps} steps a tick, stopped by the balance of energy")
            continue
        must(energy <= 1.0101 * before, f"{integrator}, {steps} steps: energy grew {energy / before} times")
        period = 2.0 * math.pi * math.sqrt(1e-9) * steps / 0.5e-3  # in steps
        must(energy >= 0.99 * before, f"{integrator}, {steps} steps: {energy / before} of the energy")
        found.append(
            f"{integrator}: {steps} steps a tick, {period:.3g} a period, "
            f"energy {energy / before:.3g} of the first"
        )
    return right("; ".join(found))


@CASES.add("M2d", RIGHT)
def stiff_spring_with_a_tolerance(laboratory: Laboratory) -> Outcome:
    """1 kg on 1e9 N/m at a step of 0.5 ms, as scenes are by default: swings as the closed form."""
    engine = laboratory.machine(stiff(), 500_000, gravity=0.0)
    state = after(engine, 20, 500_000)
    phase = math.sqrt(1e9) * 0.01
    place, speed = -1e-3 * math.cos(phase), 1e-3 * math.sqrt(1e9) * math.sin(phase)
    off = math.hypot(
        (state.bodies[0].z_m - place) / 1e-3, (state.bodies[0].velocity_z_m_per_s - speed) / 31.6
    )
    must(off < 1e-3, f"off by {off} of the amplitude")
    parts = int(engine.arrays.counters[PART_COUNT])
    return right(
        f"off by {off:.1g} of the amplitude after {phase / 2 / math.pi:.3g} periods, {parts} parts of steps"
    )


@CASES.add("M2c", RIGHT)
def stiff_spring_implicit(laboratory: Laboratory) -> Outcome:
    """1 kg on 1e9 N/m, generalized_alpha at 0.5 ms: rests at m g / k."""
    engine = laboratory.machine(stiff(integrator="generalized_alpha"), 500_000)
    state = after(engine, 4000, 500_000)
    expected = -GRAVITY / 1e9
    # at 1e9 N/m a place is known to 1e-16 m of 1 m
    must(
        abs(state.bodies[0].z_m - expected) < 1e-12,
        f"rests at {state.bodies[0].z_m} m, {expected} m expected",
    )
    return right(f"rests at {state.bodies[0].z_m:.6g} m, m g / k is {expected:.6g} m")


@CASES.add("M3", RIGHT)
def mass_ratio(laboratory: Laboratory) -> Outcome:
    """1 mg and 100 kg on one spring."""
    light, heavy, stiffness, stretch = 1e-6, 100.0, 1e3, 0.01
    spring = {
        "kind": "spring_damper", "body_a": "heavy", "point_a_m": [0.0, 0.0], "body_b": "light",
        "point_b_m": [1.0 + stretch, 0.0], "free_length_m": 1.0, "stiffness_newton_per_m": stiffness,
    }  # fmt: skip
    machine = {
        "bodies": {"heavy": body(0.0, 0.0, heavy), "light": body(1.0 + stretch, 0.0, light, 1e-9)},
        "joints": {"one": rail("heavy", 0.0, 0.0), "two": rail("light", 1.0 + stretch, 0.0)},
        "forces": {"spring": spring},
    }
    engine, communication_step_ns, ticks = laboratory.machine(machine, 1000, gravity=0.0), 1000, 2000
    state = after(engine, ticks, communication_step_ns)
    omega = math.sqrt(stiffness * (1.0 / light + 1.0 / heavy))
    length = state.bodies[1].x_m - state.bodies[0].x_m - 1.0
    expected = stretch * math.cos(omega * ticks * communication_step_ns * 1e-9)
    momentum = heavy * state.bodies[0].velocity_x_m_per_s + light * state.bodies[1].velocity_x_m_per_s
    scale = light * stretch * omega
    # order 4 in w h = 0.032 over 63 rad: (w h)^4 x 63 x 19/720
    must(abs(length - expected) < 2e-6 * stretch, f"stretch {length} m, {expected} m expected")
    must(abs(momentum) < 1e-7 * scale, f"momentum {momentum / scale} of that of the light one")
    return right(
        f"stretch {length:.8f} m ({expected:.8f}), momentum {momentum / scale:.1g} of the light one's"
    )


@CASES.add("M4", RIGHT)
def bouncing_wheel(laboratory: Laboratory) -> Outcome:
    """Wheel bouncing on undamped ground, 50 times."""
    ground = {
        "kind": "wheel_contact", "body": "wheel", "radius_m": 0.2, "stiffness_newton_per_m": 2e4,
        "damping_newton_s_per_m": 0.0, "friction": 0.0,
    }  # fmt: skip
    machine = {"bodies": {"wheel": body(0.0, 0.25, 10.0)}, "forces": {"ground": ground}}
    engine = laboratory.machine(machine, 500_000)
    before, bounces, touched, worst = 10.0 * GRAVITY * 0.05, 0, False, 0.0
    for tick in range(40_000):
        engine.advance(tick, ())
        z, speed = float(engine.arrays.q[1]), float(engine.arrays.v[1])
        if z < 0.2:
            touched = True
        elif touched:
            touched, bounces = False, bounces + 1
        if z > 0.2:
            height = z - 0.2 + speed**2 / (2.0 * GRAVITY)
            worst = max(worst, abs(height / 0.05 - 1.0))
        if bounces == 50:
            break
    must(bounces == 50 and worst < 1e-6, f"{bounces} bounces, height off by {worst}")
    return right(f"50 bounces in {tick * 5e-4:.2f} s, height within {worst:.1g} ({before:.3g} J)")


def rebound(ratio: float, frequency: float) -> float:
    """Speed after over before of a rotor on a stop of this damping ratio that only pushes."""
    decay, swing = ratio * frequency, frequency * math.sqrt(1.0 - ratio**2)

    def turn(t: float) -> float:
        return math.exp(-decay * t) * math.sin(swing * t) / swing

    def speed(t: float) -> float:
        return math.exp(-decay * t) * (math.cos(swing * t) - decay / swing * math.sin(swing * t))

    end = brentq(
        lambda t: frequency**2 * turn(t) + 2.0 * decay * speed(t), 0.3 * math.pi / swing, math.pi / swing
    )
    return -speed(end)


@CASES.add("M5", RIGHT)
def shank_on_its_stop(laboratory: Laboratory) -> Outcome:
    """Shank turning against its stop, undamped and at 0.05 and 0.3 of critical damping."""
    inertia, stiffness, found = 2.0, 2e5, []
    frequency = math.sqrt(stiffness / inertia)
    for ratio in (0.0, 0.05, 0.3):
        stops = {
            "upper_rad": 0.05, "stiffness_newton_m_per_rad": stiffness,
            "damping_newton_m_s_per_rad": 2.0 * ratio * math.sqrt(stiffness * inertia),
        }  # fmt: skip
        shank = body(0.0, 0.0, 30.0, inertia, angular_velocity_rad_per_s=2.0)
        machine = {
            "bodies": {"shank": shank},
            "joints": {"hinge": pin("ground", "shank", 0.0, 0.0, stops=stops)},
        }
        engine = laboratory.machine(machine, 100_000, gravity=0.0)
        turning = -after(engine, 600, 100_000).bodies[0].angular_velocity_rad_per_s / 2.0
        expected = rebound(ratio, frequency) if ratio else 1.0
        must(abs(turning - expected) < 1e-5, f"ratio {ratio}: {turning}, {expected} expected")
        found.append(f"{ratio:g}: {turning:.7f} ({expected:.7f})")
    return right("damping ratio: speed after over before (closed form); " + "; ".join(found))


def drift(laboratory: Laboratory, steps: int) -> str:
    """The paper's machine on elastic ground, pulled at 0.5 m/s."""
    machine, communication_step_ns = copy.deepcopy(SEVEN_BODIES), 500_000
    machine["forces"]["soil"] = {
        "kind": "point_load", "body": "shank", "point_m": [0.06, -0.22],
        "force_x_newton": {"kind": "sine", "mean": -600.0, "amplitude": 300.0, "frequency_hz": 2.0},
    }  # fmt: skip
    engine = laboratory.machine(machine, communication_step_ns)
    before = book(engine.state("", -1, 0))
    state = after(engine, steps, communication_step_ns)
    turned_over = abs(state.driver_work_joule) + state.dissipated_joule
    gap = abs(book(state) - before) / turned_over
    must(state.position_residual_m < 1e-11, f"joints open by {state.position_residual_m} m")
    must(gap < 1e-6, f"book off by {gap} of {turned_over} J")
    closed = f"joints closed to {state.position_residual_m:.1g} m"
    return f"{steps} steps: {closed}, book to {gap:.1g} of {turned_over:.4g} J"


@CASES.add("M6", RIGHT)
def the_machine(laboratory: Laboratory) -> Outcome:
    """The paper's machine, 20,000 steps."""
    return right(drift(laboratory, 20_000))


@CASES.add("M6", RIGHT, long=True)
def the_machine_for_long(laboratory: Laboratory) -> Outcome:
    """The paper's machine, a million steps."""
    return right(drift(laboratory, 1_000_000))


def driven(laboratory: Laboratory, speed: Document, **more: object) -> MechanismEngine:
    """A trolley on a rail under a driver, 1 ms a step."""
    machine = {
        "bodies": {"trolley": body(0.0, 0.0, 20.0)},
        "joints": {
            "rail": rail("trolley", 0.0, 0.0),
            "drive": {"kind": "driver", "body": "trolley", "coordinate": "x", "speed": speed},
        },
        "draft_driver": "drive",
    }
    return laboratory.machine(machine, 1_000_000, **more)


@CASES.add("M7a", STOPPED)
def controller_that_jumps(laboratory: Laboratory) -> Outcome:
    """A controller that jumps in speed."""
    controller = {
        "driver": "drive", "interval_ticks": 20, "lowest_speed": 0.0, "highest_speed": 1.0,
        "max_acceleration": 1.0, "law": {"kind": "external"},
    }  # fmt: skip
    engine = driven(laboratory, {"kind": "constant", "value": 0.0}, controller=controller)
    return stopped(
        lambda: engine.command(DriverCommand("", 0, "drive", 0.9)), "'drive' is a jump: from 0 within 0.02 s"
    )


@CASES.add("M7b", REFUSED)
def law_that_jumps(laboratory: Laboratory) -> Outcome:
    """A driver's law that changes within less than a step."""
    steep = {"kind": "table", "times_s": [0.1, 0.1001], "values": [0.0, 0.5]}
    gentle = steep | {"times_s": [0.1, 0.102]}
    state = after(driven(laboratory, gentle), 200, 1_000_000)
    must(abs(state.bodies[0].velocity_x_m_per_s - 0.5) < 1e-12, "the gentle law is not followed")
    return refused(lambda: driven(laboratory, steep), r"joints.drive.speed: changes by 0.5 within 0.0001 s")
