"""The processes of a run: which nodes, with which parameters and remappings.

`subsoil run` and launch/subsoil.launch.py both start these processes. No ROS is imported.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...coupling.protocol import COUPLER, RECORDER, SOIL, nodes_from_outside, participants
from ...errors import InputError
from ...loading.loader import ResolvedScene

if TYPE_CHECKING:
    from ...api.opened_run import OpenedRun

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


@dataclass(frozen=True)
class RunPlan:
    """Settings of the nodes of a run.

    scene: the scene file as run; bag, checkpoints: folders to create; resume: a checkpoint, or none.
    supervised: whether a supervisor holds the standard input of every node (ros/process/supervisor.py).
    """

    resolved: ResolvedScene
    scene: Path
    run_id: str
    bag: Path
    checkpoints: Path | None = None
    resume: Path | None = None
    threads: int = 1
    paused: bool = False
    live: int = 0  # port of a live view; 0: there is none
    recorded: bool = True
    supervised: bool = False

    @classmethod
    def of(
        cls,
        opened: "OpenedRun",
        threads: int,
        paused: bool = False,
        supervised: bool = False,
        recorded: bool = True,
        live: int = 0,
    ) -> "RunPlan":
        """The plan of a run whose folder is made."""
        return cls(
            opened.resolved,
            scene=opened.out / "scene.yaml",
            run_id=opened.run_id,
            bag=opened.bag,
            checkpoints=opened.checkpoints,
            resume=opened.resumed.path if opened.resumed is not None else None,
            threads=threads,
            paused=paused,
            live=live,
            recorded=recorded,
            supervised=supervised,
        )

    def nodes(self) -> tuple[NodeStart, ...]:
        """The nodes to start, the coupler last; other programs provide the rest (nodes_from_outside)."""
        common: Parameters = {
            "scene": str(self.scene.resolve()),
            "run_id": self.run_id,
            "recorded": self.recorded,
            "supervised": self.supervised,
            "checkpoints": str(self.checkpoints.resolve()) if self.checkpoints is not None else "",
            "resume": str(self.resume.resolve()) if self.resume is not None else "",
        }
        own: dict[str, Parameters] = {
            SOIL: {"threads": self.threads},
            RECORDER: {"bag": str(self.bag.resolve()), "live": self.live},
            COUPLER: {"paused": self.paused},
        }
        left_out = {*nodes_from_outside(self.resolved.scene), *(() if self.recorded else (RECORDER,))}
        names = [name for name in participants(self.resolved.scene) if name not in left_out]
        return tuple(NodeStart(name, {**common, **own.get(name, {})}) for name in (*names, COUPLER))


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
