"""S2 to S8: laws, sizes, densities and gravity at their ends."""

import math
from typing import Any

import numpy as np
from numpy.lib.scimath import sqrt as complex_root

from subsoil_ros.dem.build import build_engine
from subsoil_ros.loading.loader import ResolvedScene

from .cases import REFUSED, RIGHT, Cases, Outcome, must, refused, right
from .laboratory import (
    GRAVITY,
    MASS,
    NEGLIGIBLE,
    RADIUS,
    Document,
    Laboratory,
    advance,
    drag,
    linear,
    placed,
    wet,
)
from .steps import DEFECT, SAME

CASES = Cases()

ROOM_M = (0.16, 0.12, 0.12)
CALM_M_PER_S = 1e-6
"""Of a bed at rest: it would take hours to move by a radius."""
CARRIED = 1e-6
"""Floor against weight: round-off of places (1e-17 m) times the stiffest spring, 1e9 N/m, over 1e-2 N."""


def at_rest(resolved: ResolvedScene, steps: int = 300) -> str:
    """A bed that was prepared at rest stays there, and the floor carries it."""
    engine = build_engine(resolved)
    engine.start(())
    advance(engine, steps)
    state = engine.state("", steps - 1, 0)
    weight = engine.mass_kg * resolved.scene.gravity_m_per_s2 * engine.particle_count
    carried = float(engine.wall_force_newton[2])
    must(abs(carried - weight) <= CARRIED * max(weight, 1e-2), f"carried {carried} N of {weight} N")
    must(state.rms_speed_m_per_s < CALM_M_PER_S, f"rms speed {state.rms_speed_m_per_s} m/s")
    return f"{resolved.timing.communication_step_ns} ns: floor {carried:.4g} N of {weight:.4g} N"


def head_on(resolved: ResolvedScene, speed: float, gap: float = 0.0, steps: int = 1) -> list[float]:
    """Overlap of two spheres [m] after every step, beginning `gap` apart with a closing `speed`.

    Of spheres thrown apart (a negative speed) no further than where they turn back.
    """
    x = 0.5 * ROOM_M[0]
    half = RADIUS + 0.5 * gap
    engine = placed(
        resolved,
        [[x - half, 0.0, -0.06], [x + half, 0.0, -0.06]],
        [[0.5 * speed, 0.0, 0.0], [-0.5 * speed, 0.0, 0.0]],
    )
    overlaps = []
    for tick in range(steps):
        engine.advance(tick, ())
        place = engine.positions_m()
        overlaps.append(2.0 * RADIUS - float(np.linalg.norm(place[1] - place[0])))
        if speed < 0.0 and tick > 0 and overlaps[-1] > overlaps[-2]:
            break
    return overlaps


@CASES.add("S2a", RIGHT)
def impact_stiffness(laboratory: Laboratory) -> Outcome:
    """Head-on impact of two spheres, linear law, 1e2 to 1e9 N/m, `auto` and a tenth of it."""
    found = []
    for stiffness in (1e2, 1e4, 1e6, 1e9):
        law = linear(stiffness)
        auto_s = laboratory.soil(law, ROOM_M, gravity=0.0).timing.soil_step_s
        for step_s in (auto_s, 0.1 * auto_s):
            resolved = laboratory.soil(law, ROOM_M, gravity=0.0, time_step_s=round(step_s, 10), skin_m=0.003)
            step = resolved.timing.soil_step_s
            omega = math.sqrt(2.0 * stiffness / MASS)
            steps = math.ceil(math.pi / omega / step) + 5
            overlaps = head_on(resolved, 0.1, 0.3 * 0.1 * step, steps)
            speed = (overlaps[-2] - overlaps[-1]) / step
            allowed = 1.0 - (0.5 * omega * step) ** 2
            must(math.sqrt(allowed) <= speed / 0.1 <= 1.0 / math.sqrt(allowed), f"{stiffness:g}: {speed} m/s")
            found.append(f"{stiffness:g} N/m, w h {omega * step:.2g}: {speed / 0.1:.4f}")
    return right("rebound over approach: " + "; ".join(found))


