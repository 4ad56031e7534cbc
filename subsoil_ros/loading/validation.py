"""Validation of documents; error lines have the place, what was given, what is allowed, what to do."""

import difflib
import json
import re
import types
from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, TypeGuard, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from ..contact_laws.registry import unusable_laws
from ..errors import SceneError
from ..scene.scene import Scene
from ..yaml_document import Document

CHOICES = {"initial_condition": "initial_conditions", "preset": "presets"}
"""Keys that name a fragment, and where the fragments stand."""

LOADER_KEYS = ("base", *CHOICES, *CHOICES.values())
"""Keys of a scene file that the loader itself reads; the scene model never sees them."""

SHOWN_COUNT = 8
"""Number of errors that are shown; the others are only counted."""

Model = TypeVar("Model")

_NEEDED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "model_type": "a mapping of keys",
    "model_attributes_type": "a mapping of keys",
    "dict_type": "a mapping of names",
    "tuple_type": "a list",
    "list_type": "a list",
}
_BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
_QUOTED = re.compile(r"'([^']+)'")
_SUBPATH = re.compile(r"^([A-Za-z_][\w.\[\]]*): ")


def validated(
    annotation: type[Model], document: Document, shown: str, origin: Callable[[str], str] = lambda path: ""
) -> Model:
    """Return the document as an instance of `annotation`, a model or a union of models.

    Raises:
        SceneError: one line per wrong place. `shown` names the document there, `origin` who gave a value.
    """
    try:
        # Strict JSON: lists may stand for tuples, but neither text nor booleans for numbers.
        return TypeAdapter(annotation).validate_json(json.dumps(document), strict=True)
    except ValidationError as error:
        raise SceneError(_described(error, annotation, document, shown, origin)) from None


def _described(
    error: ValidationError, annotation: object, document: Document, shown: str, origin: Callable[[str], str]
) -> str:
    places: dict[tuple[str, ...], list[ErrorDetails]] = {}
    for details in error.errors(include_url=False):
        places.setdefault(_place(details["loc"], document), []).append(details)
    lines = []
    for place, found in places.items():
        path, message = _message(place, found, annotation, document)
        where = f"{shown}: {path}" if path else shown
        lines.append(f"{where}: {message}{origin(path)}")
    hidden_count = len(lines) - SHOWN_COUNT
    if hidden_count > 0:
        lines = [*lines[:SHOWN_COUNT], f"{shown}: and {hidden_count} more errors; correct these first"]
    return "\n".join(lines)


def _place(location: tuple[int | str, ...], document: Document) -> tuple[str, ...]:
    """The path in the document: pydantic's location without the names of union members."""
    place: list[str] = []
    value: object = document
    for element in location:
        if element == "[key]":  # of a mapping of names: the place is that of its value
            break
        if isinstance(value, dict):
            if element not in value and element in (value.get("kind"), value.get("model", "dem")):
                continue
            value = value.get(str(element))
        elif isinstance(value, list) and isinstance(element, int):
            value = value[element] if element < len(value) else None
        elif place and value is not None:
            break  # the members of a union of scalars
        place.append(str(element))
    return tuple(place)


def _message(
    place: tuple[str, ...], found: list[ErrorDetails], root: object, document: Document
) -> tuple[str, str]:
    """Place of an error, and its message."""
    path = ".".join(place)
    first = found[0]
    given = _given(first["input"])
    if first["type"] == "value_error":
        text = str(first["ctx"]["error"])
        inner = _SUBPATH.match(text)
        if inner:
            return ".".join((*place, inner.group(1))), text[inner.end() :]
        return path, text
    if first["type"] == "extra_forbidden":
        parent = place[:-1]
        known = known_keys(annotation_at(root, document, parent), value_at(document, parent))
        known += LOADER_KEYS if root is Scene and not parent else []
        return path, f"unknown key '{place[-1]}'; {suggestion(place[-1], known)}"
    if first["type"] == "missing":
        return path, "is missing; it has no default"
    if first["type"] in ("union_tag_not_found", "union_tag_invalid"):
        annotation = annotation_at(root, document, place)
        if models := kinds(annotation, "model"):
            word = first["input"].get("model") if isinstance(first["input"], dict) else first["input"]
            return ".".join((*place, "model")), f"given {_given(word)}, allowed are {', '.join(models)}"
        allowed = kinds(annotation)
        if not isinstance(first["input"], dict):
            number = "a number, or " if float in members(annotation) else ""
            return (
                path,
                f"given {given}; it must be {number}a mapping with 'kind', one of {', '.join(allowed)}",
            )
        kind = first["input"].get("kind")
        if kind is None:
            return path, f"'kind' is missing; allowed are {', '.join(allowed)}"
        if isinstance(kind, str) and kind in unusable_laws() and place[-1] == "law":
            return f"{path}.kind", f"contact law '{kind}' is installed, but {unusable_laws()[kind]}"
        return f"{path}.kind", f"given {_given(kind)}, allowed are {', '.join(allowed)}{_hint(kind, allowed)}"
    needed = " or ".join(dict.fromkeys(_need(details) for details in found))
    expected = [details["ctx"]["expected"] for details in found if details["type"] == "literal_error"]
    hint = _hint(first["input"], _QUOTED.findall(" ".join(expected)))
    return path, f"given {given}; it must be {needed}{hint}"


