"""Where the time of a step goes: the engine's phases, clocked from outside while a case runs."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from .. import engine as engine_module
from ..bed import Bed
from ..engine import SoilEngine
from ..tool_surface import ToolSurface
from .cases import Case
from .measure import prepared_engine, run_steps

PHASES: dict[str, tuple[tuple[Any, str], ...]] = {
    "contact": ((engine_module, "pair_forces"), (engine_module, "wall_forces")),
    "search": ((SoilEngine, "_rebuild"),),
    "tool": ((ToolSurface, "add_forces"),),
    "integration": ((engine_module, "kick_drift"), (engine_module, "kick")),
}
"""What each phase calls; none calls another. `search` is that of pairs, walls and tools."""


def phase_parts(case: Case, bed: Bed) -> dict[str, float]:
    """Part of the CPU time of the case's steps in each phase, and in `other`; one thread, sum 1."""
    engine = prepared_engine(case, bed, 1)
    with clocked() as spent:
        start = time.process_time()
        run_steps(engine, case, case.steps)
        whole = time.process_time() - start
    parts = {phase: seconds / whole for phase, seconds in spent.items()}
    return {**parts, "other": 1.0 - sum(parts.values())}


@contextmanager
def clocked(clock: Callable[[], float] = time.process_time) -> Iterator[dict[str, float]]:
    """Seconds by phase that engines spend while the context lasts."""
    spent = dict.fromkeys(PHASES, 0.0)
    plain = [(phase, owner, name, getattr(owner, name)) for phase, c in PHASES.items() for owner, name in c]
    for phase, owner, name, function in plain:
        setattr(owner, name, _timed(function, phase, spent, clock))
    try:
        yield spent
    finally:
        for _, owner, name, function in plain:
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
