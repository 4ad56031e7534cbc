"""Settings of one run, in every mode: the direct loop and all nodes get the same object."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..loading.loader import ResolvedScene
from ..recording.checkpoint import Checkpoint
from ..schedule import Schedule
from .checkpoints import CheckpointWriter
from .protocol import RECORDER, participants
from .run_options import RunOptions


@dataclass(frozen=True)
class RunSettings(RunOptions):
    """Settings of one run, its options among them, the same for all of its nodes."""

    resolved: ResolvedScene
    run_id: str = "run"
    bag: Path | None = None  # folder to create; None: no bag
    checkpoints: Path | None = None  # folder for them; None: none are written
    resumed: Checkpoint | None = None  # to continue from; None: start at tick 0
    recorded: bool = True  # whether the nodes of the run have a recorder among them
    live_port: int = 0  # of a live view of the bag while it is written; 0: there is none
    supervised: bool = False  # a supervisor holds the standard input of every node

    @property
    def participants(self) -> tuple[str, ...]:
        """The nodes of the run beside the coupler."""
        names = participants(self.resolved.scene)
        return names if self.recorded else tuple(name for name in names if name != RECORDER)

    @property
    def schedule(self) -> Schedule:
        """What is due at each tick, from the first one of this run."""
        first_tick = self.resumed.tick + 1 if self.resumed is not None else 0
        return self.resolved.schedule.begins_with(first_tick)

    def checkpoint_writer(self, sync_record: Callable[[], None] = lambda: None) -> CheckpointWriter | None:
        """Create the writer of checkpoints, or of a node's part of them; None: there are none.

        sync_record: as CheckpointWriter takes it.
        """
        if self.checkpoints is None:
            return None
        return CheckpointWriter(self.checkpoints, self.resolved, self.run_id, sync_record)
