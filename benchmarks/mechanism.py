"""CPU time per step of the paper's machine, also in Exudyn, and of chains of rods.

python -m benchmarks.mechanism [--largest N] [--json]
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console

from benchmarks.peers.exudyn_machine import exudyn_cost
from subsoil_ros.cli.output import table
from subsoil_ros.cli.progress import KernelAnnouncer
from subsoil_ros.mbd.advance import advance_tick
from subsoil_ros.mbd.assembly import assemble
from subsoil_ros.mbd.machine_arrays import make_state, make_workspace
from subsoil_ros.scene.mechanism import Mechanism
from validation.machines import SEVEN_BODIES, pin

ROUNDS = 5
"""Number of measurements, of which the shortest counts: other load on the computer only adds time."""


@dataclass(frozen=True)
class ChainCost:
    """A chain of `bodies` rods hung on one another."""

    bodies: int
    us_per_step: float


def us_per_step(mechanism: Mechanism, step_s: float, steps: int) -> float:
    """CPU time of one step [us], the best of ROUNDS times `steps` steps after a start."""
    return least_us_per_step((mechanism,), step_s, steps, ROUNDS)[0]


def least_us_per_step(
    mechanisms: tuple[Mechanism, ...], step_s: float, steps: int, rounds: int
) -> tuple[float, ...]:
    """The same of several machines, measured in turns, so that other load falls on all of them."""
    started = []
    for mechanism in mechanisms:
        start = assemble(mechanism, 9.81, step_s)
        model = start.machine.model
        sizes = (len(model.mass), len(model.row_scale), start.rank, len(model.forces))
        state, work = make_state(*sizes, model.weights.shape[1]), make_workspace(*sizes)
        state.q[:], state.v[:] = start.q, start.v
        advance_tick(model, state, work, 0.0, 10)
        started.append((model, state, work))
    best, done = [float("inf")] * len(started), 10
    for _ in range(rounds):
        for i, (model, state, work) in enumerate(started):
            begin = time.process_time()
            advance_tick(model, state, work, done * step_s, steps)
            best[i] = min(best[i], 1e6 * (time.process_time() - begin) / steps)
        done += steps
    return tuple(best)


@dataclass(frozen=True)
class MachineCost:
    """CPU time of a step of the seven bodies [us]: 21 coordinates, 17 constraints, steps of 0.5 ms."""

    us_per_step: float
    fixed_us_per_step: float  # tolerance: null, without the estimate of errors


def machine_cost() -> MachineCost:
    """Measure steps with the estimate of their error and without it, in turns."""
    machines = [{**SEVEN_BODIES, **more} for more in ({}, {"tolerance": None})]
    mechanisms = tuple(Mechanism.model_validate(machine) for machine in machines)
    return MachineCost(*least_us_per_step(mechanisms, 5e-4, 2000, 4 * ROUNDS))


def chain_costs(largest: int) -> tuple[ChainCost, ...]:
    """CPU time of a step of chains of 1, 2, 5, 10, ... rods, up to `largest`."""
    counts = [count for count in (1, 2, 5, 10, 20, 50, 100, 200, 400, 1000) if count <= largest]
    return tuple(
        ChainCost(count, us_per_step(Mechanism.model_validate(chain(count)), 1e-4, max(3, 2000 // count**2)))
        for count in counts
    )


def chain(count: int) -> dict[str, Any]:
    """`count` rods of 0.1 m hung on one another, lying level."""
    rod = {"mass_kg": 0.1, "inertia_kg_m2": 1e-4}
    names = ["ground", *(f"rod{i}" for i in range(count))]
    return {
        "bodies": {names[i + 1]: {**rod, "position_m": (0.1 * i + 0.05, 0.0)} for i in range(count)},
        "joints": {f"pin{i}": pin(names[i], names[i + 1], 0.1 * i, 0.0) for i in range(count)},
    }


def chain_exponent(chain: tuple[ChainCost, ...]) -> float | None:
    """Slope of log cost over log bodies between the last two points; 2: quadratic."""
    if len(chain) < 2:
        return None
    first, last = chain[-2:]
    return math.log(last.us_per_step / first.us_per_step) / math.log(last.bodies / first.bodies)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures and prints tables, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument(
        "--largest", type=int, default=200, metavar="N", help="most rods of a chain (default 200)"
    )
    args = parser.parse_args(arguments)
    with KernelAnnouncer():
        peer = exudyn_cost()  # right before and right after: the same load on the machine
        ours = machine_cost()
        if peer is not None:
            peer = min(peer, exudyn_cost() or peer)
        chain = chain_costs(args.largest)
    if args.json:
        result = {
            "machine_us_per_step": ours.us_per_step,
            "machine_fixed_us_per_step": ours.fixed_us_per_step,
            "exudyn_us_per_step": peer,
            "times_faster_than_exudyn": None if peer is None else peer / ours.us_per_step,
            "chain": [asdict(cost) for cost in chain],
            "chain_exponent": chain_exponent(chain),
        }
        print(json.dumps(result))
        return
    console = Console(width=None if sys.stdout.isatty() else 120)
    machine = table("7-body machine, CPU us per step")
    machine.add_row("Adams-Moulton PECE, order 4, errors estimated", f"{ours.us_per_step:.2f}")
    machine.add_row("the same at fixed steps (tolerance: null)", f"{ours.fixed_us_per_step:.2f}")
    machine.add_row("Exudyn, generalized-alpha", "not installed" if peer is None else f"{peer:.2f}")
    console.print(machine)
    curve = table("chain of rods, CPU us per step", ("bodies", "us"), words=0)
    for cost in chain:
        curve.add_row(str(cost.bodies), f"{cost.us_per_step:.1f}")
    console.print(curve)


if __name__ == "__main__":
    main()
