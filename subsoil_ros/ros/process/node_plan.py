"""The processes of a run: which nodes, with which parameters and remappings.

`subsoil run` and launch/subsoil.launch.py both start these processes. No ROS is imported.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...coupling.protocol import COUPLER, RECORDER, external_nodes
from ...coupling.run_options import OPTIONS
from ...coupling.run_settings import RunSettings
from ...errors import InputError

Parameters = Mapping[str, str | int | bool]
"""Parameters of a node by name."""

GLOBAL_TOPICS = ("/clock", "/tf")
"""Topics with absolute names; in a namespace they are remapped into it, or two runs would share them."""

_NAMESPACE = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*")


@dataclass(frozen=True)
class NodeStart:
    """One node to start: its protocol name, and its parameters."""

    name: str
    parameters: Parameters

    @property
    def executable(self) -> str:
        """Its program, in lib/subsoil_ros and on the path."""
        return f"{self.name}_node"


def nodes_of(run: RunSettings, scene: Path) -> tuple[NodeStart, ...]:
    """The nodes of a run to start, the coupler last; other programs provide the rest (external_nodes).

    scene: the scene file as run.
    """
    common: Parameters = {
        "scene": str(scene.resolve()),
        "run_id": run.run_id,
        "recorded": run.recorded,
        "supervised": run.supervised,
        "checkpoints": _resolved(run.checkpoints),
        "resume": _resolved(run.resumed.path if run.resumed is not None else None),
    }
    own: dict[str, Parameters] = {RECORDER: {"bag": _resolved(run.bag), "live": run.live_port}}
    for option, found in OPTIONS.items():
        own[found.node] = {**own.get(found.node, {}), option: getattr(run, option)}
    left_out = external_nodes(run.resolved.scene)
    names = [name for name in run.participants if name not in left_out]
    return tuple(NodeStart(name, {**common, **own.get(name, {})}) for name in (*names, COUPLER))


def _resolved(path: Path | None) -> str:
    """A path as a parameter: absolute; empty if there is none."""
    return str(path.resolve()) if path is not None else ""


def remappings(namespace: str) -> tuple[tuple[str, str], ...]:
    """The remappings of every node that runs in `namespace`; none in the root."""
    return tuple((topic, topic.lstrip("/")) for topic in GLOBAL_TOPICS) if namespace else ()


def checked_namespace(text: str) -> str:
    """Return a namespace in the form of ROS, with its leading slash; empty for the root.

    Raises:
        InputError: the text is no namespace.
    """
    if text in ("", "/"):
        return ""
    if not _NAMESPACE.fullmatch(text):
        raise InputError(
            f"namespace: given '{text}'; it must be names of letters, digits and underscores that begin with "
            "no digit, with slashes between them, as field/left"
        )
    return "/" + text.lstrip("/")


def ros_arguments(parameters: Parameters, namespace: str) -> list[str]:
    """Command line arguments that give a node its parameters, its namespace and its remappings."""
    words = ["--ros-args", "--disable-external-lib-logs"]
    for key, value in parameters.items():
        words += ["-p", f"{key}:={parameter_text(value)}"]
    if namespace:
        words += ["-r", f"__ns:={namespace}"]
    for topic, to in remappings(namespace):
        words += ["-r", f"{topic}:={to}"]
    return words


def parameter_text(value: str | int | bool) -> str:
    """A parameter as rcl reads it (YAML): a text in quotes stays a text, also if it looks like a number."""
    return json.dumps(value, ensure_ascii=False)
