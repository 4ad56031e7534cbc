"""Parameters of a node's process: their keys, declaration, reading, and help text."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node

from ...coupling.run_options import OPTIONS
from ...coupling.run_settings import RunSettings
from ...errors import InputError
from ...loading.loader import load_scene
from ...recording.checkpoint import read_checkpoint
from ..transport.private_rclpy import given_parameters

OF_ROS = ("use_sim_time", "start_type_description_service")
"""Parameters that every ROS node takes."""


@dataclass(frozen=True)
class ParameterKey:
    """One parameter: default, description, allowed values in words, range of a number."""

    default: str | bool | int | float
    description: str
    allowed: str
    limits: tuple[int, int] | tuple[float, float] | None = None


_TEXT = "text; a number in quotes is one too: run_id:=\"'7'\""
_FLAG = "true or false"

PARAMETERS: Mapping[str, ParameterKey] = {
    "scene": ParameterKey("", "scene file, the same for all nodes", "path of a scene file (.yaml)"),
    "run_id": ParameterKey(
        "run", "name of the run, the same for all nodes; other runs' messages are refused", _TEXT
    ),
    "bag": ParameterKey("", "folder for the recorder's bag", "path of a folder that does not exist"),
    "checkpoints": ParameterKey(
        "",
        "folder for checkpoints, the same for all nodes; empty: none are written",
        "path of a folder, or empty",
    ),
    "resume": ParameterKey(
        "",
        "checkpoint to continue from, the same for all nodes; empty: start at tick 0",
        "path of a checkpoint of this scene, or empty",
    ),
    "live": ParameterKey(
        0,
        "the recorder: port on this machine of a live view for Foxglove; 0: there is none",
        "a whole number from 0 to 65535",
        (0, 65535),
    ),
    "recorded": ParameterKey(True, "whether the run has a recorder, the same for all nodes", _FLAG),
    "supervised": ParameterKey(False, "end when standard input ends, read stop requests from it", _FLAG),
    **{
        name: ParameterKey(
            option.default, f"the {option.node}: {option.description}", option.allowed, option.limits
        )
        for name, option in OPTIONS.items()
    },
}
"""Parameters of every node's process."""


def read_settings(node: Node, name: str, more: Mapping[str, ParameterKey] | None = None) -> RunSettings:
    """Declare the parameters, all read-only, on `node`, the process of the protocol's node `name`; read them.

    Args:
        more: parameters of this node beside PARAMETERS.

    Raises:
        InputError: no scene is given, a parameter is unknown or not allowed, the scene or the checkpoint to
            continue from cannot be used, or the node was renamed.
    """
    if node.get_name() != f"{name}_process":
        raise InputError(
            f"the node was renamed to '{node.get_name()}'; nodes of a run are identified by "
            "their names, so use a namespace (-r __ns:=/NAME) instead"
        )
    keys = {**PARAMETERS, **(more or {})}
    unknown = sorted(set(given_parameters(node)) - set(keys) - set(OF_ROS))
    if unknown:
        raise InputError(f"parameter '{unknown[0]}': not known; allowed are {', '.join(sorted(keys))}")
    values = {key: _declare(node, key, found) for key, found in keys.items()}
    if not values["scene"]:
        raise InputError("parameter 'scene' is empty; name a scene, -p scene:=FILE")
    resolved = load_scene(values["scene"])
    return RunSettings(
        resolved,
        values["run_id"],
        bag=Path(values["bag"]) if values["bag"] else None,
        checkpoints=Path(values["checkpoints"]) if values["checkpoints"] else None,
        resumed=read_checkpoint(Path(values["resume"]), resolved.scene_hash) if values["resume"] else None,
        recorded=values["recorded"],
        live_port=values["live"],
        supervised=values["supervised"],
        **{name: values[name] for name in OPTIONS},
    )


def _declare(node: Node, name: str, key: ParameterKey) -> Any:
    descriptor = ParameterDescriptor(
        description=key.description, additional_constraints=key.allowed, read_only=True
    )
    if key.limits is not None:
        lowest, largest = key.limits
        if isinstance(key.default, int):
            descriptor.integer_range = [IntegerRange(from_value=lowest, to_value=largest, step=1)]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=lowest, to_value=largest)]
    try:
        return node.declare_parameter(name, key.default, descriptor).value
    except ParameterException as error:
        words = " ".join(str(error).split())
        raise InputError(f"parameter '{name}': must be {key.allowed} ({words})") from error


def help_text(name: str, more: Mapping[str, ParameterKey] | None = None) -> str:
    """Help text of the node `name`."""
    lines = [
        f"usage: {name}_node --ros-args -p scene:=FILE [-p NAME:=VALUE]... [-r __ns:=/NAMESPACE]",
        "",
        f"The node '{name}' of a run; docs/ros.md describes how to start it. Parameters, read-only:",
    ]
    for key, found in {**PARAMETERS, **(more or {})}.items():
        default = str(found.default).lower() if isinstance(found.default, bool) else repr(found.default)
        lines += [f"  {key} (default: {default})", f"      {found.description}", f"      {found.allowed}"]
    return "\n".join(lines)
