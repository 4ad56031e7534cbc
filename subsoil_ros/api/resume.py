"""Checkpoints in the folder of a run: find them, name them, resume from them."""

from pathlib import Path

from ..errors import InputError, RecordingError, SubsoilError
from ..loading.loader import ResolvedScene
from ..recording.bag_reader import BagReader
from ..recording.checkpoint import Checkpoint, end_digests, newest_valid
from ..recording.joined import Resumption
from ..recording.recovery import last_time_ns
from ..scene.controller import External
from ..ticks import tick_end_ns
from ..yaml_document import Document

CHECKPOINTS = "checkpoints"
"""Folder of the checkpoints in the folder of a run."""


def find_checkpoint(directory: Path, resolved: ResolvedScene) -> tuple[Checkpoint, list[str]]:
    """The newest checkpoint of the run in `directory` that can be used, and why newer ones cannot.

    Raises:
        InputError: there is none for this scene.
    """
    controller = resolved.scene.controller
    if controller is not None and isinstance(controller.law, External):
        raise InputError(
            f"resume {directory}: controller.law 'external' is a node of its own, whose state is in no "
            "checkpoint; run the scene from the start"
        )
    if not directory.is_dir():
        raise InputError(f"resume {directory}: no such folder; name one that `subsoil run` made")
    try:
        last_tick = None
        if resolved.scene.record.bag:
            last_tick = _last_time_ns(directory / "bag") // resolved.timing.communication_step_ns - 1
        checkpoint, refusals = newest_valid(directory / CHECKPOINTS, resolved.scene_hash, last_tick)
    except InputError as error:
        raise InputError(f"resume {error}") from error
    return checkpoint, [f"{refusal}; using {checkpoint.path.name}" for refusal in refusals]


def _last_time_ns(bag: Path) -> int:
    try:
        return BagReader(bag).end_time_ns
    except RecordingError:
        return last_time_ns(bag)  # its writer was killed


def note_resumption(checkpoint: Checkpoint, earlier: Path, resolved: ResolvedScene, out: Path) -> None:
    """Write into the new folder which checkpoint its run resumes from."""
    Resumption(
        str(earlier.resolve()),
        str(checkpoint.path),
        checkpoint.tick,
        tick_end_ns(checkpoint.tick, resolved.timing.communication_step_ns),
        checkpoint.run_id,
    ).write(out)


def checkpoint_facts(out: Path, resumed: Checkpoint | None) -> Document:
    """Entries of a summary about checkpoints and the state at the end of the run."""
    facts: Document = {}
    if resumed is not None:
        facts["resumed_from"] = {
            "checkpoint": str(resumed.path),
            "tick": resumed.tick,
            "run_id": resumed.run_id,
        }
    newest = _newest(out)
    if newest is not None:
        facts["checkpoint"] = {
            "path": str(newest.path),
            "tick": newest.tick,
            "time_s": newest.time_s,
            "size_bytes": newest.size_bytes,
            "write_s": sum(part["write_s"] for part in newest.parts.values()),
        }
    digests = end_digests(out / CHECKPOINTS)
    if digests:
        facts["state_sha256"] = digests
    return facts


def name_checkpoint(failure: SubsoilError, out: Path, resumed: Checkpoint | None) -> None:
    """Add to the message of a failed run the checkpoint that it can resume from."""
    newest, directory = _newest(out), out
    if newest is None and resumed is not None:
        newest, directory = resumed, resumed.path.parent.parent
    if newest is not None:
        failure.args = (
            f"{failure}; checkpoint: {newest.path} (at {newest.time_s:.6g} s), go on from it with "
            f"--resume {directory}",
        )


def _newest(out: Path) -> Checkpoint | None:
    try:
        return newest_valid(out / CHECKPOINTS)[0]
    except InputError:
        return None
