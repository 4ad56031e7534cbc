"""Load a scene."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path

from ..errors import InputError
from ..loading import loader
from ..loading.loader import ResolvedScene

SceneLike = str | PathLike[str] | Mapping[str, object]
"""A scene as callers give it: the name of a shipped scene, a file (.yaml), or a document."""


def load_scene(scene: SceneLike, overrides: Mapping[str, object] | None = None) -> ResolvedScene:
    """Load, merge and validate a scene.

    Args:
        scene: the name of a shipped scene (`"tine"`), the path of a scene file, or a document: the content of
            such a file as a dict. Files that a document names are seen from the working folder.
        overrides: values by dotted key, as `{"soil.bed.seed": 3}`, laid over the scene as `--set` does; None
            as a value removes a key, "start" chooses a start and "preset" a preset.

    Returns:
        The scene with its defaults, meshes and time steps checked: `.scene` (the typed model), `.timing`
        (tick [ns], ticks, steps per tick), `.document` (as run), `.scene_hash`, `.notes`.

    Raises:
        SceneError: the file, the document or an override is wrong; each line names the place, what was given
            and what is allowed.
    """
    if not isinstance(scene, str | PathLike | Mapping):
        raise InputError(
            f"scene: given a {type(scene).__name__}; give the name of a shipped scene, a path or a document"
        )
    given = dict(scene) if isinstance(scene, Mapping) else Path(scene)
    return loader.load_scene(given, overrides or {})


def resolved_scene(scene: SceneLike | ResolvedScene, overrides: Mapping[str, object] | None) -> ResolvedScene:
    """The scene itself if it has been loaded, else as load_scene.

    Raises:
        InputError: as load_scene, or there are overrides of a loaded scene.
    """
    if not isinstance(scene, ResolvedScene):
        return load_scene(scene, overrides)
    if overrides:
        raise InputError("overrides: the scene has been loaded already; give them to load_scene")
    return scene
