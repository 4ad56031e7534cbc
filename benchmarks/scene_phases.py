"""Wall time of a direct run without recording, and its parts: contact, search, tool, integration.

    python benchmarks/scene_phases.py SCENE [--threads N] [--set key=value ...]

Prints one JSON object. The parts are of the wall time after the start; `mechanism` is that of the machine,
`other` that between the kernels.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from subsoil_ros.api.prepare_bed import prepare_bed_first
from subsoil_ros.cli.progress import KernelAnnouncer, bed_progress
from subsoil_ros.coupling.engines import build_motion_source, build_soil, soil_state
from subsoil_ros.dem.cpu_steps import CpuSteps
from subsoil_ros.dem.integration import kick_drift
from subsoil_ros.dem.kernel_calls import KernelCalls
from subsoil_ros.dem.pairs import pair_forces
from subsoil_ros.dem.step import drift_and_contacts
from subsoil_ros.dem.tools.surface import ToolSurface
from subsoil_ros.dem.walls import wall_forces
from subsoil_ros.loading.loader import load_scene

_KERNELS = {
    "pair_forces": "contact",
    "wall_forces": "contact",
    "kick_drift": "integration",
    "kick": "integration",
}
_METHODS: dict[str, tuple[Any, str]] = {
    "search": (CpuSteps, "rebuild"),
    "tool": (ToolSurface, "forces"),
}
_BIND = (KernelCalls, "bind")
PHASES = (*dict.fromkeys(_KERNELS.values()), *_METHODS)
"""Kernels by name and methods, none of which calls another. `search` is that of pairs, walls and tools."""


@contextmanager
def clocked(clock: Callable[[], float] = time.process_time) -> Iterator[dict[str, float]]:
    """Seconds by phase that engines spend while the context lasts."""
    spent = dict.fromkeys(PHASES, 0.0)
    plain = [(owner, name, getattr(owner, name)) for owner, name in (*_METHODS.values(), _BIND)]
    bind = KernelCalls.bind

    def timed_bind(calls: KernelCalls, kernel: Any, *arguments: Any, **more: Any) -> Callable[..., Any]:
        if kernel is drift_and_contacts:
            return taken_apart(calls, *arguments)
        call, phase = bind(calls, kernel, *arguments, **more), _KERNELS.get(kernel.__name__)
        return call if phase is None else _timed(call, phase, spent, clock)

    def taken_apart(calls: KernelCalls, motion: Any, pairs: Any, walls: Any) -> Callable[[int, bool], int]:
        """drift_and_contacts with a clock around each of its kernels."""
        drift = timed_bind(calls, kick_drift, *motion, varying=(1,))
        contacts = timed_bind(calls, pair_forces, *pairs), timed_bind(calls, wall_forces, *walls)

        def step(kicks: int, with_contacts: bool) -> int:
            far: int = drift(kicks) if kicks > 0 else 0
            if with_contacts and far == 0:
                for forces in contacts:
                    forces()
            return far

        return step

    for phase, (owner, name) in _METHODS.items():
        setattr(owner, name, _timed(getattr(owner, name), phase, spent, clock))
    setattr(*_BIND, timed_bind)
    try:
        yield spent
    finally:
        for owner, name, function in plain:
            setattr(owner, name, function)


def _timed(
    function: Callable[..., Any], phase: str, spent: dict[str, float], clock: Callable[[], float]
) -> Callable[..., Any]:
    def timed(*args: Any, **kwargs: Any) -> Any:
        start = clock()
        try:
            return function(*args, **kwargs)
        finally:
            spent[phase] += clock() - start

    return timed


def main() -> None:
    """Runs the scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()
    resolved = load_scene(args.scene, args.overrides)
    prepare_bed_first(resolved, args.threads, bed_progress)
    motion_source = build_motion_source(resolved)
    soil = build_soil(resolved, args.threads)
    if soil is None:
        raise SystemExit(f"{args.scene}: has no soil, so there is nothing to profile")
    with KernelAnnouncer(), clocked(time.perf_counter) as spent:
        wrenches = soil.start(motion_source.initial_motions())
        spent.update(dict.fromkeys(spent, 0.0))
        mechanism_s = 0.0
        start, cpu = time.perf_counter(), time.process_time()
        for tick in range(resolved.timing.tick_count):
            before = time.perf_counter()
            motions = motion_source.advance(tick, wrenches)
            mechanism_s += time.perf_counter() - before
            wrenches = soil.advance(tick, motions)
        wall_s, cpu_s = time.perf_counter() - start, time.process_time() - cpu
    end = resolved.timing.tick_count - 1
    state = soil_state(soil, "", end, (end + 1) * resolved.timing.communication_step_ns)
    steps = resolved.timing.tick_count * resolved.timing.soil_steps
    parts = {phase: seconds / wall_s for phase, seconds in spent.items()}
    parts["mechanism"] = mechanism_s / wall_s
    result = {
        "scene": resolved.scene.name,
        "particle_count": state.particle_count,
        "steps": steps,
        "threads": args.threads,
        "rebuild_count": state.rebuild_count,
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "particle_steps_per_wall_s": state.particle_count * steps / wall_s,
        "parts": {**parts, "other": 1.0 - sum(parts.values())},
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
