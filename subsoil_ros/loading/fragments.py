"""Parts of scene files that are laid over each other: base, initial conditions, presets.

`base: FILE` names a scene that this one is laid over (mappings merge, anything else replaces, null removes).
`initial_conditions` holds fragments by name; `initial_condition` names the one that is laid over the rest.
`presets` holds more of them, each with what a study measured of it, and `preset` names the one that is laid
over all that, if any.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from ..errors import SceneError
from ..yaml_document import Document, merge, plain_value, read_document
from .files import shipped_names, with_absolute_files
from .overrides import Override
from .validation import suggestion


def with_base(path: Path, shown: str, above: tuple[Path, ...], given: Document | None = None) -> Document:
    """The document of a file, or a given one as if it stood there, laid over its base.

    An initial condition or a preset replaces the base's of the same name; `initial_conditions: null` and
    `presets: null` drop those of the base. What was measured of a preset holds for the scene it stands in, so
    it is not inherited.
    """
    resolved = path.resolve()
    if resolved in above:
        raise SceneError(f"{shown}: base: the files name each other as base; remove one 'base'")
    if given is None and not path.suffix and path.parent == Path() and not path.exists():
        near = suggestion(path.name, shipped_names("scenes"))
        raise SceneError(f"{shown}: no such file, and no scene that is shipped; {near}")
    document = read_document(path, shown) if given is None else plain_value(given, shown)
    assert isinstance(document, dict)
    document = _soil_by_name(document)

    def absolute(fragment: Document) -> Document:
        return with_absolute_files(fragment, resolved.parent)

    def absolute_preset(preset: Document) -> Document:
        changes = preset.get("changes")
        return {**preset, "changes": absolute(changes)} if isinstance(changes, dict) else preset

    own = {
        "initial_conditions": _fragments(document, "initial_conditions", shown, absolute),
        "presets": _fragments(document, "presets", shown, absolute_preset),
    }
    dropped = [section for section in own if section in document and not document[section]]
    base = document.pop("base", None)
    merged = absolute({key: value for key, value in document.items() if key not in own})
    inherited: dict[str, Document] = {"initial_conditions": {}, "presets": {}}
    if base is not None:
        if not isinstance(base, str):
            raise SceneError(f"{shown}: base: given {base!r}; it must be the name of another scene file")
        below = with_base(path.parent / base, f"{shown}: base: {path.parent / base}", (*above, resolved))
        inherited = {section: below.pop(section, {}) for section in own}
        inherited["presets"] = {
            name: {key: value for key, value in preset.items() if key != "expected"}
            for name, preset in inherited["presets"].items()
        }
        merged = merge(below, merged, shown)
    for section, fragments in own.items():
        together = {**({} if section in dropped else inherited[section]), **fragments}
        if together:
            merged = {**merged, section: together}
    return merged


def _soil_by_name(document: Document) -> Document:
    """The document with `soil: NAME` in full."""
    soil = document.get("soil")
    return {**document, "soil": {"material": soil}} if isinstance(soil, str) else document


def _fragments(
    document: Document, section: str, shown: str, change: Callable[[Document], Document]
) -> dict[str, Document]:
    """The named fragments of a section, each changed; empty ones are {}."""
    found = document.get(section) or {}
    if not isinstance(found, dict) or not all(
        fragment is None or isinstance(fragment, dict) for fragment in found.values()
    ):
        raise SceneError(f"{shown}: {section}: must be a mapping of names, each with the keys it changes")
    return {name: change(fragment or {}) for name, fragment in found.items()}


def with_initial_condition(document: Document, shown: str, changes: Sequence[Override]) -> Document:
    """The document with its chosen initial condition laid over it and no other one left in it."""
    known = document.get("initial_conditions", {})
    name = _chosen(document, shown, changes, "initial_condition", known, "initial_conditions")
    if name is None:
        if known:
            raise SceneError(f"{shown}: initial_condition: is missing; choose one of {', '.join(known)}")
        return document
    rest = {key: value for key, value in document.items() if key != "initial_conditions"}
    merged = merge(rest, known[name], f"{shown}: initial_conditions.{name}")
    return {**merged, "initial_condition": name, "initial_conditions": {name: {}}}


def with_preset(
    document: Document, shown: str, changes: Sequence[Override], of_material: Iterable[str]
) -> Document:
    """The document with its chosen preset laid over it; without a choice it stays as it is written.

    of_material: names of the presets of a material, for errors: the one that fits is in the document.
    """
    presets = document.get("presets", {})
    soil = document.get("soil")
    named = dict(presets)
    if isinstance(soil, dict) and soil.get("material"):
        named |= dict.fromkeys(of_material)
    name = _chosen(document, shown, changes, "preset", named, "presets")
    rest = {key: value for key, value in document.items() if key != "presets"}
    if name is None:
        return rest
    merged = merge(rest, presets[name].get("changes") or {}, f"{shown}: presets.{name}.changes")
    left = {key: value for key, value in presets[name].items() if key != "changes"}
    return {**merged, "preset": name, "presets": {name: left}}


def _chosen(
    document: Document, shown: str, changes: Sequence[Override], key: str, named: Document, section: str
) -> str | None:
    """The fragment in `section` that the last of `changes` names, or else `key` in the file."""
    name = changes[-1].value if changes else document.get(key)
    where = changes[-1].source if changes else f"{shown}: {key}"
    if name is None:
        return None
    if not isinstance(name, str) or name not in named:
        known = f"; {suggestion(str(name), named)}" if named else f"; the scene has no '{section}'"
        raise SceneError(f"{where}: no {key.replace('_', ' ')} '{name}'{known}")
    return name
