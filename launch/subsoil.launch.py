"""Launch file of a run: the processes of `subsoil run`, from the same plan (ros/process/node_plan.py).

ros2 launch subsoil_ros subsoil.launch.py scene:=my_scene.yaml namespace:=left
"""

from __future__ import annotations

import shlex
import sys
import time
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, ExecuteProcess, LogInfo, OpaqueFunction, TimerAction
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, SetParameter
from launch_ros.parameter_descriptions import ParameterValue

from subsoil_ros.api.run_frame import open_run
from subsoil_ros.cli.progress import KernelAnnouncer, bed_progress
from subsoil_ros.cli.run.simulation import live_port, say_opened, say_where
from subsoil_ros.coupling.run_options import OPTIONS
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.coupling.time_limits import LAUNCH_PATIENCE_S
from subsoil_ros.errors import InputError, RunError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.ros.process.node_plan import checked_namespace, nodes_of, remappings
from subsoil_ros.ros.transport.shared_memory import avoid_full_memory

DEFAULT_SCENE = "config/scenes/subsoiler_1s300_wedge.yaml"

ARGUMENTS = {
    "scene": (None, "scene file (.yaml); default: the machine on the wedge model"),
    "out": ("", "folder for the results, which must not exist; empty: runs/<time>"),
    "mode": ("nodes", "nodes: one process per node; composed: all in one process; direct: no ROS"),
    "recording": ("true", "whether the run has a recorder, which writes the bag"),
    "namespace": ("", "of all nodes and topics, also /clock and /tf, so that runs can share a domain"),
    "use_sim_time": ("false", "for other nodes of this launch; the nodes of the run ignore it"),
    **{name: (str(option.default).lower(), option.description) for name, option in OPTIONS.items()},
    "resume": ("", "folder of an earlier run of the scene, to continue from its newest checkpoint"),
    "live": ("", "port of a live view for Foxglove; 0: any free port; empty: none"),
    "rviz": ("false", "whether RViz shows the run"),
    "overrides": ("", 'changes of the scene, as "soil.bed.seed=3 duration_s=1.0"'),
}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments, and the function that starts the processes."""
    share = Path(get_package_share_directory("subsoil_ros"))
    declared = [
        DeclareLaunchArgument(
            name, default_value=str(share / DEFAULT_SCENE) if default is None else default, description=words
        )
        for name, (default, words) in ARGUMENTS.items()
    ]
    return LaunchDescription(
        [
            *declared,
            SetParameter("use_sim_time", LaunchConfiguration("use_sim_time")),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the actions that start the processes of the run."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    scene, recording = given["scene"], flag("recording", given["recording"])
    options = {name: option.parsed(name, given[name]) for name, option in OPTIONS.items()}
    out = Path(given["out"] or f"runs/{time.strftime('%Y%m%d-%H%M%S')}")
    namespace = checked_namespace(given["namespace"])
    overrides = shlex.split(given["overrides"])
    viewers = [rviz(namespace)] if flag("rviz", given["rviz"]) else []
    if given["mode"] != "nodes":
        if not recording:
            raise InputError("recording: given false, but only mode:=nodes runs without a recorder")
        command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", scene, "--out", str(out)]
        command += ["--mode", given["mode"]]
        command += [f"--namespace={namespace}"] if namespace else []
        for name, value in options.items():
            command += OPTIONS[name].arguments(name, value)
        command += ["--resume", given["resume"]] if given["resume"] else []
        command += ["--live", given["live"]] if given["live"] else []
        command += [word for change in overrides for word in ("--set", change)]
        return [ExecuteProcess(cmd=command, output="screen", on_exit=Ending(1)), *viewers]
    notice = avoid_full_memory()  # for the nodes too: they inherit the environment
    live = live_port(given["live"] or None)
    resume = Path(given["resume"]) if given["resume"] else None
    settings = RunSettings(load_scene(scene, overrides), recorded=recording, live_port=live, **options)
    with KernelAnnouncer():
        frame = open_run(settings, out, resume, shown=scene, bed_progress=bed_progress)
    say_opened(frame)
    started = nodes_of(frame.settings, frame.scene)
    say_where(live)
    ending = Ending(len(started))
    nodes = [
        Node(
            package="subsoil_ros",
            executable=node.executable,
            namespace=namespace,
            parameters=[
                # typed, because launch_ros reads a plain text as YAML: "7" would become a number
                {key: ParameterValue(value, value_type=type(value)) for key, value in node.parameters.items()}
            ],
            remappings=list(remappings(namespace)),
            ros_arguments=["--disable-external-lib-logs"],
            output="screen",
            on_exit=ending,
        )
        for node in started
    ]
    words = f"run '{frame.settings.run_id}' in {out}; `subsoil report {out}` makes series and figures of it"
    return [*([LogInfo(msg=notice)] if notice else []), LogInfo(msg=words), *nodes, *viewers]


def rviz(namespace: str) -> Node:
    """RViz, in the time of the run."""
    share = Path(get_package_share_directory("subsoil_ros"))
    shown = ("/clock", "/tf", "/robot_description", "/soil/points", "/tool_markers")
    return Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", str(share / "config" / "rviz" / "subsoil.rviz")],
        parameters=[{"use_sim_time": True}],
        remappings=[(topic, f"{namespace}{topic}") for topic in shown] if namespace else [],
    )


class Ending:
    """Handler for the end of each process of the run: after a failure the launch ends with status 1.

    First the other nodes have time to report the failed node and to close the bag. The error raised here
    makes launch shut down the remaining processes and end with status 1.
    """

    def __init__(self, count: int) -> None:
        self._left = count
        self._first = ""

    def __call__(self, event: ProcessExited, context: LaunchContext) -> TimerAction | None:
        """Return the action after the end of a process: None, or a time limit for the others."""
        self._left -= 1
        begun = not self._first and event.returncode != 0
        if begun:
            self._first = f"{event.process_name} ended with status {event.returncode}"
        if self._first and self._left == 0:
            self.fail(context)
        if not begun or context.is_shutdown:
            return None
        return TimerAction(period=LAUNCH_PATIENCE_S, actions=[OpaqueFunction(function=self.fail)])

    def fail(self, context: LaunchContext) -> None:
        """End the launch. Raises RunError with the first failure."""
        raise RunError(f"the run failed: {self._first}")


def flag(name: str, text: str) -> bool:
    """Value of a launch argument that is true or false."""
    if text.lower() not in ("true", "false"):
        raise InputError(f"{name}: given '{text}', allowed are true and false")
    return text.lower() == "true"
