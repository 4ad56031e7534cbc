"""The reference of all keys of a scene file as Markdown, from its JSON Schema (dev/reference.py writes it).

One section for each part of a scene, with a table: key, value, default, unit, description. The schema takes
defaults, limits and descriptions from the typed model (subsoil_ros/loading/scene_schema.py).
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from subsoil_ros.loading.scene_schema import scene_schema
from subsoil_ros.units import unit_of

Schema = dict[str, Any]

TIME_FUNCTION = "ConstantLaw"
"""A choice that contains this definition is a time function; these have one section, which comes last."""

CHANGES = re.compile(r"(LayerLaw|(Linear|Hertz|Adhesive)Change)$")
"""Definitions of a layer's law: the keys are those of `soil.law`, each optional, and are not listed again."""

HEAD = "| key | value | default | unit | description |\n|---|---|---|---|---|"


@dataclass(frozen=True)
class Part:
    """A section: where its keys stand in a scene, and the name of its definition."""

    path: str
    name: str


def scene_keys() -> str:
    """Return the reference of all keys, with headings of level 3."""
    definitions: dict[str, Schema] = {
        name: found.get("else", found) for name, found in scene_schema()["$defs"].items()
    }
    parts: list[Part] = []
    _collect(definitions, Part("", "Scene"), parts)
    titles = {part.name: _title(part, parts, definitions) for part in parts}
    anchors = {
        name: re.sub(r"[^a-z0-9_]+", "-", f"key {title}".lower()).strip("-") for name, title in titles.items()
    }
    return "\n".join(_section(name, title, definitions, anchors) for name, title in titles.items())


def _collect(definitions: dict[str, Schema], part: Part, found: list[Part]) -> None:
    """Append `part` and all parts below it, each definition once, time functions last."""
    if any(part.name == known.name for known in found) or CHANGES.search(part.name):
        return
    found.append(part)
    for key, item in definitions[part.name].get("properties", {}).items():
        refs = list(_refs(item))
        if TIME_FUNCTION not in refs:
            path = f"{part.path}.{key}".lstrip(".") + _levels(item)
            for name in refs:
                _collect(definitions, Part(path, name), found)
    if part.name == "Scene":
        found += [Part("", name) for name in _refs(definitions["Driver"]["properties"]["speed"])]


def _refs(item: Any) -> Iterator[str]:
    """Names of the definitions that a value may be of; those of partial scenes are left out."""
    if isinstance(item, list):
        for one in item:
            yield from _refs(one)
    elif isinstance(item, dict):
        name = item.get("$ref", "").removeprefix("#/$defs/")
        if name and not name.startswith("Partial"):
            yield name
        for key, one in item.items():
            if key != "default":
                yield from _refs(one)


def _levels(item: Schema) -> str:
    """`.NAME` of a mapping by name, `[]` of a list of parts."""
    choices = item.get("anyOf", [item])
    if any(isinstance(one.get("additionalProperties"), dict) for one in choices):
        return ".NAME"
    return "[]" if any(one.get("type") == "array" for one in choices) else ""


def _kind(definition: Schema) -> str:
    """What the part's `kind`, or `model`, must be; empty if it has none."""
    for key in ("kind", "model"):
        found = definition.get("properties", {}).get(key, {})
        if "const" in found:
            return f"{key}: {found['const']}"
    return ""


def _title(part: Part, parts: list[Part], definitions: dict[str, Schema]) -> str:
    """Where the keys stand; of several parts in one place, also the kinds that have this one."""
    if part.name == "Scene":
        return "Top level"
    where = f"`{part.path}`" if part.path else "Time function"
    if kind := _kind(definitions[part.name]):
        return f"{where}, `{kind}`"
    if sum(other.path == part.path for other in parts) == 1:
        return where
    holders = [other.name for other in parts if part.name in _refs(definitions[other.name])]
    return f"{where} of " + ", ".join(f"`{_kind(definitions[name]).partition(': ')[2]}`" for name in holders)


def _section(name: str, title: str, definitions: dict[str, Schema], anchors: dict[str, str]) -> str:
    definition = definitions[name]
    required = definition.get("required", ())
    lines = [f'<a id="{anchors[name]}"></a>', "", f"### {title}", ""]
    if definition.get("description"):
        lines += [definition["description"], ""]
    lines.append(HEAD)
    for key, item in definition.get("properties", {}).items():
        if f"{key}: {item.get('const')}" == _kind(definition):
            continue
        unit = unit_of(key)
        words = item.get("description", "").replace(f"Unit: {unit}.", "").strip()
        default = "required" if key in required else _default(item)
        cells = (f"`{key}`", _value(item, definitions, anchors), default, unit, words)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines if lines[-1] != HEAD else lines[:-1]) + "\n"


def _default(item: Schema) -> str:
    """The default as a scene would give it; empty if the key may be left out and then has no value."""
    default = item.get("default")
    if default is None or (isinstance(default, dict | str) and not default):
        return ""
    if isinstance(default, dict):
        return "see there"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return f"`{list(default) if isinstance(default, tuple) else default}`"


def _value(item: Schema, definitions: dict[str, Schema], anchors: dict[str, str]) -> str:
    """What the value may be: its type and limits, or links to the parts."""
    choices = item.get("anyOf") or item.get("oneOf")
    if choices:
        refs = list(_refs(choices))
        if TIME_FUNCTION in refs:
            return f"[time function](#{anchors[TIME_FUNCTION]})"
        found = [_value(one, definitions, anchors) for one in choices if one.get("type") != "null"]
        return " or ".join(dict.fromkeys(found))
    if "$ref" in item:
        name = item["$ref"].removeprefix("#/$defs/")
        if name not in anchors:
            return "keys of `soil.law`"
        return f"[{_kind(definitions[name]).partition(': ')[2] or 'keys'}](#{anchors[name]})"
    if "const" in item:
        return f"`{item['const']}`"
    if "enum" in item:
        return ", ".join(f"`{one}`" for one in item["enum"])
    if item.get("type") == "object":
        inner = item.get("additionalProperties")
        inside = _value(inner, definitions, anchors) if isinstance(inner, dict) else "any"
        return f"by name: {inside}"
    if item.get("type") == "array":
        inner = item["items"]
        if isinstance(inner, list):
            return f"{len(inner)} {_value(inner[0], definitions, anchors)}s"
        least = item.get("minItems", 0)
        most = f", {least} or more" if least > 1 else ""
        return f"list: {_value(inner, definitions, anchors)}{most}"
    given = item.get("type", "")
    types = [one for one in ([given] if isinstance(given, str) else given) if one != "null"]
    words = {"boolean": "true or false", "object": "parts by name", "string": "text"}
    return " or ".join(words.get(one, one) for one in types) + _limits(item)


def _limits(item: Schema) -> str:
    """Limits of a number, in symbols."""
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    found = [f"{sign} {item[key]:g}" for key, sign in signs.items() if key in item]
    return f" {', '.join(found)}" if found else ""
