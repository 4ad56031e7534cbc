"""Cost of the exchange between nodes whose engines compute nothing, also beside HELICS.

python -m benchmarks.lockstep [--quick] [--json]
"""

import argparse
import itertools
import json
import statistics
import sys
import tempfile
import time
from array import array
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
import trimesh
from rich.console import Console

from benchmarks.idle import STAMPS_FILE
from benchmarks.peers.helics_exchange import helics_cost
from benchmarks.soil_cases import DENSITY_KG_PER_M3, LINEAR, RADIUS_M
from subsoil_ros.cli.output import say, table
from subsoil_ros.coupling.observer import RunWatch
from subsoil_ros.coupling.protocol import COUPLER, MECHANISM, RECORDER, SOIL
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.ros.process.node_plan import Parameters
from subsoil_ros.ros.process.supervisor import NodeProcess, Supervisor, node_program, start_node
from subsoil_ros.ros.transport.ros_domain import run_domain
from subsoil_ros.yaml_document import dump_yaml
from validation.machines import SEVEN_BODIES

TICKS, QUICK_TICKS = 12_000, 2500
WARM_UP_TICKS = 1500
"""Ticks left out at the start; after them the histories of topics (ros/transport/qos.py) are full too."""

IDLE = {name: ("-m", "benchmarks.idle", name) for name in (MECHANISM, SOIL)}
"""Python programs of the nodes that compute nothing."""

_INTERVAL_NS = 50_000
_SERIES_TICKS = 20  # as the paper's scene has it


@dataclass(frozen=True)
class NodeCost:
    """Resources of one node's process per exchange."""

    cpu_us: float
    switches: float  # context switches of its threads


@dataclass(frozen=True)
class ExchangeCost:
    """Cost of serial exchanges between processes whose engines compute nothing."""

    processes: int
    exchanges: int
    wall_us_median: float
    wall_us_mean: float
    wall_us_p10: float
    wall_us_p90: float
    cpu_us_per_exchange: float
    nodes: dict[str, NodeCost]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures and prints a table, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument("--quick", action="store_true", help="few ticks")
    args = parser.parse_args(arguments)
    ticks = QUICK_TICKS if args.quick else TICKS
    say(f"exchanging {ticks} times without and with a recorder")
    peer = helics_cost(ticks, WARM_UP_TICKS)  # before and after: the same load on the machine
    three = exchange_cost(ticks, recorded=False)
    four = exchange_cost(ticks, recorded=True)
    again = helics_cost(ticks, WARM_UP_TICKS) if peer is not None else None
    if peer is not None and again is not None:
        peer = min(peer, again, key=lambda cost: cost["wall_us_median"])
    if args.json:
        print(json.dumps({"lockstep": asdict(three), "lockstep_recorded": asdict(four), "helics": peer}))
    else:
        _print(three, four, peer)


def exchange_cost(ticks: int, *, recorded: bool) -> ExchangeCost:
    """Seven bodies and three tools; mechanism, soil and coupler, and the recorder if the run is recorded."""
    with tempfile.TemporaryDirectory() as place, run_domain() as domain:
        folder = Path(place)
        scene = write_scene(folder, ticks)
        parameters: Parameters = {
            "scene": str(scene),
            "run_id": "bench",
            "recorded": recorded,
            "supervised": True,
        }
        own: dict[str, Parameters] = {RECORDER: {"bag": str(folder / "bag")}}
        names = (MECHANISM, SOIL, *((RECORDER,) if recorded else ()), COUPLER)
        processes = [
            start_node(
                name,
                IDLE.get(name, node_program(name)),
                folder / f"{name}.log",
                {**parameters, **own.get(name, {})},
                domain,
            )
            for name in names
        ]
        meter = _Meter(processes)
        status = Supervisor(processes, RunWatch(meter.note)).follow()
        if status.code:
            raise status.error()
        stamps_ns = array("q", (folder / STAMPS_FILE).read_bytes())[WARM_UP_TICKS:]
    laps_us = sorted(1e-3 * (later - sooner) for sooner, later in itertools.pairwise(stamps_ns))
    nodes = meter.per_tick()
    return ExchangeCost(
        processes=len(names),
        exchanges=len(laps_us),
        wall_us_median=statistics.median(laps_us),
        wall_us_mean=statistics.fmean(laps_us),
        wall_us_p10=laps_us[int(0.1 * len(laps_us))],
        wall_us_p90=laps_us[int(0.9 * len(laps_us))],
        cpu_us_per_exchange=sum(node.cpu_us for node in nodes.values()),
        nodes=nodes,
    )


