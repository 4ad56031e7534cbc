"""The record of a run: its folder, or a bag without its run."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..loading.loader import ResolvedScene, load_scene
from ..recording.bag_folder import mcap_file
from ..recording.bag_lock import writer_of
from ..recording.bag_scene import read_scene
from ..recording.joined import mend_earlier
from ..recording.recovery import forget_copies


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
    directory = _folder_of_run(path)
    if directory is not None:
        resolved = load_scene(directory / "scene.yaml")
        mend_earlier(directory)
        bag = directory / "bag"
        if list(bag.glob("*.mcap")) and writer_of(mcap_file(bag)):  # its own results are still to come
            directory = directory.with_name(f"{directory.name}_so_far")
        try:
            yield RecordedRun(directory, bag, resolved)
        finally:
            forget_copies()
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