@CASES.add("S2b", RIGHT)
def bed_stiffness(laboratory: Laboratory) -> Outcome:
    """Resting bed, 1e3 to 1e9 N/m."""
    return right(
        "; ".join(
            f"{stiffness:g} N/m, {at_rest(laboratory.soil(wet(stiffness_newton_per_m=stiffness)))}"
            for stiffness in (1e3, 1e5, 1e7, 1e9)
        )
    )


@CASES.add("S2c", REFUSED)
def bed_too_soft(laboratory: Laboratory) -> Outcome:
    """Bed of five layers at 1e2 N/m."""
    soft = wet(stiffness_newton_per_m=100.0)
    return refused(
        lambda: build_engine(laboratory.soil(soft)), "too soft for a bed of 5 layers: their weight"
    )


@CASES.add("S2d", REFUSED)
def boundary_too_stiff(laboratory: Laboratory) -> Outcome:
    """Boundary of 1e9 N/m, or tools 1e5 times as stiff, beside soft particles, at the step of these."""
    law = linear(1e4)
    law["boundary"] = law["boundary"] | {"stiffness_newton_per_m": 1e9}
    words = r"soil.time_step_s: .* above the stable limit .*at walls and tools"
    refused(lambda: laboratory.soil(law, time_step_s=1e-4), words)
    return refused(lambda: laboratory.soil(tool_stiffness_factor=1e5, time_step_s=4e-5), words)


def damped(speed: float, stiffness: float, damping: float, time: np.ndarray) -> np.ndarray:
    """Overlap of two spheres that touch at time 0 [m], by the damped oscillator of their distance."""
    effective = 0.5 * MASS
    decay = damping / (2.0 * effective)
    root = complex_root(decay**2 - stiffness / effective) or 1e-9 * decay
    return np.real(speed * np.exp(-decay * time) * np.sinh(root * time) / root)


def damped_impact(laboratory: Laboratory, ratio: float) -> str:
    """Compares an impact with the closed form while the spheres touch."""
    stiffness = 5000.0
    omega = math.sqrt(stiffness / (0.5 * MASS))
    damping = ratio * MASS * omega
    law = linear(stiffness, damping_newton_s_per_m=damping)
    auto_s = laboratory.soil(law, ROOM_M, gravity=0.0).timing.soil_step_s
    resolved = laboratory.soil(law, ROOM_M, gravity=0.0, time_step_s=max(1e-9, round(auto_s / 20.0, 9)))
    step, rate = resolved.timing.soil_step_s, max(omega, damping / (0.5 * MASS))
    steps = round(5.0 / rate / step)
    found = np.array(head_on(resolved, 0.1, 0.0, steps))
    exact = damped(0.1, stiffness, damping, step * np.arange(1, steps + 1))
    touching = exact > 0.05 * exact.max()
    error = float(np.abs(found - exact)[touching].max() / exact.max())
    must(error < rate * step, f"ratio {ratio}: error {error} of the largest overlap, rate x h {rate * step}")
    return f"{ratio:g} of critical: {error:.2g} (rate x h {rate * step:.2g})"


@CASES.add("S3a", RIGHT)
def impact_damping(laboratory: Laboratory) -> Outcome:
    """Head-on impact, 0 to 100 times critical damping: overlap against the damped oscillator."""
    return right(
        "error: " + "; ".join(damped_impact(laboratory, ratio) for ratio in (0.0, 0.1, 1.0, 10.0, 100.0))
    )


@CASES.add("S3b", RIGHT)
def printed_damping(laboratory: Laboratory) -> Outcome:
    """C = 20 N s/mm as printed, 1150 times critical, explicit, on 8 particles; refused at 42 us."""
    law = wet(damping_newton_s_per_m=2e4, tangential_damping_newton_s_per_m=2e4)
    size = (0.038, 0.038, 0.038)
    refused(lambda: laboratory.soil(law, size, time_step_s=4.2e-5), "damping 10000 N s/m acting on rotation")
    resolved = laboratory.soil(law, size)
    must(resolved.timing.communication_step_ns < 50, f"step {resolved.timing.communication_step_ns} ns")
    return right(f"{at_rest(resolved, 20_000)}; impact: {damped_impact(laboratory, 1150.0)}")


