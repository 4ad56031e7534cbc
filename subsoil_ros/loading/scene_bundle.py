"""A scene to send to a worker or store in a bag: its text and the content of its files, without paths."""

from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import SceneError
from ..yaml_document import dump_yaml
from .files import map_files
from .loader import ResolvedScene, load_scene

SCENE_FILE = "scene.yaml"
"""Name of the text; the files are called 0.stl, 1.stl, ... in the order in which the scene names them."""


@dataclass(frozen=True)
class SceneBundle:
    """Scene and files; the unpacked scene has the same hash."""

    text: str  # YAML; files by name in `files`
    files: dict[str, bytes]
    scene_hash: str


def pack(scene: ResolvedScene, with_bed: bool = True) -> SceneBundle:
    """A resolved scene as a bundle.

    with_bed: if false, a saved bed becomes an empty file: the scene can be shown, but not run again.

    Raises SceneError where one of its files was removed after it was loaded.
    """
    files: dict[str, bytes] = {}
    names: dict[str, str] = {}  # by absolute path
    document = dict(scene.document)
    soil = document.get("soil")
    if isinstance(soil, dict) and "fitted_to" in soil:  # was checked when the scene was loaded
        document["soil"] = soil = {key: value for key, value in soil.items() if key != "fitted_to"}
    bed = soil.get("bed") if isinstance(soil, dict) else None
    left_out = bed.get("file") if isinstance(bed, dict) and not with_bed else None

    def take(path: str) -> str:
        if path not in names:
            names[path] = f"{len(names)}{Path(path).suffix}"
            try:
                files[names[path]] = b"" if path == left_out else Path(path).read_bytes()
            except OSError as error:
                raise SceneError(f"{path}: cannot be read any more ({error.strerror})") from error
        return names[path]

    return SceneBundle(dump_yaml(map_files(document, take)), files, scene.scene_hash)


def unpack(bundle: SceneBundle, folder: Path) -> ResolvedScene:
    """The scene of a bundle, its files in `folder`. Raises SceneError if its hash differs."""
    scene = _written(bundle, folder)
    if scene.scene_hash != bundle.scene_hash:
        raise SceneError(
            f"the worker reads another scene (hash {scene.scene_hash[:16]}) than was sent "
            f"({bundle.scene_hash[:16]}): it has another version of subsoil_ros; install the same there"
        )
    return scene


def unpack_to_show(bundle: SceneBundle, folder: Path) -> ResolvedScene:
    """The scene of a bundle, its files in `folder`, under the hash that it was run with.

    It may be without its bed, or from another version. Raises SceneError if this version cannot read it.
    """
    return replace(_written(bundle, folder), scene_hash=bundle.scene_hash)


def _written(bundle: SceneBundle, folder: Path) -> ResolvedScene:
    for name, content in bundle.files.items():
        (folder / name).write_bytes(content)
    path = folder / SCENE_FILE
    path.write_text(bundle.text, encoding="utf-8")
    return load_scene(path)
