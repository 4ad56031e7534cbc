"""subsoil check SCENE: prints size, limits and cost of a run, and any errors, without running it."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..arguments import add_overrides
from ..output import stdout_console, table

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from ...api.check_scene import CheckResult
    from ...limits.stable_steps import Timing
    from ...loading.loader import ResolvedScene
    from ...loading.presets import ErrorInterval, Expected
    from ...mbd.statics import Rest, Survey
    from ...scene.mechanism import Mechanism


RESOLVED_STEPS = 20
"""Steps a period from which a mode counts as resolved: runge_kutta_4 then dissipates 0.03 % of the energy of
an undamped oscillation in a period. With 2.3 to 3 steps it is stable, but damps the oscillation out."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="scene file (.yaml)")
    add_overrides(parser)

    parser.add_argument(
        "--bed", action="store_true", help="prepare the bed, look at it, and leave it alone for 20 ms"
    )
    parser.add_argument(
        "--bed-out", type=Path, metavar="FILE", help="prepare the bed and write it as a file for kind: saved"
    )
    parser.add_argument(
        "--verbose", action="store_true", help="also steps, their limits, and the scene's hash"
    )
    parser.add_argument("--threads", type=int, default=1, help="threads that prepare the bed (default: 1)")


def run(args: argparse.Namespace) -> int:
    """Validate the scene and print its tables. Raises SceneError for any error that would stop a run."""
    from ...api.check_scene import check
    from ...loading.loader import load_scene
    from .soil_rows import material_rows, particle_rows, print_bed, terrain_rows, wedge_rows
    from .tool_rows import tool_rows

    resolved = load_scene(args.scene, args.overrides)
    found = check(resolved)
    scene, soil = resolved.scene, resolved.scene.particle_soil
    console = stdout_console(highlight=True)
    console.print(_facts(scene.name, _general(resolved)))
    if scene.tools:
        console.print(_facts("tools", tool_rows(resolved)))
    if resolved.derived:
        derived = table("derived: not given in the scene", ("key", "value", "because"), words=3)
        for item in resolved.derived:
            derived.add_row(*item)
        console.print(derived)
    if soil is not None:
        if resolved.material is not None:
            console.print(_facts("material", material_rows(resolved.material)))
        console.print(_facts("soil", particle_rows(resolved, soil, found.particles)))
        if found.at_work:
            rows = ((number.name, number.text) for number in found.at_work)
            console.print(_facts("soil at work", rows))
    if scene.terrain_soil is not None:
        console.print(_facts("soil, terrain", terrain_rows(resolved, scene.terrain_soil)))
    if scene.wedge_soil is not None:
        console.print(_facts("soil, wedge model", wedge_rows(resolved, scene.wedge_soil)))
    if args.verbose:
        console.print(_facts("steps", _steps(resolved)))
        if soil is not None:
            console.print(_limits(found))
        if found.coupling:
            console.print(_coupling(found))
    for note in found.notes:
        console.print(note)
    if scene.mechanism and found.mechanism:
        console.print(_facts("mechanism", _mechanism(scene.mechanism, found.mechanism)))
        if found.mechanism.rest is not None:
            for part in _at_rest(scene.mechanism, found.mechanism.rest, resolved.timing):
                console.print(part)
    console.print(_facts("cost", _cost(found)))
    for line in accuracy_lines(resolved, args.overrides):
        console.print(line)
    if args.bed or args.bed_out:
        print_bed(console, resolved, args.threads, args.bed_out)
    for warning in found.warnings:
        console.print(f"warning: {warning}")
    return 0


def _facts(title: str, rows: Iterable[tuple[str, str]]) -> Table:
    facts = table(title)
    facts.add_column(style="dim")
    facts.add_column(overflow="fold")
    for row in rows:
        facts.add_row(*row)
    return facts


def _general(resolved: ResolvedScene) -> Iterable[tuple[str, str]]:
    scene, timing = resolved.scene, resolved.timing
    yield "file", str(resolved.path)
    if "initial_condition" in resolved.document:
        yield "initial_condition", str(resolved.document["initial_condition"])
    yield "duration", f"{scene.duration_s:g} s"
    if scene.controller is not None:
        ticks = scene.controller.interval_ticks
        yield (
            "controller",
            f"{scene.controller.law.kind}, commands {scene.controller.driver} every {ticks} ticks, "
            f"{ticks * timing.communication_step_s * 1e3:g} ms",
        )
    if scene.allow:
        yield "allow", ", ".join(scene.allow)
    if scene.report.note:
        yield "note", scene.report.note


