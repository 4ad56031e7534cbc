"""Runs with known content: records of a scene that no engine made."""

import math
from pathlib import Path

import numpy as np

from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import (
    BodyState,
    CouplingReport,
    FacetGroupForce,
    ForceState,
    Grant,
    JointReaction,
    MechanismState,
    SoilCloud,
    SoilState,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from subsoil_ros.recording.bag_writer import BagWriter

SCENES = Path(__file__).parents[3] / "config/scenes"
INTERVAL_NS = 30_000
SERIES_TICKS = 4
TICKS = 42  # not a multiple: the last tick is a series tick of its own
SMALL_BIN = ("soil.bin.width_m=0.1", "soil.bin.depth_m=0.36", "soil.bin.length_m=0.5")
SHORT = (
    f"duration_s={TICKS * INTERVAL_NS * 1e-9:.9f}",
    f"coupling.communication_step_ns={INTERVAL_NS}",
    f"record.series_ticks={SERIES_TICKS}",
    "report.settle_s=0",
)


def full_machine(*overrides: str) -> ResolvedScene:
    """The paper's machine with share and wheels as tools."""
    return load_scene(SCENES / "subsoiler_1s300.yaml", (*SMALL_BIN, *SHORT, *overrides))


def tine(*overrides: str) -> ResolvedScene:
    """A tool on a path, no mechanism."""
    return load_scene(SCENES / "tine.yaml", (*SMALL_BIN, *SHORT, *overrides))


def machine_alone() -> ResolvedScene:
    """The machine without soil."""
    return load_scene(SCENES / "mechanism_only.yaml", SHORT)


class Run:
    """Made-up records of a scene: the machine goes forward by 10 mm a tick, all else is random."""

    def __init__(self, resolved: ResolvedScene) -> None:
        self.resolved = resolved
        self.records: dict[tuple[int, type], object] = {}
        self._rng = np.random.default_rng(3)
        for tick in range(resolved.timing.tick_count):
            for record in self._tick(tick):
                self.records[tick, type(record)] = record

    def _numbers(self, count: int) -> list[float]:
        return [float(v) for v in self._rng.standard_normal(count) * 10.0 ** self._rng.integers(-9, 3, count)]

    def _tick(self, tick: int) -> list[object]:
        scene = self.resolved.scene
        head = ("run", tick, (tick + 1) * INTERVAL_NS)
        forward = 0.01 * (tick + 1)
        places = {
            name: (body.position_m[0] + forward, body.position_m[1], body.angle_rad + 0.1 * math.sin(tick))
            for name, body in (scene.mechanism.bodies if scene.mechanism else {}).items()
        }
        motions, wrenches = [], []
        for name, tool in scene.tools.items():
            x_m, z_m, angle_rad = places.get(tool.body, (forward - 0.17, 0.1, 0.02))
            motions.append(ToolMotion(name, x_m, tool.lateral_m, z_m, angle_rad, *self._numbers(3)))
            groups = tuple(FacetGroupForce(group, *self._numbers(3)) for group in tool.groups)
            wrenches.append(ToolWrench(name, *self._numbers(7), 5, groups))
        found: list[object] = [Grant("run", tick), ToolMotions(*head, tuple(motions))]
        if scene.soil is not None:
            found += [
                ToolWrenches(*head, tuple(wrenches)),
                SoilState(*head, 300, 7, 0, 0, 2, *self._numbers(5)),
            ]
            positions = self._rng.random((300, 3)) * (0.5, 0.1, 0.36) - (0.0, 0.05, 0.36)
            speeds = 0.3 * self._rng.random(300)
            found.append(SoilCloud(tick, head[2], positions.astype("f4"), speeds.astype("f4")))
        if scene.mechanism is not None:
            bodies = tuple(BodyState(name, *place, *self._numbers(6)) for name, place in places.items())
            joints = tuple(JointReaction(name, *self._numbers(3)) for name in scene.mechanism.joints)
            kinds = {name: force.kind for name, force in scene.mechanism.forces.items()}
            forces = tuple(
                ForceState(n, *self._numbers(3)) for n, kind in kinds.items() if kind != "point_load"
            )
            found.append(MechanismState(*head, *self._numbers(10), 3 * tick, bodies, joints, forces))
        return [*found, CouplingReport(*head, *self._numbers(5), 0.5 * tick)]

    def is_series(self, tick: int) -> bool:
        return (tick + 1) % SERIES_TICKS == 0 or tick == self.resolved.timing.tick_count - 1

    def series_ticks(self, count: int | None = None) -> list[int]:
        return [tick for tick in range(count or self.resolved.timing.tick_count) if self.is_series(tick)]

    def column(self, kind: type, take) -> list:
        """What `take` finds in the records of every series tick."""
        return [take(self.records[tick, kind]) for tick in self.series_ticks()]

    def write(self, directory: Path, count: int | None = None) -> Path:
        """The run as a folder of `subsoil run`, its first `count` ticks."""
        directory.mkdir()
        self.resolved.write(directory / "scene.yaml")
        writer = BagWriter(directory / "bag", self.resolved.scene, self.resolved.timing)
        for (tick, kind), record in self.records.items():
            wanted = kind in (Grant, ToolMotions, ToolWrenches) or self.is_series(tick)
            if wanted and (count is None or tick < count):
                writer.write(record)
        writer.close()
        return directory
