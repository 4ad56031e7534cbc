"""ROS packages that are in no package registry, for a scratch workspace: interfaces as they are published.

Written from the definitions of geometry2 (tf2_msgs/TFMessage) and of simulation_interfaces 2.0, as
docs.ros.org shows them, and only as far as this project uses them.
"""

from pathlib import Path

PACKAGES = {
    "tf2_msgs": {"msg/TFMessage.msg": "geometry_msgs/TransformStamped[] transforms\n"},
    "simulation_interfaces": {
        "msg/Result.msg": (
            "uint8 RESULT_FEATURE_UNSUPPORTED=0\nuint8 RESULT_OK=1\nuint8 RESULT_NOT_FOUND=2\n"
            "uint8 RESULT_INCORRECT_STATE=3\nuint8 RESULT_OPERATION_FAILED=4\n"
            "uint8 result\nstring error_message\n"
        ),
        "msg/SimulationState.msg": (
            "uint8 STATE_STOPPED=0\nuint8 STATE_PLAYING=1\nuint8 STATE_PAUSED=2\nuint8 STATE_QUITTING=3\n"
            "uint8 state\n"
        ),
        "msg/SimulatorFeatures.msg": (
            "uint8 SIMULATION_RESET=20\nuint8 SIMULATION_STATE_GETTING=24\n"
            "uint8 SIMULATION_STATE_SETTING=25\nuint8 SIMULATION_STATE_PAUSE=26\n"
            "uint8 STEP_SIMULATION_SINGLE=31\nuint8 STEP_SIMULATION_MULTIPLE=32\n"
            "uint8 STEP_SIMULATION_ACTION=33\n"
            "uint16[] features\nstring[] spawn_formats\nstring custom_info\n"
        ),
        "srv/GetSimulatorFeatures.srv": "---\nSimulatorFeatures features\n",
        "srv/GetSimulationState.srv": "---\nSimulationState state\nResult result\n",
        "srv/SetSimulationState.srv": (
            "SimulationState state\n---\nuint8 ALREADY_IN_TARGET_STATE=101\n"
            "uint8 STATE_TRANSITION_ERROR=102\nuint8 INCORRECT_TRANSITION=103\nResult result\n"
        ),
        "srv/StepSimulation.srv": "uint64 steps 1\n---\nResult result\n",
        "srv/ResetSimulation.srv": "uint8 SCOPE_DEFAULT=0\nuint8 scope\n---\nResult result\n",
        "action/SimulateSteps.action": (
            "uint64 steps\n---\nResult result\n---\nuint64 completed_steps\nuint64 remaining_steps\n"
        ),
    },
}

DEPENDENCIES = {"tf2_msgs": ["geometry_msgs"], "simulation_interfaces": ["action_msgs"]}


def write_packages(folder: Path, msg_defs: Path) -> None:
    """Their sources, each in a folder of its name; the build is that of subsoil_msgs (`msg_defs`)."""
    build = (msg_defs / "CMakeLists.txt").read_text(encoding="utf-8")
    filtering = build[build.index("# ROS wheels name") : build.index("ament_export_dependencies")]
    for package, files in PACKAGES.items():
        for name, text in files.items():
            path = folder / package / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        needed = DEPENDENCIES[package]
        found = "".join(f"find_package({name} REQUIRED)\n" for name in ("ament_cmake", *needed))
        listed = " ".join(f'"{name}"' for name in files)
        (folder / package / "CMakeLists.txt").write_text(
            f"cmake_minimum_required(VERSION 3.21)\nproject({package})\n{found}"
            "find_package(rosidl_default_generators REQUIRED)\n"
            f"rosidl_generate_interfaces({package} {listed} DEPENDENCIES {' '.join(needed)})\n"
            f"{filtering}ament_package()\n",
            encoding="utf-8",
        )
        depends = "".join(f"<depend>{name}</depend>" for name in needed)
        (folder / package / "package.xml").write_text(
            f'<package format="3"><name>{package}</name><version>0.0.0</version>'
            "<description>For a test.</description><maintainer email='none@scratch.invalid'>none</maintainer>"
            "<license>Apache-2.0</license><buildtool_depend>ament_cmake</buildtool_depend>"
            f"<buildtool_depend>rosidl_default_generators</buildtool_depend>{depends}"
            "<member_of_group>rosidl_interface_packages</member_of_group>"
            "<export><build_type>ament_cmake</build_type></export></package>\n",
            encoding="utf-8",
        )