def _steps(resolved: ResolvedScene) -> Iterable[tuple[str, str]]:
    timing = resolved.timing
    yield "scene hash", resolved.scene_hash[:16]
    yield "ticks", f"{timing.tick_count:,} of {timing.communication_step_ns:,} ns"
    if timing.soil_steps:
        yield "soil steps", f"{timing.soil_steps * timing.tick_count:,} ({timing.soil_steps} per tick)"
    if timing.mechanism_steps:
        steps = timing.mechanism_steps
        yield "mechanism steps", f"{steps * timing.tick_count:,} ({steps} per tick)"


def _limits(found: CheckResult) -> Table:
    """Every limit on the soil step; the smallest binds."""
    limits = table("soil step", ("limit", "cause", ""), words=3)
    for index, limit in enumerate(found.limits):
        binding = f"binds: used {found.scene.timing.soil_step_s * 1e6:.4g} us" if index == 0 else ""
        limits.add_row(f"{limit.limit_s * 1e6:.4g} us", limit.cause, binding)
    return limits


def _mechanism(mechanism: Mechanism, found: Survey) -> Iterable[tuple[str, str]]:
    counts = found.topology
    yield "bodies", f"{len(mechanism.bodies)}: {', '.join(mechanism.bodies)}"
    yield "coordinates", f"{counts.coordinate_count}"
    yield "constraints", f"{counts.constraint_count}"
    yield "degrees of freedom", f"{counts.freedom_count}"
    if counts.redundant_count:
        joints = ", ".join(counts.redundant_joints)
        yield "redundant", f"{counts.redundant_count}; reactions not unique: {joints}"
    if found.moved:
        yield "assembly", found.moved
    if found.rest is None:
        yield "static equilibrium", f"none: {found.no_rest}"


def _at_rest(machine: Mechanism, rest: Rest, timing: Timing) -> Iterable[Table]:
    """Pose, joint forces and forces of static equilibrium; modes about it, and steps in their periods."""
    poses = table("static equilibrium (drivers held, loads left out)", ("body", "x m", "z m", "angle rad"))
    for body in rest.bodies:
        poses.add_row(body.name, f"{body.x_m:.4f}", f"{body.z_m:.4f}", f"{body.angle_rad:.5f}")
    yield poses
    reactions = table("", ("joint, on its second body", "force x N", "force z N", "moment N m", ""))
    for joint in rest.joints:
        parts = (joint.force_x_newton, joint.force_z_newton, joint.moment_newton_m)
        reactions.add_row(joint.name, *map(_number, parts), "" if joint.unique else "not unique")
    yield reactions
    forces = table("", ("force", "length m or angle rad", "force N or moment N m"))
    for force in rest.forces:
        forces.add_row(force.name, f"{force.coordinate:.5f}", _number(force.load))
    yield forces
    headings = ("frequency Hz", "damping ratio", "steps a period", "what moves")
    modes = table("modes about static equilibrium", headings)
    modes.columns[3].justify = "left"
    step_s = timing.communication_step_s / timing.mechanism_steps
    in_parts = machine.tolerance is not None and machine.integrator != "generalized_alpha"
    beyond = "not resolved: taken in parts" if in_parts else "not resolved"
    for mode in rest.modes:
        if mode.oscillates:
            steps = 1.0 / (mode.frequency_hz * step_s)
            told = f"{steps:.3g}" if steps >= RESOLVED_STEPS else f"{steps:.3g}, {beyond}"
            modes.add_row(f"{mode.frequency_hz:.4g}", f"{mode.damping_ratio:.3g}", told, mode.words)
        elif mode.eigenvalue == 0.0:
            modes.add_row("free", "", "", mode.words)
        else:
            rate = mode.eigenvalue.real
            modes.add_row("grows" if rate > 0.0 else "creeps", f"in {1.0 / abs(rate):.3g} s", "", mode.words)
    yield modes


def _number(value: float) -> str:
    return f"{value:.1f}" if abs(value) >= 0.05 else "0"


def _coupling(found: CheckResult) -> Table:
    title = f"coupling, interval {found.scene.timing.communication_step_ns * 1e-3:g} us"
    headings = ("tool", "damper outweighs the exchange up to", "stable up to", "estimated from")
    bounds = table(title, headings, words=4)
    for bound in found.coupling:
        bounds.add_row(
            bound.tool,
            f"{bound.undamped_s * 1e6:.4g} us",
            f"{bound.unstable_s * 1e6:.4g} us",
            f"effective mass {bound.effective_mass_kg:.3g} kg, {bound.contact_count:.0f} contacts",
        )
    return bounds


