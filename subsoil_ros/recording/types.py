"""Message types without ROS: rosbags' store of Jazzy types, with subsoil_msgs added from its .msg files."""

import os
import sys
from collections.abc import Callable
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from .. import messages
from ..errors import RecordingError
from ..messages import Head, SoilCloud, SpatialMotion

_OTHER_TYPES = {SoilCloud: "sensor_msgs/msg/PointCloud2", Head: "subsoil_msgs/msg/TickAck"}
"""Types of records of messages.py without a message of their name."""

_STANDARD_TYPES = {
    "PoseStamped": "geometry_msgs/msg/",
    "WrenchStamped": "geometry_msgs/msg/",
    "TransformStamped": "geometry_msgs/msg/",
    "TFMessage": "tf2_msgs/msg/",
    "Clock": "rosgraph_msgs/msg/",
}
"""Packages of the types of standard_messages.py."""

_OWN = "subsoil_msgs/msg/"
BATCH = _OWN + "MessageBatch"
"""Type that carries messages of another one, not a record (message_batches.py)."""

_NAMES = sorted(
    [
        BATCH.removeprefix(_OWN),
        *(
            name
            for name, item in vars(messages).items()
            if is_dataclass(item) and item not in (*_OTHER_TYPES, SpatialMotion)
        ),
    ]
)
Message = Any
"""A message of rosbags, or its class: made from a definition at run time."""

_RULE = "=" * 80


def _search_path() -> list[Path]:
    prefixes = [item for item in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if item]
    installed = [Path(prefix) / "share/subsoil_msgs/msg" for prefix in (*prefixes, sys.prefix)]
    copy = Path(sys.prefix) / "share/subsoil_ros/msg_defs/msg"  # in the wheel: enough without ROS
    return [*installed, copy, Path(__file__).parents[2] / "msg_defs/msg"]


@cache
def message_folder() -> Path:
    """Folder of the .msg files of subsoil_msgs: of the installed package, else of the source checkout.

    Raises:
        RecordingError: neither exists.
    """
    folders = _search_path()
    for folder in folders:
        if all((folder / f"{name}.msg").is_file() for name in _NAMES):
            return folder
    looked = "\n  ".join(str(folder) for folder in folders)
    raise RecordingError(
        f"the message definitions of subsoil_msgs were not found; looked for {_NAMES[0]}.msg and "
        f"{len(_NAMES) - 1} others in\n  {looked}\nInstall subsoil_msgs (`make`), or source its workspace."
    )


@cache
def _texts() -> dict[str, str]:
    return {_OWN + name: (message_folder() / f"{name}.msg").read_text(encoding="utf-8") for name in _NAMES}


def message_type(kind: type) -> str:
    """Type name of the message of records of `kind`, "subsoil_msgs/msg/Grant"."""
    return _OTHER_TYPES.get(kind, _STANDARD_TYPES.get(kind.__name__, _OWN) + kind.__name__)


@cache
def typestore() -> Typestore:
    """The types of Jazzy and those of subsoil_msgs."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in _texts().items():
        store.register(get_types_from_msg(text, name))
    return store


@cache
def message_class(name: str) -> Message:
    """rosbags' class of a message type, "geometry_msgs/msg/Pose"."""
    return typestore().types[name]


@cache
def schema_text(name: str) -> str:
    """Full ros2msg schema: the type's own text, then every type it uses, each after a ruled heading.

    Types of subsoil_msgs keep their text with its comments, where the units are.
    """
    definition, _ = typestore().generate_msgdef(name, ros_version=2)
    first, *others = definition.split(f"{_RULE}\nMSG: ")
    parts = [_texts().get(name, first).rstrip("\n") + "\n"]
    for other in others:
        short, _, body = other.partition("\n")
        text = _texts().get(short.replace("/", "/msg/"), body).rstrip("\n")
        parts.append(f"{_RULE}\nMSG: {short}\n{text}\n")
    return "".join(parts)


@cache
def type_hash(name: str) -> str:
    """RIHS01 hash of a message type, as ROS 2 computes it."""
    return typestore().hash_rihs01(name)


def serialize(message: Message) -> bytes:
    """CDR bytes of a rosbags message."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))


def older_deserializer(name: str, schema: str) -> Callable[[bytes], Message]:
    """Return the function that reads messages of type `name` from CDR bytes, by the definition in a bag:
    `schema`, a ros2msg text, since other versions may have other fields."""
    store = get_typestore(Stores.ROS2_JAZZY)
    own = get_types_from_msg(schema, name)
    store.register({key: value for key, value in own.items() if key not in store.types})
    return lambda data: store.deserialize_cdr(data, name)


def deserialize(data: bytes, name: str) -> Message:
    """rosbags message of type `name` from CDR bytes."""
    return typestore().deserialize_cdr(data, name)


@cache
def own_type_hashes() -> tuple[str, ...]:
    """ "Grant RIHS01_..." of every message of subsoil_msgs, by name."""
    return tuple(f"{name} {type_hash(_OWN + name)}" for name in _NAMES)