@CASES.add("S4a", RIGHT)
def thrown_apart(laboratory: Laboratory) -> Outcome:
    """Two particles thrown apart, adhesion 0 to 1e5 times the weight: escape speed."""
    found = []
    rest, reach = 0.002, 0.002
    for times in (0.0, 95.0, 1e3, 1e5):
        peak = times * MASS * GRAVITY  # of a pair, half of a body's
        law = wet(
            cohesive_stiffness_newton_per_m=max(2.0 * peak / reach, NEGLIGIBLE), damping_newton_s_per_m=0.0,
            tangential_damping_newton_s_per_m=0.0,
        )  # fmt: skip
        escape = math.sqrt(peak * (rest + reach) / (0.5 * MASS))
        for part in (0.9, 1.1):
            speed = part * escape or 0.1
            step_s = round(min(1e-5, 1e-3 * (rest + reach) / speed), 10)
            resolved = laboratory.soil(law, ROOM_M, gravity=0.0, time_step_s=step_s)
            step = resolved.timing.soil_step_s
            steps = round(10.0 * (rest + reach) / speed / step)
            gaps = -np.array(head_on(resolved, -speed, -rest, steps))
            leaves = bool(gaps[-1] > reach)
            must(
                leaves == (speed > escape), f"{times:g} weights, {part} of the escape speed: gap {gaps[-1]} m"
            )
            if leaves:
                after = (gaps[-1] - gaps[-2]) / step
                expected = math.sqrt(speed**2 - escape**2)
                must(
                    abs(after - expected) < 5e-3 * speed,
                    f"{times:g} weights: {after} m/s, {expected} expected",
                )
        found.append(f"{times:g}: {escape:.4g} m/s")
    return right("weights: escape speed, met at 0.9 and 1.1 of it; " + "; ".join(found))


@CASES.add("S4b", RIGHT)
def bed_of_strong_adhesion(laboratory: Laboratory) -> Outcome:
    """Resting bed, adhesion 1e5 times the weight, `auto`."""
    return right(
        at_rest(
            laboratory.soil(wet(cohesive_stiffness_newton_per_m=1e5 * 2.0 * MASS * GRAVITY / 0.002)), 2000
        )
    )


@CASES.add("S4c", REFUSED)
def adhesion_too_stiff(laboratory: Laboratory) -> Outcome:
    """The same at the step of K_X alone."""
    law = wet(cohesive_stiffness_newton_per_m=1e5 * 2.0 * MASS * GRAVITY / 0.002)
    return refused(
        lambda: laboratory.soil(law, time_step_s=4.2e-5), r"stiffness 3\.\d+e\+06 and 4000 N/m of the"
    )


def thrown_on_the_floor(laboratory: Laboratory, friction: float) -> tuple[float, float]:
    """Speed [m/s] and rim speed [m/s] of a sphere 0.1 s after it was thrown along the floor at 0.5 m/s."""
    law = linear(
        1e4, tangential_stiffness_newton_per_m=8e3, damping_newton_s_per_m=10.0,
        tangential_damping_newton_s_per_m=10.0, static_friction=friction, sliding_friction=friction,
        rolling_friction=1e-20,
    )  # fmt: skip
    resolved = laboratory.soil(law, ROOM_M, time_step_s=2e-5)
    floor = build_engine(resolved).bed.lower_m[2]
    engine = placed(resolved, [[0.03, 0.0, floor + RADIUS - MASS * GRAVITY / 1e4]], [[0.5, 0.0, 0.0]])
    advance(engine, 5000)
    return float(engine.velocities_m_per_s()[0, 0]), RADIUS * float(
        engine.angular_velocities_rad_per_s()[0, 1]
    )


@CASES.add("S5a", RIGHT)
def no_friction(laboratory: Laboratory) -> Outcome:
    """Sphere thrown along a floor without friction."""
    speed, rim = thrown_on_the_floor(laboratory, 0.0)
    must(abs(speed - 0.5) < 1e-12 and rim == 0.0, f"{speed} m/s, rim {rim} m/s")
    return right(f"{speed:.6f} m/s, rim {rim:g} m/s")


