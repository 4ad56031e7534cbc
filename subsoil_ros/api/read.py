"""Read a run back: its scene, series and summary, from its folder or from a bag without its run."""

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ..analysis.series import Series, read_series, read_series_csv
from ..analysis.summarize import summarize
from ..analysis.summary import SCHEMA_VERSION
from ..errors import InputError
from ..loading.loader import ResolvedScene, load_scene
from ..recording.bag_folder import mcap_file
from ..recording.bag_lock import writer_of
from ..recording.bag_reader import read_scene
from ..recording.joined import recover_earlier
from ..recording.recovery import forget_copies
from ..yaml_document import Document
from .resume import checkpoint_facts

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class RecordedRun:
    """Bag and scene of a run.

    directory: folder of the results; for a bag alone it may not exist yet. bag: folder or .mcap file.
    """

    directory: Path
    bag: Path
    resolved: ResolvedScene

    def make_directory(self) -> None:
        """The folder of the results. Raises InputError if it cannot be made."""
        try:
            self.directory.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(
                f"{self.directory}: cannot be made ({error.strerror}), and the results of {self.bag} go "
                "there; copy the bag to where there is room"
            ) from error


@contextmanager
def recorded_run(path: Path) -> Iterator[RecordedRun]:
    """Context of the run in the folder `path`, or of the bag `path`; it keeps the files of the scene.

    Raises:
        InputError: there is neither, or the bag holds no scene.
        RecordingError: the bag was not closed, or is damaged.
    """
    forget_copies()
    directory = _folder_of_run(path)
    if directory is not None:
        resolved = load_scene(directory / "scene.yaml")
        recover_earlier(directory)
        bag = directory / "bag"
        if list(bag.glob("*.mcap")) and writer_of(mcap_file(bag)):  # its own results are still to come
            directory = directory.with_name(f"{directory.name}_so_far")
        yield RecordedRun(directory, bag, resolved)
        return
    try:
        file = mcap_file(path).resolve()
    except InputError as error:
        raise InputError(f"{error} (it is no folder of a run: it has no scene.yaml)") from error
    whole = file.parent if (file.parent / "metadata.yaml").is_file() else file.with_suffix("")
    with tempfile.TemporaryDirectory(prefix="subsoil-scene-") as folder:
        yield RecordedRun(whole.with_name(f"{whole.name}_report"), file, read_scene(file, Path(folder)))


def _folder_of_run(path: Path) -> Path | None:
    """The folder of a run, given by itself, by its bag, or by the file in the bag."""
    for folder in (path, *path.resolve().parents[:2]):
        if (folder / "scene.yaml").is_file() and (folder == path or path.resolve() in _bags(folder)):
            return folder
    return None


def _bags(run: Path) -> list[Path]:
    return [run / "bag", *(run / "bag").glob("*.mcap")]


@dataclass(frozen=True, repr=False, eq=False)
class Run:
    """A run that has ended.

    Attributes:
        scene: the scene as run.
        summary: metrics of the run, as summary.json holds them; numbers that are not finite are None.
        folder: where the run was written or read; None of a run in memory.
    """

    scene: ResolvedScene
    summary: Document
    folder: Path | None
    _recorded: Series | None

    @cached_property
    def series(self) -> "pd.DataFrame":
        """One row per series tick; the unit stands in each column's name, the first column is `time_s`.

        Raises:
            InputError: nothing was recorded.
        """
        if self._recorded is None:
            raise InputError(
                f"{self.scene.scene.name}: nothing was recorded (record.bag: false), so there is no "
                "series; run it with record.bag: true"
            )
        import pandas as pd

        return pd.DataFrame(self._recorded.columns)

    @property
    def failure(self) -> str | None:
        """Why the run ended early; None if it came to its end."""
        message = self.summary["run"].get("failure")
        return None if message is None else str(message)

    def __repr__(self) -> str:
        place = "in memory" if self.folder is None else str(self.folder)
        ended = (
            "complete"
            if self.summary["run"]["complete"]
            else f"ended early: {self.failure or 'no reason known'}"
        )
        return f"<Run of '{self.scene.scene.name}', {place}, {ended}>"


def read_run(folder: str | PathLike[str]) -> Run:
    """Read a run back.

    series.csv and summary.json are read where they exist in the folder of a run that has ended, and made from
    the bag otherwise. The meshes of a bag without its run are not kept on the disk: its scene can be read,
    but not run again.

    Args:
        folder: of a run, as `run` or `subsoil run` left it; or a bag alone (its folder or .mcap file).

    Returns:
        The run.

    Raises:
        InputError: there is no run, or a file in it is damaged.
        RecordingError: its bag is needed, and was not closed or is damaged; the message names the remedy.
    """
    path = Path(folder)
    if not path.exists():
        raise InputError(f"{path}: no such folder; give one that `subsoil run` made, or a bag")
    with recorded_run(path) as recorded:
        kept = (
            recorded.directory / "scene.yaml"
        ).is_file()  # else those of a report may be of an earlier bag
        summary = _summary(recorded.directory / "summary.json") if kept else None
        if summary is not None and not summary["run"]["recorded"]:
            return Run(recorded.resolved, summary, recorded.directory, None)
        path = recorded.directory / "series.csv"
        found = kept and path.is_file()
        series = read_series_csv(path) if found else read_series(recorded.bag, recorded.resolved.scene)
        if summary is None:
            facts = checkpoint_facts(recorded.directory, None)
            summary = summarize(recorded.bag, recorded.resolved, facts, series).document()
        place = recorded.directory if recorded.directory.is_dir() else None
        return Run(recorded.resolved, summary, place, series)


def _summary(path: Path) -> Document | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read ({error}); `subsoil report {path.parent}` writes it anew from the bag"
        ) from error
    if not isinstance(found, dict) or found.get("schema_version") != SCHEMA_VERSION:
        raise InputError(
            f"{path}: is no summary of schema_version {SCHEMA_VERSION}; "
            f"`subsoil report {path.parent}` writes it anew from the bag"
        )
    return found
