"""subsoil bench mechanism|soil|lockstep: cost of the engines and of the exchange, beside peers."""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import TYPE_CHECKING

from rich.console import Console

if TYPE_CHECKING:
    from ..mbd.benchmark import ChainCost


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `subsoil bench`."""
    parser.add_argument("engine", choices=["mechanism", "soil", "lockstep"], help="what to measure")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument(
        "--largest",
        type=int,
        default=200,
        metavar="N",
        help="mechanism: most bodies of the chain (default 200)",
    )
    parser.add_argument(
        "--quick", action="store_true", help="soil: only beds of about 9,000 particles; lockstep: few ticks"
    )
    parser.add_argument("--large", action="store_true", help="soil: up to 1,000,000 particles")


def run(args: argparse.Namespace) -> int:
    """Measure and print."""
    if args.engine == "soil":
        from ._shared import bench_soil  # the other engine needs none of it

        return bench_soil.run(args)
    if args.engine == "lockstep":
        from ._shared import bench_lockstep

        return bench_lockstep.run(args)
    from ._shared.preparation import KernelAnnouncer

    with KernelAnnouncer():
        return _mechanism(args)


def _mechanism(args: argparse.Namespace) -> int:
    from ..mbd.benchmark import chain_costs, machine_cost
    from ..mbd.exudyn_peer import exudyn_cost
    from ._shared.progress import working
    from ._shared.tables import table

    with working("measuring the machine"):
        peer = exudyn_cost()  # right before and right after: the same load on the machine
        ours = machine_cost()
        if peer is not None:
            peer = min(peer, exudyn_cost() or peer)
    with working(f"measuring chains of up to {args.largest} rods"):
        chain = chain_costs(args.largest)
    result = {
        "machine_us_per_step": ours.us_per_step,
        "machine_fixed_us_per_step": ours.fixed_us_per_step,
        "exudyn_us_per_step": peer,
        "times_faster_than_exudyn": None if peer is None else peer / ours.us_per_step,
        "chain": [{"bodies": cost.bodies, "us_per_step": cost.us_per_step} for cost in chain],
        "chain_exponent": _exponent(chain),
    }
    if args.json:
        print(json.dumps(result))
        return 0
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
    return 0


def _exponent(chain: tuple[ChainCost, ...]) -> float | None:
    """Slope of log cost over log bodies between the last two points; 2: quadratic."""
    if len(chain) < 2:
        return None
    first, last = chain[-2:]
    return math.log(last.us_per_step / first.us_per_step) / math.log(last.bodies / first.bodies)
