"""Each .msg file says what its record says."""

from dataclasses import fields
from enum import IntEnum
from typing import Any, get_args, get_type_hints

import pytest
from rosbags.interfaces import Nodetype

from subsoil_ros import messages
from subsoil_ros.recording.message_codec import PLACES
from subsoil_ros.recording.types import message_folder, own_type_hashes, typestore

BATCH = "MessageBatch"  # of messages, no record
NAMES = [name for line in own_type_hashes() if (name := line.split()[0]) != BATCH]
PRIMITIVES = {
    int: {"uint32", "int64", "uint64", "uint8"}, float: {"float64"}, str: {"string"}, bool: {"bool"},
}  # fmt: skip


def definition(name: str) -> tuple[list[Any], list[Any]]:
    """Constants and fields of a message."""
    return typestore().fielddefs[f"subsoil_msgs/msg/{name}"]


def leaves(kind: type, name: str, prefix: str = "") -> list[tuple[str, Any]]:
    """(attribute of the record, its type in the message) of every field but the header."""
    found = []
    for field, content in typestore().fielddefs[name][1]:
        place = prefix + field
        if place in PLACES.get(kind, {}):
            found.append((PLACES[kind][place], content))
        elif content[0] is Nodetype.NAME and place != "header":
            found += leaves(kind, content[1], f"{place}.")
        elif place != "header":
            found.append((place, content))
    return found


def test_there_is_a_file_for_every_record_and_a_record_for_every_file() -> None:
    """In the folder from which the types are read."""
    assert sorted(path.stem for path in message_folder().glob("*.msg")) == sorted([*NAMES, BATCH])


@pytest.mark.parametrize("name", NAMES)
def test_fields_have_the_same_names_and_order(name: str) -> None:
    """A motion, which is made by motion_of, has all its values in the message."""
    kind = getattr(messages, name)
    found = [attribute for attribute, _ in leaves(kind, f"subsoil_msgs/msg/{name}")]
    if kind is messages.ToolMotion:
        assert set(found) == set(get_type_hints(messages.motion_of)) - {"return"}
    else:
        assert found == [field.name for field in fields(kind) if field.name != "end_time_ns"]


@pytest.mark.parametrize("name", [name for name in NAMES if name != "ToolMotion"])
def test_fields_have_the_same_types(name: str) -> None:
    """Primitive types, enumerations with their constants, and sequences."""
    kind = getattr(messages, name)
    hints, constants = get_type_hints(kind), {}
    for attribute, (node, content) in leaves(kind, f"subsoil_msgs/msg/{name}"):
        hint = hints[attribute]
        if node is Nodetype.SEQUENCE:
            item, rest = get_args(hint)
            assert rest is ...
            (item_node, item_name), _ = content
            if item is str:
                assert (item_node, item_name[0]) == (Nodetype.BASE, "string")
            else:
                assert (item_node, item_name) == (Nodetype.NAME, f"subsoil_msgs/msg/{item.__name__}")
        elif issubclass(hint, IntEnum):
            assert content[0] == "uint8"
            constants = {member.name: member.value for member in hint}
        else:
            assert content[0] in PRIMITIVES[hint], attribute
    assert {constant: value for constant, _, value in definition(name)[0]} == constants
