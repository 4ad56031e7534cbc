"""JSON Schema of scene files, for editors: from the typed model, with the loader's own keys.

Fields are described where they are declared, by Field(description=...); their unit is in their name.
A file with `base` or `initial_conditions` gives a part of a scene: there every key may be left out, or null.
"""

import copy
from typing import Any

from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from ..scene.scene import Scene
from ..units import unit_of
from ..yaml_document import Document
from .validation import LOADER_KEYS

Schema = Document

DIALECT = "http://json-schema.org/draft-07/schema#"
"""The newest dialect that the YAML servers of all editors support."""

PARTIAL = "Partial"
"""Prefix of the definitions in which every key may be left out."""

DERIVED = ("name", "duration_s")
"""Keys of a scene that one in short does not need."""

_SOIL_BY_NAME: Schema = {"type": "string", "description": "In short, for soil.material alone."}

_MATERIAL: Schema = {
    "type": ["string", "null"],
    "description": "Material file, or name of a shipped one: a laboratory's soil, as particles or a terrain.",
}
"""The key of `soil` that the loader reads."""


def scene_schema() -> Schema:
    """The schema of a scene file, draft 7."""
    whole = Scene.model_json_schema(schema_generator=SchemaWithUnits)
    definitions = whole.pop("$defs")
    definitions["Scene"] = whole
    partial = {f"{PARTIAL}{name}": _partial(found) for name, found in definitions.items()}
    definitions |= partial
    for name in ("Soil", "TerrainSoil"):
        for found in (name, f"{PARTIAL}{name}"):
            definitions[found]["properties"]["material"] = _MATERIAL
    for name in ("Scene", f"{PARTIAL}Scene"):
        properties = definitions[name]["properties"]
        properties["soil"] = {"anyOf": [_SOIL_BY_NAME, properties["soil"]]}
    required = [key for key in definitions["Scene"]["required"] if key not in DERIVED]
    definitions["Scene"]["required"] = required
    for name in ("Soil", "TerrainSoil"):  # a material brings what a soil without one must have
        definitions[name] = {
            "if": {"required": ["material"]},
            "then": {"$ref": f"#/$defs/{PARTIAL}{name}"},
            "else": definitions[name],
        }
    for name in ("Scene", f"{PARTIAL}Scene"):
        definitions[name]["properties"] = {**_loader_keys(), **definitions[name]["properties"]}
    schema = {
        "$schema": DIALECT,
        "title": "Scene of subsoil_ros",
        "description": "SI units, named in the keys. See docs/scenes.md.",
        "if": {"anyOf": [{"required": ["base"]}, {"required": ["initial_conditions"]}]},
        "then": {"$ref": f"#/$defs/{PARTIAL}Scene"},
        "else": {"$ref": "#/$defs/Scene"},
        "$defs": dict(sorted(definitions.items())),
    }
    return dict(_as_draft_7(schema))


def _loader_keys() -> Schema:
    """What the loader reads beside the model's keys (loading/loader.py)."""
    part = {"anyOf": [{"$ref": f"#/$defs/{PARTIAL}Scene"}, {"type": "null"}]}
    preset = {
        "type": ["object", "null"],
        "properties": {"changes": part, "expected": {"type": ["object", "null"]}},
        "additionalProperties": False,
    }
    known: Schema = {
        "base": {"type": "string", "description": "Scene file that this one is laid over, relative to it."},
        "initial_condition": {
            "type": ["string", "null"],
            "description": "Name of the start that is laid over the rest.",
        },
        "initial_conditions": {
            "type": ["object", "null"],
            "description": "Parts of scenes by name; `initial_condition` chooses one.",
            "additionalProperties": part,
        },
        "preset": {"type": ["string", "null"], "description": "Name of the preset that is laid over all."},
        "presets": {
            "type": ["object", "null"],
            "description": "Changes by name, with what was measured of each; `preset` chooses one.",
            "additionalProperties": preset,
        },
    }
    return {key: known[key] for key in LOADER_KEYS}


class SchemaWithUnits(GenerateJsonSchema):
    """Generator that adds the unit to the description of a field, and omits titles that repeat the key."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def model_schema(self, schema: core_schema.ModelSchema) -> Schema:
        found = super().model_schema(schema)
        for key, item in found.get("properties", {}).items():
            if unit := unit_of(key):
                item["description"] = f"{item.get('description', '')} Unit: {unit}.".lstrip()
        return found


def _partial(schema: Any) -> Any:
    """A copy in which nothing is required and every value of a mapping may be null."""
    if isinstance(schema, list):
        return [_partial(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    found: Schema = {}
    for key, value in schema.items():
        if key in ("required", "minProperties"):
            continue
        if key == "$ref":
            found[key] = value.replace("#/$defs/", f"#/$defs/{PARTIAL}")
        elif key == "properties":
            found[key] = {name: _or_null(_partial(item)) for name, item in value.items()}
        elif key == "additionalProperties" and isinstance(value, dict):
            found[key] = _or_null(_partial(value))
        elif key in ("const", "enum", "default", "description", "discriminator"):
            found[key] = copy.deepcopy(value)
        elif key == "oneOf":  # without their kinds several fit
            found["anyOf"] = _partial(value)
        else:
            found[key] = _partial(value)
    return found


def _or_null(schema: Schema) -> Schema:
    described = {"description": schema["description"]} if "description" in schema else {}
    return {**described, "anyOf": [schema, {"type": "null"}]}


def _as_draft_7(schema: Any) -> Any:
    """Rename the items of fixed lists as in draft 7, and remove keys of OpenAPI."""
    if isinstance(schema, list):
        return [_as_draft_7(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    names = {"prefixItems": "items"}
    return {names.get(key, key): _as_draft_7(item) for key, item in schema.items() if key != "discriminator"}
