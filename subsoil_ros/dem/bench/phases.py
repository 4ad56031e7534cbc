"""Time of a step by phase of the engine, clocked from outside while a case runs."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ..bed import Bed
from ..engine import SoilEngine
from ..integration import kick_drift
from ..kernel_calls import KernelCalls
from ..pairs import pair_forces
from ..step import drift_and_contacts
from ..tools.surface import ToolSurface
from ..walls import wall_forces
from .cases import Case
from .measure import prepared_engine, run_steps

_KERNELS = {
    "pair_forces": "contact",
    "wall_forces": "contact",
    "kick_drift": "integration",
    "kick": "integration",
}
_METHODS: dict[str, tuple[Any, str]] = {
    "search": (SoilEngine, "_rebuild"),
    "tool": (ToolSurface, "forces"),
}
_BIND = (KernelCalls, "bind")
PHASES = (*dict.fromkeys(_KERNELS.values()), *_METHODS)
"""Kernels by name and methods, none of which calls another. `search` is that of pairs, walls and tools."""


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
