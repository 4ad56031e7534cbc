"""Resumed runs: each folder names that of the run before, and their bags are read as one."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError, RecordingError
from ..messages import SoilCloud
from .bag_reader import BagReader
from .recovery import recover

_FILE = "resumed_from.json"


@dataclass(frozen=True)
class Resumption:
    """Point at which a run was resumed; its file is in the folder from the start."""

    directory: str  # of the earlier run, absolute
    checkpoint: str  # folder of the checkpoint in it
    tick: int  # the last of the earlier run that counts
    end_time_ns: int  # of that tick
    run_id: str  # of the earlier run

    def write(self, directory: Path) -> None:
        """Write it into the folder of the resumed run."""
        (directory / _FILE).write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")


def read_resumption(directory: Path) -> Resumption | None:
    """Read where the run in `directory` was resumed; None if it began at tick 0.

    Raises:
        InputError: the file is damaged.
    """
    path = directory / _FILE
    try:
        return Resumption(**json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"{path}: cannot be read ({error}); it names the run that this one went on from"
        ) from error


class JoinedBags:
    """Several bags read as one, each but the last up to the time at which the next one continues."""

    def __init__(self, pieces: list[tuple[BagReader, int | None]]) -> None:
        """pieces: the bags in order, each with the last time [ns] that counts; None: all of it."""
        self.path = pieces[-1][0].path
        self._pieces = pieces

    def records(self, *kinds: type, at: Callable[[int], bool] | None = None) -> Iterator[Any]:
        """As BagReader.records."""
        for reader, wanted in self._wanted(at):
            yield from reader.records(*kinds, at=wanted)

    def clouds(
        self, communication_step_ns: int, at: Callable[[int], bool] | None = None
    ) -> Iterator[SoilCloud]:
        """As BagReader.clouds."""
        for reader, wanted in self._wanted(at):
            yield from reader.clouds(communication_step_ns, at=wanted)

    @property
    def end_time_ns(self) -> int:
        """As BagReader.end_time_ns."""
        return self._pieces[-1][0].end_time_ns

    def cloud_times_ns(self) -> list[int]:
        """As BagReader.cloud_times_ns."""
        return [
            time_ns
            for reader, end_ns in self._pieces
            for time_ns in reader.cloud_times_ns()
            if end_ns is None or time_ns <= end_ns
        ]

    def _wanted(
        self, at: Callable[[int], bool] | None
    ) -> Iterator[tuple[BagReader, Callable[[int], bool] | None]]:
        for reader, end_ns in self._pieces:
            yield reader, at if end_ns is None else _until(end_ns, at)


def _until(end_ns: int, at: Callable[[int], bool] | None) -> Callable[[int], bool]:
    return lambda time_ns: time_ns <= end_ns and (at is None or at(time_ns))


def earlier_runs(directory: Path) -> list[tuple[Path, Resumption]]:
    """Folders of the runs before the one in `directory`, latest first, and where each was left.

    Raises:
        InputError: one of them does not exist any more.
    """
    found: list[tuple[Path, Resumption]] = []
    while (resumption := read_resumption(directory)) is not None:
        earlier = Path(resumption.directory)
        if not earlier.is_dir():
            raise InputError(
                f"{earlier}: is not there, and the run in {directory} went on from it; bring it back, or "
                f"write its new place into {directory / _FILE}"
            )
        found.append((earlier, resumption))
        directory = earlier
    return found


def open_record(bag: Path) -> BagReader | JoinedBags:
    """Open the bag of a run; of a resumed one, together with the bags of the runs before it.

    Raises:
        InputError: there is no bag, or an earlier run is missing.
        RecordingError: a bag is damaged.
    """
    earlier = earlier_runs(bag.parent)
    if not earlier:
        return BagReader(bag)
    pieces: list[tuple[BagReader, int | None]] = [
        (BagReader(folder / "bag"), resumption.end_time_ns) for folder, resumption in reversed(earlier)
    ]
    return JoinedBags([*pieces, (BagReader(bag), None)])


def recover_earlier(directory: Path) -> None:
    """Recover the bags of earlier runs whose writers were killed."""
    for folder, _ in earlier_runs(directory):
        try:
            BagReader(folder / "bag")
        except RecordingError:
            recover(folder / "bag")
