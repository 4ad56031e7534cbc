"""Wall and CPU time of one lockstep exchange between four processes, engines being trivial. Prints JSON.

The scene has the paper's seven bodies and three tools; series are recorded every 20 ticks.
"""

import json
import resource
import sys
import tempfile
from pathlib import Path

from subsoil_ros.coupling.protocol import COUPLER, MECHANISM, RECORDER, SOIL
from subsoil_ros.messages import (
    BodyState,
    GroupForce,
    MechanismState,
    SoilCloud,
    SoilState,
    ToolMotion,
    ToolWrench,
)
from subsoil_ros.scene.loader import load_scene

SCENE = Path(__file__).parents[1] / "config/scenes/subsoiler_1s300.yaml"
TICKS = 4000


class IdleMechanism:
    """Moves every tool forward at constant speed."""

    def __init__(self, tools: tuple[str, ...], bodies: tuple[str, ...]) -> None:
        self._tools = tools
        self._bodies = bodies

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """At rest at the origin."""
        return self.advance(-1, ())

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """One step further."""
        x_m = (tick + 1) * 1e-5
        return tuple(ToolMotion(name, x_m, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0) for name in self._tools)

    def state(self, run_id: str, tick: int, end_time_ns: int) -> MechanismState:
        """All zero."""
        bodies = tuple(BodyState(name, *[0.0] * 9) for name in self._bodies)
        return MechanismState(run_id, tick, end_time_ns, *[0.0] * 9, bodies=bodies)


class IdleSoil:
    """Answers with no force."""

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """No force."""
        return self.advance(-1, motions)

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """No force."""
        groups = (GroupForce("share", 0.0, 0.0, 0.0), GroupForce("blade", 0.0, 0.0, 0.0))
        return tuple(ToolWrench(motion.tool, *[0.0] * 7, 0, groups) for motion in motions)

    def state(self, run_id: str, tick: int, end_time_ns: int) -> SoilState:
        """All zero."""
        return SoilState(run_id, tick, end_time_ns, 0, 0, 0, 0, *[0.0] * 5)

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """Never asked for: the benchmark records no clouds."""
        raise NotImplementedError


def serve(name: str) -> int:
    """Runs the node `name` with its trivial engine as this process."""
    from subsoil_ros.nodes.mechanism_node import MechanismNode
    from subsoil_ros.nodes.process import run_process
    from subsoil_ros.nodes.soil_node import SoilNode

    def mechanism(settings, run, lifeline):
        scene = run.resolved.scene
        engine = IdleMechanism(tuple(scene.tools), tuple(scene.mechanism.bodies))
        return MechanismNode(engine, run, lifeline)

    def soil(settings, run, lifeline):
        return SoilNode(IdleSoil(), None, run, lifeline)

    return run_process(name, {MECHANISM: mechanism, SOIL: soil}[name])


def measure() -> dict[str, float]:
    """Runs the four processes."""
    from subsoil_ros.analysis.series import read_series
    from subsoil_ros.cli.supervisor import Supervisor, node_program, start_node
    from subsoil_ros.nodes.domain import run_domain

    resolved = load_scene(SCENE, ["record.cloud_hz=0"])
    resolved = load_scene(SCENE, ["record.cloud_hz=0", f"duration_s={TICKS * resolved.timing.interval_s}"])
    with tempfile.TemporaryDirectory() as folder, run_domain() as domain:
        out = Path(folder)
        resolved.write(out / "scene.yaml")
        common = {"scene": str(out / "scene.yaml"), "run_id": "benchmark", "supervised": True}
        bag = out / "bag"
        programs = {MECHANISM: (__file__, MECHANISM), SOIL: (__file__, SOIL)}
        processes = [
            start_node(
                name,
                programs.get(name, node_program(name)),
                out / f"{name}.log",
                {**common, "bag": str(bag)},
                domain,
            )
            for name in (MECHANISM, SOIL, RECORDER, COUPLER)
        ]
        ending = Supervisor(processes, lambda tick: None).follow(lambda: 0)
        if ending.exit_status:
            raise ending.error()
        series = read_series(bag, resolved.scene)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "exchanges": resolved.timing.tick_count,
        "wall_us_per_exchange": 1e6 * series.wall_time_s / resolved.timing.tick_count,
        "cpu_us_per_exchange_with_start_up": 1e6
        * (used.ru_utime + used.ru_stime)
        / resolved.timing.tick_count,
    }


if __name__ == "__main__":
    if len(sys.argv) > 1 and not sys.argv[1].startswith("-"):
        raise SystemExit(serve(sys.argv[1]))
    print(json.dumps(measure()))
