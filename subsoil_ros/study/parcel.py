"""A scene as it travels to a worker: its text and the bytes of its files; nothing is shared but code."""

from dataclasses import dataclass
from pathlib import Path

from ..errors import SceneError
from ..scene.document import dump_yaml
from ..scene.files import map_files
from ..scene.loader import ResolvedScene, load_scene


@dataclass(frozen=True)
class Parcel:
    """Scene and files; unpacked, they have the same hash."""

    text: str  # YAML; files by name in `files`
    files: dict[str, bytes]
    scene_hash: str


def pack(scene: ResolvedScene) -> Parcel:
    """A resolved scene as a parcel. Raises SceneError where one of its files has gone since it was loaded."""
    files: dict[str, bytes] = {}
    names: dict[str, str] = {}  # by absolute path

    def take(path: str) -> str:
        if path not in names:
            names[path] = f"{len(names)}{Path(path).suffix}"
            try:
                files[names[path]] = Path(path).read_bytes()
            except OSError as error:
                raise SceneError(f"{path}: cannot be read any more ({error.strerror})") from error
        return names[path]

    document = dict(scene.document)
    soil = document.get("soil")
    if isinstance(soil, dict) and "stands_for" in soil:  # was checked when the scene was loaded
        document["soil"] = {key: value for key, value in soil.items() if key != "stands_for"}
    return Parcel(dump_yaml(map_files(document, take)), files, scene.scene_hash)


def unpack(parcel: Parcel, folder: Path) -> ResolvedScene:
    """The scene of a parcel, its files in `folder`. Raises SceneError if it is another."""
    for name, content in parcel.files.items():
        (folder / name).write_bytes(content)
    path = folder / "scene.yaml"
    path.write_text(parcel.text, encoding="utf-8")
    scene = load_scene(path)
    if scene.scene_hash != parcel.scene_hash:
        raise SceneError(
            f"the worker reads another scene (hash {scene.scene_hash[:16]}) than was sent "
            f"({parcel.scene_hash[:16]}): it has another version of subsoil_ros; install the same there"
        )
    return scene
