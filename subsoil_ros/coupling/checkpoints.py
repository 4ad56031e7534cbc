"""Checkpoints of a run: the state of the exchange, and the parts that its processes write.

A checkpoint of tick k has the states at its end: those of the engines of motion source and soil, and that of
the coupling: the last motions and wrenches, which tick k+1 begins with, and the interface account.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from ..errors import InputError
from ..loading.loader import ResolvedScene
from ..messages import FacetGroupForce, SpatialMotion, ToolMotion, ToolWrench
from ..recording.checkpoint import (
    Checkpoint,
    commit,
    document_sha256,
    has_parts,
    note_end,
    state_sha256,
    write_part,
)
from ..scene.scene import Scene
from ..ticks import INITIAL_TICK, tick_end_s
from ..yaml_document import Document
from .energy_account import InterfaceWork
from .engines import Resumable, motion_source_part
from .protocol import SOIL

COUPLING = "coupling"


def part_names(scene: Scene) -> tuple[str, ...]:
    """Names of the parts of a checkpoint of the scene, without that of the coupling."""
    return (motion_source_part(scene), SOIL) if scene.soil is not None else (motion_source_part(scene),)


@dataclass(frozen=True, slots=True)
class StopState:
    """All that later checks depend on: the means of the bins that are full, and the bin that is not."""

    means: tuple[float, ...] = ()  # of the metric, one a bin
    total: float = 0.0  # of the metric over the ticks of the bin that is not full
    count: int = 0  # ticks in that bin
    started: bool = False  # the metrics window has begun
    ended: bool = False  # it is over
    start_m: float | None = None  # tip at the end of the first tick; None: before it
    travel_m: float = 0.0  # of the tip since then
    stops: bool = False  # a check has ended the run

    @classmethod
    def of(cls, document: Document) -> "StopState":
        """The state in a checkpoint."""
        return cls(**{**document, "means": tuple(document["means"])})


@dataclass(frozen=True)
class CouplingState:
    """The exchange at the end of a tick."""

    tick: int
    motions: tuple[ToolMotion, ...]
    wrenches: tuple[ToolWrench, ...]
    work: InterfaceWork
    wall_time_s: float = 0.0  # since tick 0, earlier runs included
    stopping: StopState | None = None  # of a scene with stop_when

    def document(self) -> Document:
        """The state as JSON, from which every number is read back bit for bit; without the wall time."""
        document = {
            "motions": [asdict(motion) for motion in self.motions],
            "wrenches": [asdict(wrench) for wrench in self.wrenches],
            "work": asdict(self.work),
        }
        if self.stopping is not None:
            document["stopping"] = asdict(self.stopping)
        return document

    @classmethod
    def of(cls, checkpoint: Checkpoint) -> "CouplingState":
        """The state in a checkpoint."""
        document = checkpoint.coupling
        return cls(
            checkpoint.tick,
            tuple(map(_motion, document["motions"])),
            tuple(_wrench(wrench) for wrench in document["wrenches"]),
            InterfaceWork(**document["work"]),
            document["wall_time_s"],
            StopState.of(document["stopping"]) if "stopping" in document else None,
        )


def _motion(document: Document) -> ToolMotion:
    return SpatialMotion(**document) if math.isnan(document["angle_rad"]) else ToolMotion(**document)


def _wrench(document: Document) -> ToolWrench:
    groups = tuple(FacetGroupForce(**group) for group in document["groups"])
    return ToolWrench(**{**document, "groups": groups})


def restore_engine(engine: Resumable, checkpoint: Checkpoint, part: str) -> None:
    """Restore the state of a checkpoint in an engine that was just built.

    Raises:
        InputError: the part is damaged, or does not fit the engine.
    """
    try:
        engine.restore(checkpoint.read_part(part))
    except (KeyError, ValueError) as error:
        raise InputError(f"{checkpoint.path}: {part}: does not fit this scene: {error}") from error


class CheckpointWriter:
    """Writes the checkpoints of one run, or one process's parts of them.

    Args:
        directory: folder of the checkpoints of the run.
        sync_record: writes the record to the disk, up to the tick of a checkpoint, before that is valid.
    """

    def __init__(
        self,
        directory: Path,
        resolved: ResolvedScene,
        run_id: str,
        sync_record: Callable[[], None] = lambda: None,
    ) -> None:
        self.directory = directory
        self.last_tick = INITIAL_TICK  # of the newest checkpoint that is valid
        self._resolved, self._run_id, self._sync_record = resolved, run_id, sync_record
        self._names = part_names(resolved.scene)

    def keep(self, tick: int, part: str, engine: Resumable) -> None:
        """Write the part of an engine that has finished `tick`.

        Raises:
            RecordingError: the disk cannot be written.
        """
        write_part(self.directory, tick, part, engine.state_arrays())

    def all_kept(self, tick: int) -> bool:
        """Whether every part of the checkpoint of `tick` is written."""
        return has_parts(self.directory, tick, self._names)

    def commit(self, state: CouplingState) -> None:
        """Make the checkpoint of a tick valid, once its parts are on the disk.

        Raises:
            RecordingError: the disk cannot be written.
        """
        self._sync_record()
        facts = {
            "time_s": tick_end_s(state.tick, self._resolved.timing.communication_step_ns),
            "run_id": self._run_id,
            "scene_hash": self._resolved.scene_hash,
            COUPLING: {**state.document(), "wall_time_s": state.wall_time_s},
        }
        commit(self.directory, state.tick, self._names, facts)
        self.last_tick = state.tick

    def note_end(self, tick: int, part: str, engine: Resumable) -> None:
        """Write the digest of an engine's state at the end of the run."""
        note_end(self.directory, tick, part, state_sha256(engine.state_arrays()))

    def note_coupling_end(self, state: CouplingState) -> None:
        """Write the digest of the exchange's state at the end of the run."""
        note_end(self.directory, state.tick, COUPLING, document_sha256(state.document()))
