"""Keys that a document may have at a place, from the typed model; for errors and overrides."""

import difflib
import types
from collections.abc import Iterable
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel


def members(annotation: Any) -> list[Any]:
    """The alternatives of an annotation, without Annotated, Union and None."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return members(get_args(annotation)[0])
    if origin is Union or origin is types.UnionType:
        return [m for part in get_args(annotation) if part is not type(None) for m in members(part)]
    return [annotation]


def is_model(annotation: Any) -> bool:
    """Whether the annotation is a part of the scene (and not a number, text or mapping)."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def kinds(annotation: Any, key: str = "kind") -> list[str]:
    """The values `kind` (or `model`) may have at a place of this annotation; empty if there is no choice."""
    found: list[str] = []
    for member in members(annotation):
        if is_model(member) and key in member.model_fields:
            found.extend(get_args(member.model_fields[key].annotation))
    return found


def model_at(annotation: Any, value: object) -> type[BaseModel] | None:
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


def item_annotation(annotation: Any) -> Any:
    """The annotation of the items of dict[str, Body] or tuple[Layer, ...]; None if it is neither."""
    for member in members(annotation):
        if get_origin(member) is dict:
            return get_args(member)[1]
        if get_origin(member) is tuple and get_args(member)[1:] == (Ellipsis,):
            return get_args(member)[0]
    return None


def annotation_at(root: Any, document: object, path: Iterable[object]) -> Any:
    """The annotation at a path of the document; None where the path leaves the model."""
    annotation: Any = root
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


def known_keys(annotation: Any, value: object) -> list[str]:
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