def _hint(given: object, allowed: Sequence[str]) -> str:
    """Suggestion for a text that is close to an allowed one."""
    words = suggestion(given, allowed) if isinstance(given, str) else ""
    return f"; {words}" if words.startswith("did") else ""


def _need(details: ErrorDetails) -> str:
    kind, context = details["type"], details.get("ctx", {})
    if kind in _NEEDED:
        return _NEEDED[kind]
    if kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        return f"a number {words} {context[key]:g}"
    if kind == "literal_error":
        return str(context["expected"])
    if kind == "too_short":
        return f"a list of at least {context['min_length']} entries"
    if kind == "too_long":
        return f"a list of at most {context['max_length']} entries"
    if kind == "string_too_short":
        return "text that is not empty"
    message = details["msg"]
    return message[0].lower() + message[1:]


def _given(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "nothing (null)"
    if isinstance(value, str):
        return f"the text '{value[:60]}'"
    if isinstance(value, dict):
        keys = ", ".join(f"{key}: {item}" for key, item in value.items())
        return f"the mapping {{{keys[:60]}}}"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return str(value)[:60]


def members(annotation: object) -> list[object]:
    """The alternatives of an annotation, without Annotated, Union and None."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return members(get_args(annotation)[0])
    if origin is Union or origin is types.UnionType:
        return [m for part in get_args(annotation) if part is not type(None) for m in members(part)]
    return [annotation]


def is_model(annotation: object) -> TypeGuard[type[BaseModel]]:
    """Whether the annotation is a part of the scene (and not a number, text or mapping)."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def kinds(annotation: object, key: str = "kind") -> list[str]:
    """The values `kind` (or `model`) may have at a place of this annotation; empty if there is no choice."""
    found: list[str] = []
    for member in members(annotation):
        if is_model(member) and key in member.model_fields:
            found.extend(get_args(member.model_fields[key].annotation))
    return found


def model_at(annotation: object, value: object) -> type[BaseModel] | None:
    """The model that reads a value of this annotation; None if it is not a model, or unknown."""
    models = [m for m in members(annotation) if is_model(m)]
    if len(models) == 1:
        return models[0]
    given = value if isinstance(value, dict) else {}
    for model in models:
        if "kind" in given and given["kind"] in kinds(model):
            return model
        if "model" in model.model_fields and given.get("model", "dem") in kinds(model, "model"):
            return model
    return None


def item_annotation(annotation: object) -> object:
    """The annotation of the items of dict[str, Body] or tuple[Layer, ...]; None if it is neither."""
    for member in members(annotation):
        if get_origin(member) is dict:
            return get_args(member)[1]
        if get_origin(member) is tuple and get_args(member)[1:] == (Ellipsis,):
            return get_args(member)[0]
    return None


def annotation_at(root: object, document: object, path: Iterable[object]) -> object:
    """The annotation at a path of the document; None where the path leaves the model."""
    annotation: object = root
    value = document
    for key in path:
        if annotation is None:
            return None
        model = model_at(annotation, value)
        if model is not None:
            field = model.model_fields.get(str(key))
            annotation = None if field is None else field.annotation
        else:
            annotation = item_annotation(annotation)
        value = value_in(value, key)
    return annotation


def value_in(value: object, key: object) -> object:
    """Value at a key of a mapping, or at a place of a list; None if missing."""
    if isinstance(value, list) and str(key).isdigit() and int(str(key)) < len(value):
        return value[int(str(key))]
    return value.get(key) if isinstance(value, dict) else None


def value_at(value: object, path: Iterable[object]) -> object:
    """Value at a path; None if missing."""
    for key in path:
        value = value_in(value, key)
    return value


def known_keys(annotation: object, value: object) -> list[str]:
    """The keys that may stand at a place: fields of its model, or the names given in the scene."""
    model = model_at(annotation, value)
    if model is not None:
        return list(model.model_fields)
    return list(value) if isinstance(value, dict) else []


def suggestion(key: str, known: Iterable[str]) -> str:
    """'did you mean ...?' with the nearest known key, else the list of known keys."""
    known = list(known)
    lowered = {name.lower(): name for name in known}
    near = difflib.get_close_matches(key.lower(), lowered, n=1, cutoff=0.6)
    if near:
        return f"did you mean '{lowered[near[0]]}'?"
    if not known:
        return "no key is allowed here"
    return f"known here are {', '.join(known)}"
