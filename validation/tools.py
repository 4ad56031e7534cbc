"""S9 to S12: tools at the ends of speed, place and shape."""

import numpy as np

from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine

from .cases import REFUSED, RIGHT, STOPPED, Cases, Outcome, must, refused, right, right_or_stopped, stopped
from .laboratory import NEGLIGIBLE, RADIUS, Drag, Laboratory, advance, drag, tool_at, wet
from .steps import DEFECT, SAME

CASES = Cases()

BED_M = (0.24, 0.12, 0.1)
TOOL_M = (0.02, 0.04, 0.06)


def bed_with_tool(laboratory: Laboratory, **soil: object) -> SoilEngine:
    """The paper's soil with a box in it, energy booked."""
    return build_engine(laboratory.soil(size_m=BED_M, tool=laboratory.box(*TOOL_M), **soil), book=True)


STEP_S = 3.2e-5
"""What `auto` takes."""


@CASES.add("S9a", RIGHT)
def standing_tool(laboratory: Laboratory) -> Outcome:
    """Tool at rest in the bed."""
    moved = drag(bed_with_tool(laboratory), STEP_S, 0.05, lambda t: 0.0)
    dragged = drag(bed_with_tool(laboratory), STEP_S, 0.1, lambda t: 0.1)
    work = moved.engine.energy().tool_work_joule
    must(work == 0.0, f"work {work} J")
    late = np.ptp(moved.forces_newton[-200:])
    must(late < 0.01 * abs(dragged.mean_newton), f"force still changes by {late} N")
    # what is left is adhesion on one side more than on the other: K_B delta_B of a contact at most
    contacts = moved.engine.advance(0, tool_at(0.06, -0.03))[0].contact_count
    peak = 1.0 / (1.0 / 7000.0 + 1.0 / 3000.0) * 0.002
    must(abs(moved.mean_newton) < contacts * peak, f"force {moved.mean_newton} N of {contacts} contacts")
    return right(
        f"work {work:g} J, force {moved.mean_newton:.3g} N (dragged at 0.1 m/s: {dragged.mean_newton:.3g} N)"
    )


def at_speed(laboratory: Laboratory, speed: float) -> str:
    """The tool at this speed for 30 mm, or 0.1 s: the same force with half the step, and books that close."""
    moved, halved = (
        drag(bed_with_tool(laboratory, **step), step_s, min(0.1, 0.03 / speed), lambda t: speed)
        for step_s, step in ((STEP_S, {}), (0.5 * STEP_S, {"time_step_s": 0.5 * STEP_S}))
    )
    must(moved.defect < DEFECT, f"{speed} m/s: defect {moved.defect}")
    off = halved.mean_newton / moved.mean_newton - 1.0
    must(abs(off) < SAME, f"{speed} m/s: {moved.mean_newton} N, {halved.mean_newton} N with half the step")
    return f"{moved.mean_newton:.1f} N, {100.0 * off:+.1f} % with half the step, defect {moved.defect:.2g}"


@CASES.add("S9b", RIGHT, STOPPED)
def tool_speeds(laboratory: Laboratory) -> Outcome:
    """Tool at 0.1, 1, 5 and 20 m/s."""
    words = []
    for speed in (0.1, 1.0, 5.0, 20.0):
        outcome = right_or_stopped(
            lambda speed=speed: at_speed(laboratory, speed), "overlap|left the domain|pass each other"
        )
        if speed <= 1.0:
            must(outcome.ending == RIGHT, outcome.found)
        words.append(f"{speed:g} m/s: {outcome.found.split(';')[0]}")
    return right("; ".join(words))


def there_and_back(time: float) -> float:
    """+0.5 m/s until 0.1 s, back until 0.2 s, then at rest; 2 ms in between."""
    return float(np.interp(time, (0.1, 0.102, 0.2, 0.202), (0.5, -0.5, -0.5, 0.0)))


def ahead_and_back(moved: Drag, step_s: float) -> tuple[float, float]:
    """Mean force of the last half of both ways [N]."""
    force = np.array(moved.forces_newton)
    ahead, back = (force[int(a / step_s) : int(b / step_s)].mean() for a, b in ((0.05, 0.1), (0.15, 0.2)))
    return ahead, back


