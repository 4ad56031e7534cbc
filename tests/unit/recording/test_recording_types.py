"""Type hashes in bags are rosidl's, of every type recorded and of every type that these are made of."""

import copy
import json
import sys
from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from subsoil_ros.messages import SoilState
from subsoil_ros.recording.message_codec import reader
from subsoil_ros.recording.topics import LATCHED, recorded_topics
from subsoil_ros.recording.types import schema_text, type_hash, typestore
from tests.unit.recording.recording_samples import SCENE

TF = "tf2_msgs/msg/TFMessage"
TF_HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
"""As `ros2 topic info --verbose /tf` prints it on Jazzy."""

RECORDED = sorted({*recorded_topics(SCENE).values(), *LATCHED.values(), "subsoil_msgs/msg/DriverCommand"})


def description(name: str) -> dict[str, Any]:
    """rosidl's description of a type, from its installed package."""
    package, _, short = name.partition("/msg/")
    path = Path(sys.prefix) / "share" / package / "msg" / f"{short}.json"
    if not path.is_file():
        pytest.skip(f"rosidl's description of {name} is not installed in this prefix")
    found: dict[str, Any] = json.loads(path.read_text())
    return found


@pytest.mark.parametrize("name", [name for name in RECORDED if name != TF])
def test_hashes_are_those_that_rosidl_generated(name: str) -> None:
    """Of the type itself and of all types in it."""
    hashes = {item["type_name"]: item["hash_string"] for item in description(name)["type_hashes"]}
    assert name in hashes
    assert {known: type_hash(known) for known in hashes} == hashes


def test_hash_of_tf_is_computed_by_rosidl_too() -> None:
    """tf2_msgs is in no package registry: its one field, and rosidl's function on the types it names."""
    assert type_hash(TF) == TF_HASH
    rosidl = pytest.importorskip("rosidl_generator_type_description")
    stamped = description("geometry_msgs/msg/TransformStamped")["type_description_msg"]
    element = {
        "type_id": 145,  # type_description_interfaces/FieldType: unbounded sequence (144), nested (1)
        "capacity": 0,
        "string_capacity": 0,
        "nested_type_name": "geometry_msgs/msg/TransformStamped",
    }
    referenced = [*copy.deepcopy(stamped["referenced_type_descriptions"]), stamped["type_description"]]
    tf = {
        "type_description": {
            "type_name": TF,
            "fields": [{"name": "transforms", "type": element, "default_value": ""}],
        },
        "referenced_type_descriptions": sorted(referenced, key=lambda item: item["type_name"]),
    }
    assert rosidl.calculate_type_hash(tf) == TF_HASH


@pytest.mark.parametrize("name", [name for name in RECORDED if not name.startswith("subsoil_msgs")])
def test_standard_types_have_the_fields_of_this_distribution(name: str) -> None:
    """A reader that knows the type by heart reads ours: same names, same order."""
    if name == TF:
        pytest.skip("tf2_msgs is in no package registry")
    fields = [
        field["name"] for field in description(name)["type_description_msg"]["type_description"]["fields"]
    ]
    assert [field for field, _ in typestore().fielddefs[name][1]] == fields


def test_a_bag_of_an_older_version_is_read_by_its_own_definition() -> None:
    """A field that was added since is 0 or empty; all others are as they were written."""
    name = "subsoil_msgs/msg/SoilState"
    later = ("broken_bond_count", "lost_particles")
    lines = schema_text(name).splitlines(True)
    older = "".join(line for line in lines if not any(word in line for word in later))
    store = get_typestore(Stores.ROS2_JAZZY)
    own = get_types_from_msg(older, name)
    store.register({key: value for key, value in own.items() if key not in store.types})
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](1, 5), "world")
    message = store.types[name](header, "run", 41, 1, 2, 3, 4, 0.1, 0.2, 0.3, 0.4, 0.5)
    data = bytes(store.serialize_cdr(message, name))
    state = reader(SoilState, older)(data)
    assert state == SoilState("run", 41, 1_000_000_005, 1, 2, 3, 0, 4, 0.1, 0.2, 0.3, 0.4, 0.5)
