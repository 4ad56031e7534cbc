"""Changes to a scene document: `a.b.c=value` texts of the command line, or values by dotted path."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..errors import SceneError
from ..scene.scene import Scene
from ..yaml_document import Document, merge, parse_yaml, plain_value
from .validation import LOADER_KEYS, is_model, item_annotation, known_keys, members, model_at, suggestion


@dataclass(frozen=True)
class Override:
    """One change: the dotted path as written and the value as parsed from YAML."""

    path: str
    value: object
    given_by: str = "--set"

    @property
    def source(self) -> str:
        """Name of the override in errors."""
        by_flag = self.path == "preset" and self.given_by == "--set"
        return "--preset" if by_flag else f"{self.given_by} {self.path}"


def parse_overrides(texts: Sequence[str]) -> list[Override]:
    """Parse "a.b.c=value" texts, the value as YAML. Raises SceneError for a text of another form."""
    found = []
    for text in texts:
        path, equals, value = text.partition("=")
        path = path.strip()
        if not equals or not path or not value.strip() or not all(path.split(".")):
            raise SceneError(
                f"--set {text}: given '{text}'; it must be KEY.KEY=VALUE, for example soil.bed.seed=3"
            )
        found.append(Override(path, parse_yaml(value, f"--set {path}")))
    return found


def overrides_of(changes: Mapping[str, object]) -> list[Override]:
    """Overrides from values by dotted path. Raises SceneError for an invalid path or value."""
    found = []
    for path, value in changes.items():
        if not isinstance(path, str) or not all(path.split(".")):
            raise SceneError(f"overrides: given the key {path!r}; it must be KEY.KEY, as 'soil.bed.seed'")
        override = Override(path, value, "overrides:")
        found.append(replace(override, value=plain_value(value, override.source)))
    return found


def apply_override(document: Document, override: Override) -> Document:
    """A new document with the override laid over it. Raises SceneError for an unknown path."""
    return merge(document, as_fragment(document, override), override.source)


def as_fragment(document: Document, override: Override) -> Document:
    """The override as a part of a document. Raises SceneError for an unknown path."""
    fragment: Any = override.value
    for key in reversed(_split(document, override)):
        fragment = {key: fragment}
    return dict(fragment)


def _split(document: Document, override: Override) -> list[str]:
    """The keys of an override's path, each checked against the model and the names in the document."""
    rest = override.path.split(".")
    if rest[0] in LOADER_KEYS:
        raise SceneError(
            f"{override.source}: '{rest[0]}' cannot be set; choose one of them by "
            f"{'preset' if rest[0] == 'presets' else 'initial_condition'}=NAME"
        )
    keys: list[str] = []
    annotation: object = Scene
    value: object = document
    while rest:
        here = ".".join(keys)
        if isinstance(value, list):
            raise SceneError(f"{override.source}: '{here}' is a list; give all of it, as {here}=[...]")
        model = model_at(annotation, value)
        item = item_annotation(annotation)
        if model is None and item is None:
            needs_kind = any(map(is_model, members(annotation)))
            reason = "is not there yet; give it with its 'kind'" if needs_kind else "has no keys below it"
            raise SceneError(f"{override.source}: '{here}' {reason}")
        named_numbers = model is None and not any(map(is_model, members(item)))
        key = ".".join(rest) if named_numbers else rest[0]  # initial.coordinates has dots in its names
        known = known_keys(annotation, value)
        if keys == ["soil"]:
            known.append("material")  # of the loader
            if rest == ["material"]:
                return [*keys, *rest]
        new_part = model is None and rest == [key] and isinstance(override.value, dict)  # a whole one
        if key not in known and not named_numbers and not new_part:
            raise SceneError(
                f"{override.source}: no key '{key}'{f' in {here}' if here else ''}; {suggestion(key, known)}"
            )
        annotation = item if model is None else model.model_fields[key].annotation
        value = value.get(key) if isinstance(value, dict) else None
        keys.append(key)
        rest = [] if named_numbers else rest[1:]
    return keys


def origin(path: str, overrides: Sequence[Override]) -> str:
    """' (given by --set ...)' for a path that an override has changed, for errors."""
    for override in reversed(overrides):
        within = f"{path}.".startswith(f"{override.path}.")
        if within or f"{override.path}.".startswith(f"{path}."):
            return f" (given by {override.source})"
    return ""