@CASES.add("S9c", RIGHT)
def reversal_and_stop(laboratory: Laboratory) -> Outcome:
    """Tool reverses from +0.5 to -0.5 m/s, then stops."""
    moved = drag(bed_with_tool(laboratory), STEP_S, 0.3, there_and_back)
    ahead, back = ahead_and_back(moved, STEP_S)
    halved = drag(bed_with_tool(laboratory, time_step_s=0.5 * STEP_S), 0.5 * STEP_S, 0.2, there_and_back)
    again = ahead_and_back(halved, 0.5 * STEP_S)
    must(abs(again[0] / ahead - 1.0) < SAME, f"{ahead} N ahead, {again[0]} N with half the step")
    state = moved.engine.state("", 0, 0)
    must(moved.defect < DEFECT, f"defect {moved.defect}")
    must(ahead < 0.0 < back, f"forces {ahead} N ahead, {back} N back")
    must(state.rms_speed_m_per_s < 1e-3, f"rms speed {state.rms_speed_m_per_s} m/s at the end")
    return right(
        f"{ahead:.1f} N ahead ({again[0]:.1f} N with half the step), {back:.1f} N back, defect "
        f"{moved.defect:.2g}, rms speed 0.1 s after the stop "
        f"{state.rms_speed_m_per_s:.2g} m/s"
    )


@CASES.add("S10", STOPPED)
def leap(laboratory: Laboratory) -> Outcome:
    """Tool moving by more than a radius per step."""
    speed = 1.2 * RADIUS / STEP_S
    return stopped(
        lambda: drag(bed_with_tool(laboratory), STEP_S, 0.001, lambda t: speed), "tick 0: tool tool moves at"
    )


@CASES.add("S11a", RIGHT)
def starting_inside(laboratory: Laboratory) -> Outcome:
    """Tool starting inside the bed."""
    engine = bed_with_tool(laboratory)
    before = engine.particle_count
    at = tool_at(0.12, -0.03)
    engine.start(at)
    removed = before - engine.particle_count
    pressed = engine.state("", 0, 0).max_tool_overlap_m
    advance(engine, 3000, at)
    state = engine.state("", 0, 0)
    moved = float(np.linalg.norm(engine.displacements_m(), axis=1).max())
    must(0 < removed < before and pressed <= 0.002, f"{removed} removed, overlap {pressed} m at the start")
    must(state.rms_speed_m_per_s < 1e-3 and moved < RADIUS, f"{state.rms_speed_m_per_s} m/s, moved {moved} m")
    return right(
        f"{removed} of {before} removed; rms speed {state.rms_speed_m_per_s:.2g} m/s, moved {moved:.2g} m"
    )


@CASES.add("S11b", REFUSED)
def larger_than_the_bed(laboratory: Laboratory) -> Outcome:
    """Tool larger than the bed."""
    engine = build_engine(laboratory.soil(tool=laboratory.box(1.0, 1.0, 1.0)))
    return refused(lambda: engine.start(tool_at(0.05, -0.05)), "overlap every particle")


def pressed(laboratory: Laboratory, mesh: str, top_m: float) -> tuple[float, int]:
    """Force [N] and contacts of a sphere 0.1 mm into repulsion on a tool whose highest point is `top_m`."""
    law = wet(cohesive_stiffness_newton_per_m=NEGLIGIBLE, rolling_friction=NEGLIGIBLE)
    resolved = laboratory.soil(law, (0.2, 0.2, 0.2), gravity=0.0, tool=mesh)
    engine = build_engine(resolved)
    z = -0.1
    engine.place([[0.1, 0.0, z + top_m + RADIUS - 0.002 - 1e-4]])
    engine.start(tool_at(0.1, z - 0.5))  # from below in one step: a start removes what presses
    wrench = engine.advance(0, tool_at(0.1, z))[0]
    return -wrench.force_z_newton, wrench.contact_count


@CASES.add("S12", RIGHT)
def shapes(laboratory: Laboratory) -> Outcome:
    """Blade 0.2 mm thick on its edge and flat, 20 m plate, facets of 0.3 mm on a sphere."""
    stiffness = 1.0 / (1.0 / 10_000.0 + 1.0 / 16_000.0)
    meshes = {
        "on the edge of a blade": (laboratory.box(0.06, 0.0002, 0.04), 0.02),
        "on the flat of it": (laboratory.box(0.06, 0.04, 0.0002), 0.0001),
        "20 m plate": (laboratory.box(19.9, 0.1, 0.02), 0.01),
        "facets of 0.3 mm": (laboratory.box(0.02, 0.02, 0.02, subdivide=6), 0.01),
    }
    words = []
    for name, (mesh, top_m) in meshes.items():
        force, contacts = pressed(laboratory, mesh, top_m)
        # corners are float32 in the file: 1e-9 m, of a plate of 10 m 5e-7 m, of 1e-4 m pressed
        must(
            contacts == 1 and abs(force / (stiffness * 1e-4) - 1.0) < 1e-2,
            f"{name}: {force} N, {contacts} contacts",
        )
        words.append(f"{name}: {force:.4f} N")
    return right(f"{stiffness * 1e-4:.4f} N expected; " + "; ".join(words))