@CASES.add("S5b", RIGHT)
def much_friction(laboratory: Laboratory) -> Outcome:
    """Sphere thrown along a floor of friction 10."""
    speed, rim = thrown_on_the_floor(laboratory, 10.0)
    # the arm is shorter by half the overlap, 3.7 um of 10 mm
    must(abs(speed - 0.5 * 5.0 / 7.0) < 1e-3 and abs(rim - speed) < 1e-3, f"{speed} m/s, rim {rim} m/s")
    return right(f"{speed:.6f} m/s (5/7: {0.5 * 5.0 / 7.0:.6f}), rim {rim:.6f} m/s")


def dragged_twice(laboratory: Laboratory, law: Document, **soil: Any) -> str:
    """A tool at 0.5 m/s for 50 mm: the same force with half the step, and books that close."""
    size_m, box = (0.2, 0.12, 0.1), laboratory.box(0.02, 0.04, 0.06)
    whole = laboratory.soil(law, size_m, tool=box, **soil)
    half = laboratory.soil(law, size_m, tool=box, time_step_s=0.5 * whole.timing.soil_step_s, **soil)
    drags = [
        drag(build_engine(resolved, book=True), resolved.timing.soil_step_s, 0.1, lambda t: 0.5)
        for resolved in (whole, half)
    ]
    forces, defect = [moved.mean_newton for moved in drags], max(moved.defect for moved in drags)
    off = forces[1] / forces[0] - 1.0
    must(defect < DEFECT, f"defect {defect}")
    must(abs(off) < SAME, f"{forces[0]} N, {forces[1]} N with half the step")
    return f"{forces[0]:.1f} N, {100.0 * off:+.1f} % with half the step, defect {defect:.2g}"


@CASES.add("S5c", RIGHT)
def beds_of_friction(laboratory: Laboratory) -> Outcome:
    """Resting bed of friction 10; tool dragged through beds of friction 0 and 10."""
    found = []
    for friction in (0.0, 10.0):
        law = wet(static_friction=friction, sliding_friction=friction)
        words = dragged_twice(laboratory, law)
        found.append(f"{friction:g}: {words}")
    bed = at_rest(laboratory.soil(wet(static_friction=10.0, sliding_friction=10.0)))
    return right(f"friction: force, defect; {'; '.join(found)}; at rest with 10, {bed}")


@CASES.add("S6", REFUSED)
def size_ratio(laboratory: Laboratory) -> Outcome:
    """Sizes 1:20."""
    sizes = {"kind": "uniform", "min_radius_m": 0.001, "max_radius_m": 0.02}
    particles = {"sizes": sizes, "density_kg_per_m3": 1800.0}
    return refused(
        lambda: laboratory.soil(particles=particles, bed={"kind": "dense_random"}),
        "20 times .* up to 4 times",
    )


@CASES.add("S7", RIGHT)
def densities(laboratory: Laboratory) -> Outcome:
    """Resting beds of 10 and 20,000 kg/m3; the step is proportional to the density."""
    found, steps = [], []
    for density in (10.0, 20_000.0):
        resolved = laboratory.soil(particles={"radius_m": RADIUS, "density_kg_per_m3": density})
        steps.append(resolved.timing.communication_step_ns / density)
        found.append(f"{density:g} kg/m3, {at_rest(resolved)}")
    must(abs(steps[0] / steps[1] - 1.0) < 0.01, f"ns per kg/m3: {steps}")
    heavy = {"radius_m": RADIUS, "density_kg_per_m3": 20_000.0}
    found.append(f"dragged at 20,000 kg/m3: {dragged_twice(laboratory, wet(), particles=heavy)}")
    return right("; ".join(found))


@CASES.add("S8", RIGHT)
def gravities(laboratory: Laboratory) -> Outcome:
    """Gravity 0 and 100 m/s2."""
    found = [f"{g:g} m/s2, {at_rest(laboratory.soil(gravity=g))}" for g in (0.0, 100.0)]
    found.append(f"dragged at 100 m/s2: {dragged_twice(laboratory, wet(), gravity=100.0)}")
    return right("; ".join(found))
