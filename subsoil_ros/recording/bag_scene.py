"""The scene in a bag: as run, with its meshes, under the hash of the run."""

from pathlib import Path

from mcap.reader import make_reader

from ..errors import InputError, SceneError
from ..loading.loader import ResolvedScene
from ..loading.scene_bundle import SCENE_FILE, SceneBundle, unpack_to_show
from .bag_folder import BROKEN, NOTES
from .bag_reader import damaged, mcap_path

_HASH = "scene_hash"


def scene_attachments(bundle: SceneBundle | None) -> dict[str, bytes]:
    """The files of a bag's attachments by name."""
    return {} if bundle is None else {SCENE_FILE: bundle.text.encode(), **bundle.files}


def scene_notes(bundle: SceneBundle | None) -> dict[str, str]:
    """Notes on the scene in a bag's metadata."""
    return {} if bundle is None else {_HASH: bundle.scene_hash}


def read_scene(bag: Path, folder: Path) -> ResolvedScene:
    """The scene that a bag was recorded from; its files are written into `folder`, which must exist.

    A saved bed is not in a bag: a scene that has one can be shown, but not run again.

    Raises:
        InputError: there is no bag, or it contains no scene.
        SceneError: this version cannot read the scene.
        RecordingError: the bag was not closed, or is damaged.
    """
    path = mcap_path(bag)
    try:
        with path.open("rb") as stream:
            reader = make_reader(stream)
            if reader.get_summary() is None:
                raise damaged(path, "it has no index")
            files = {item.name: item.data for item in reader.iter_attachments()}
            notes = {record.name: record.metadata for record in reader.iter_metadata()}.get(NOTES, {})
    except BROKEN as error:
        raise damaged(path, error) from error
    if SCENE_FILE not in files or _HASH not in notes:
        raise InputError(
            f"{path}: it contains no scene, as bags of `subsoil run` do; name the folder of its run, "
            "which has a scene.yaml"
        )
    text = files.pop(SCENE_FILE).decode(errors="replace")
    plain = {name: data for name, data in files.items() if Path(name).name == name}  # none beside `folder`
    try:
        return unpack_to_show(SceneBundle(text, plain, notes[_HASH]), folder)
    except SceneError as error:
        raise SceneError(f"{path}: the scene in it: {error}") from error