def _cost(found: CheckResult) -> Iterable[tuple[str, str]]:
    cost = found.cost
    exchange, others = _duration(cost.exchange_wall_s), f"{cost.process_bytes / 1e9:.2f} GB for each"
    if found.scene.scene.particle_soil is None:
        yield "memory", f"{others} process"
        yield "wall time", f"about {exchange} as separate processes"
        return
    yield "memory", f"{cost.memory_bytes / 1e9:.2f} GB for the soil, {others} other process"
    yield (
        "wall time",
        f"about {_duration(cost.soil_wall_s)} for the soil on one core, and {exchange} of exchange "
        "between separate processes",
    )


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def accuracy_lines(resolved: ResolvedScene, overrides: Sequence[str]) -> Iterator[RenderableType]:
    """Lines of what a study measured of the chosen preset, or of all; a line if nothing was measured."""
    name, duration = resolved.preset, resolved.scene.duration_s
    if name is None:
        if resolved.presets:
            names = ", ".join(resolved.presets)
            yield f"preset: none, as written; presets of this scene: {names} (--preset NAME)"
        known = {key: item.expected for key, item in resolved.presets.items() if item.expected is not None}
        if known:
            yield from _all_presets(known, duration)
            for note in dict.fromkeys(note for item in known.values() for note in item.notes):
                yield f"{', '.join(key for key, item in known.items() if note in item.notes)}: {note}"
            yield from _changed(overrides)
        return
    expected = resolved.presets[name].expected
    if expected is None:
        yield (
            f"preset {name}: no study has measured its error and its time in this scene and soil; what is "
            "known of other soils: docs/conclusions.md"
        )
        return
    yield _one_preset(f"preset {name}: expected error against {expected.against}", expected.errors, expected)
    for other, errors in expected.errors_against.items():
        yield _one_preset(f"against {other}", errors, expected)
    yield from expected.notes
    if expected.wall_s_per_simulated_s is not None:
        yield (
            f"expected wall time: {expected.wall_s_per_simulated_s * duration:.3g} s for {duration:g} s, "
            f"without start-up, on {expected.machine}"
        )
    yield f"source: {expected.source}"
    yield from _changed(overrides)


def _changed(overrides: Sequence[str]) -> Iterator[str]:
    """Note that overrides change the scene that was measured; presets belong to a material."""
    own = ("preset", "soil.material")
    changed = [text for text in overrides if text.partition("=")[0].strip() not in own]
    if changed:
        yield f"note: measured without {', '.join(f'--set {text}' for text in changed)}"


def _all_presets(known: Mapping[str, Expected], duration_s: float) -> Iterator[Table]:
    """Yield a table with a row for each preset and its wall time, then one for each further reference."""
    walls = {
        name: "" if (wall_s := item.wall_s_per_simulated_s) is None else f"{wall_s * duration_s:.3g} s"
        for name, item in known.items()
    }
    times = {f"wall time for {duration_s:g} s": walls} if any(walls.values()) else {}
    errors = {name: item.errors for name, item in known.items()}
    yield _one_row_each("expected error in %, with its interval", errors, times)
    for other in dict.fromkeys(other for item in known.values() for other in item.errors_against):
        against = {name: item.errors_against.get(other, {}) for name, item in known.items()}
        yield _one_row_each(f"against {other}, in %", against, {})


def _one_row_each(
    title: str, errors: Mapping[str, Mapping[str, ErrorInterval]], further: Mapping[str, Mapping[str, str]]
) -> Table:
    metrics = list(dict.fromkeys(metric for found in errors.values() for metric in found))
    presets = table(title, ("preset", *metrics, *further))
    for name, found in errors.items():
        cells = [_mean_and_interval(found[metric]) if metric in found else "" for metric in metrics]
        presets.add_row(name, *cells, *(column[name] for column in further.values()))
    return presets


def _one_preset(title: str, errors: Mapping[str, ErrorInterval], expected: Expected) -> Table:
    metrics = table(title, ("metric", "error", f"{100.0 * expected.confidence:g} % interval"))
    for metric, error in errors.items():
        metrics.add_row(metric, f"{100.0 * error.mean:+.3g} %", _interval(error))
    return metrics


def _mean_and_interval(error: ErrorInterval) -> str:
    mean, low, high = (
        f"{100.0 * value:+.{1 if abs(value) < 0.1 else 0}f}" for value in (error.mean, error.low, error.high)
    )
    return f"{mean} ({low} to {high})"


def _interval(error: ErrorInterval) -> str:
    return f"{100.0 * error.low:+.3g} to {100.0 * error.high:+.3g} %"
