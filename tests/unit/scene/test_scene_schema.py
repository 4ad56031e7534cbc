"""The JSON Schema that editors check scenes by: current, and of one mind with the loader."""

import copy
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from subsoil_ros.cli import schema as schema_verb
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.scene_schema import scene_schema
from subsoil_ros.loading.validation import LOADER_KEYS
from subsoil_ros.scene.scene import Scene
from subsoil_ros.strict_model import StrictModel
from subsoil_ros.units import unit_of, words_of
from subsoil_ros.yaml_document import read_document

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "config"
SHIPPED = CONFIG / "scene.schema.json"
SCENES = sorted([*(CONFIG / "scenes").glob("*.yaml"), *(ROOT / "examples").glob("*/*.yaml")])
TEMPLATES = sorted((CONFIG / "templates").glob("*.yaml"))


def errors(document: dict[str, Any]) -> list[str]:
    """What is wrong with a scene by the shipped schema."""
    validator = jsonschema.Draft7Validator(json.loads(SHIPPED.read_text()))
    return [error.message for error in validator.iter_errors(document)]


def changed(path: Path, keys: str, value: object) -> dict[str, Any]:
    """The document of a scene file with one value given, its mappings made if need be."""
    document = copy.deepcopy(read_document(path, str(path)))
    place = document
    *above, last = keys.split(".")
    for key in above:
        place = place.setdefault(key, {})
    place[last] = value
    return document


def test_schema_is_current(tmp_path):
    """The shipped file is what `subsoil schema` writes: after a change of the model, write it anew."""
    schema_verb.run(_arguments("--out", str(tmp_path / "schema.json")))
    assert (tmp_path / "schema.json").read_text() == SHIPPED.read_text()
    jsonschema.Draft7Validator.check_schema(json.loads(SHIPPED.read_text()))


@pytest.mark.full
@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_shipped_scenes(path):
    """Every shipped scene names the schema in its first line, and it and the scene as run are valid by it."""
    named = path.read_text().splitlines()[0].removeprefix("# yaml-language-server: $schema=")
    assert (path.parent / named).resolve() == SHIPPED
    assert errors(read_document(path, str(path))) == []
    assert errors(load_scene(path).document) == []


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_templates(path):
    """So are the scenes of `subsoil new`, beside which the schema lies."""
    assert path.read_text().splitlines()[0] == "# yaml-language-server: $schema=scene.schema.json"
    assert errors(read_document(path, str(path))) == []


@pytest.mark.parametrize("name", ["tine", "subsoiler_1s300", "subsoiler_1s300_quick", "tine_hardpan"])
@pytest.mark.parametrize(
    ("keys", "value"),
    [
        ("duration", 1.0),
        ("soil.bin.depht_m", 0.3),
        ("tools.extra", {"body": "shank", "groups": {"a": {"mesh": "a.stl", "size": 1.0}}}),
        ("mechanism.bodies.extra", {"mass": 1.0}),
        ("mechanism.forces.extra", {"kind": "spring_damper", "stiffness": 1.0}),
        ("soil.bin.depth_m", "deep"),
        ("soil.bin.depth_m", -0.3),
        ("record.series_ticks", 0),
        ("coupling.force", "tick_middle"),
    ],
)
def test_mistakes_are_found(name, keys, value):
    """Unknown keys and values that the model refuses are errors, in whole scenes and in parts of them."""
    assert errors(changed(CONFIG / "scenes" / f"{name}.yaml", keys, value))


def test_only_a_part_may_leave_keys_out():
    """What is missing is an error, unless a base or a start may give it; there null removes."""
    document = read_document(CONFIG / "scenes/tine.yaml", "tine")
    del document["soil"]["bin"]
    assert errors(document)
    assert errors(document | {"base": "other.yaml"}) == []
    assert errors({"name": "x", "duration_s": 1.0, "mechanism": {"bodies": {"shank": None}}})
    assert errors({"base": "other.yaml", "mechanism": {"bodies": {"shank": None}}}) == []


def test_every_quantity_has_its_unit():
    """The description of a key that ends in a unit says it."""
    without = [
        f"{name}.{key}"
        for name, definition in scene_schema()["$defs"].items()
        for key, item in definition.get("properties", {}).items()
        if unit_of(key) and f"Unit: {unit_of(key)}." not in item.get("description", "")
    ]
    assert without == []
    assert unit_of("gain_per_s") == "1/s"
    assert unit_of("stiffness_newton_m_per_rad") == "N m/rad"
    assert unit_of("static_friction") == ""
    assert words_of("tool.tine.torque_y_newton_m") == "tool tine torque y [N m]"
    assert words_of("coupling.residual_ratio") == "coupling residual ratio"


def test_descriptions_are_those_of_the_model():
    """Of fields, with their units, and of parts: their docstrings."""
    definitions = scene_schema()["$defs"]
    assert definitions["Bin"]["properties"]["depth_m"]["description"] == "of the bed. Unit: m."
    velocity = definitions["Body"]["properties"]["velocity_m_per_s"]["description"]
    assert velocity.startswith("at the start; made consistent with the constraints.")
    assert definitions["Bin"]["description"].startswith("Open box")
    assert issubclass(Scene, StrictModel)
    assert set(definitions["Scene"]["properties"]) == {*LOADER_KEYS, *Scene.model_fields}


def _arguments(*words: str) -> Any:
    import argparse

    parser = argparse.ArgumentParser()
    schema_verb.add_arguments(parser)
    return parser.parse_args(words)