class _Meter:
    """Samples the resources that processes use during a run, and returns them per tick."""

    def __init__(self, processes: list[NodeProcess]) -> None:
        self._pids = {process.name: process.popen.pid for process in processes}
        self._samples: list[tuple[int, dict[str, tuple[float, dict[int, int]]]]] = []

    def note(self, tick: int) -> None:
        """Take a sample when the run has reached `tick`."""
        if tick < WARM_UP_TICKS:
            return
        try:
            used = {name: (_cpu_s(pid), _switches(pid)) for name, pid in self._pids.items()}
        except (OSError, psutil.NoSuchProcess):  # the run is over, processes are gone
            return
        self._samples.append((tick, used))

    def per_tick(self) -> dict[str, NodeCost]:
        """Return the resources of each process per tick between the first sample and the last."""
        if len(self._samples) < 2:
            return {}
        (first_tick, first), (last_tick, last) = self._samples[0], self._samples[-1]
        costs = {}
        for name, (cpu_s, switches) in last.items():
            cpu_before_s, before = first[name]
            grown = sum(count - before.get(task, 0) for task, count in switches.items())
            ticks = last_tick - first_tick
            costs[name] = NodeCost(cpu_us=1e6 * (cpu_s - cpu_before_s) / ticks, switches=grown / ticks)
        return costs


def _cpu_s(process_id: int) -> float:
    """CPU time of a process, with threads that have ended; psutil resolves it to 10 ms only."""
    return time.clock_gettime((~process_id << 3) | 2)  # as clock_getcpuclockid(3) makes it; 2: CPU time


def _switches(process_id: int) -> dict[int, int]:
    """Context switches of each thread of a process, by thread number, which psutil takes as a process id."""
    threads = psutil.Process(process_id).threads()
    return {thread.id: sum(psutil.Process(thread.id).num_ctx_switches()) for thread in threads}


def write_scene(folder: Path, ticks: int) -> Path:
    """Write a scene with the right numbers of bodies and tools; its physics is not used."""
    trimesh.creation.box((0.1, 0.1, 0.1)).export(folder / "tool.stl")
    forces = {name: part for name, part in SEVEN_BODIES["forces"].items() if part["kind"] != "wheel_contact"}
    mesh = {"mesh": str(folder / "tool.stl")}
    document = {
        "name": "bench",
        "duration_s": 1e-9 * _INTERVAL_NS * ticks,
        "soil": {
            "bin": {"length_m": 0.2, "width_m": 0.2, "depth_m": 0.2},
            "particles": {"radius_m": RADIUS_M, "density_kg_per_m3": DENSITY_KG_PER_M3},
            "bed": {"kind": "grid", "spacing_m": "rest"},
            "law": {"kind": "linear", "particle": LINEAR, "boundary": LINEAR},
        },
        "mechanism": {**SEVEN_BODIES, "forces": forces},
        "tools": {
            name: {"body": name, "groups": {"share": mesh, "blade": mesh}}
            for name in ("shank", "wheel_left", "wheel_right")
        },
        "coupling": {"communication_step_ns": _INTERVAL_NS},
        "record": {"series_ticks": _SERIES_TICKS, "cloud_hz": 0.0},
    }
    path = folder / "scene.yaml"
    path.write_text(dump_yaml(document), encoding="utf-8")
    load_scene(path)  # so that an error is raised here, not in the nodes' logs
    return path


def _print(three: ExchangeCost, four: ExchangeCost, peer: dict[str, float] | None) -> None:
    console = Console(width=None if sys.stdout.isatty() else 120)
    headings = ("", "wall, median", "mean", "90 %", "CPU", *four.nodes)
    costs = table("one serial exchange [us]", headings)
    for name, cost in (("coupler, mechanism, soil", three), ("and recorder", four)):
        costs.add_row(
            name,
            *(f"{value:.0f}" for value in (cost.wall_us_median, cost.wall_us_mean, cost.wall_us_p90)),
            f"{cost.cpu_us_per_exchange:.0f}",
            *(f"{cost.nodes[node].cpu_us:.0f}" if node in cost.nodes else "" for node in four.nodes),
        )
    if peer is None:
        costs.add_row("HELICS", "not installed")
    else:
        costs.add_row(
            "HELICS, 2 federates, zmqss",
            f"{peer['wall_us_median']:.0f}",
            "",
            "",
            f"{peer['cpu_us_per_exchange']:.0f}",
        )
    console.print(costs)


if __name__ == "__main__":
    main()
