"""The tree as a ROS workspace: where `ros2 run` looks, `colcon test`, and packages that no registry has."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.scratch_packages import PACKAGES, write_packages

ROOT = Path(__file__).parents[2]
SOURCES = [
    "LICENSE",
    "README.md",
    "config",
    "launch",
    "msg_defs",
    "package.xml",
    "pyproject.toml",
    "resource",
    "scripts",
    "setup.cfg",
    "setup.py",
    "subsoil_ros",
    "tests",
    "validation",
]
PROGRAMS = ["controller_node", "coupler_node", "mechanism_node", "recorder_node", "soil_node", "subsoil"]


def shell_environment() -> dict[str, str]:
    """Environment of a shell in which .venv is activated.

    This process carries the library path of the ROS wheels and their mark that it is set: a build must not
    inherit them.
    """
    inherited = {key: os.environ[key] for key in ("HOME", "LANG", "TMPDIR") if key in os.environ}
    return {
        **inherited,
        "PATH": f"{sys.prefix}/bin:/usr/local/bin:/usr/bin:/bin",
        "VIRTUAL_ENV": sys.prefix,
        "AMENT_PREFIX_PATH": sys.prefix,
        "CMAKE_PREFIX_PATH": sys.prefix,
    }


def run(command: list[str | Path], directory: Path) -> str:
    """Standard output of a command that must succeed."""
    result = subprocess.run(
        command, cwd=directory, env=shell_environment(), capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def assert_is_ros_package(prefix: Path) -> None:
    """Fails unless `prefix` has what ROS tools look for: programs, marker, description, shared files."""
    programs = prefix / "lib" / "subsoil_ros"
    assert sorted(path.name for path in programs.iterdir()) == PROGRAMS
    assert all(os.access(path, os.X_OK) for path in programs.iterdir())
    share = prefix / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "subsoil_ros").is_file()
    assert (share / "subsoil_ros" / "package.xml").is_file()
    folders = (("config/scenes", "*.yaml"), ("config/meshes", "*.stl"), ("launch", "*.launch.py"))
    for folder, pattern in folders:
        expected = {path.name for path in (ROOT / folder).glob(pattern)}
        assert {path.name for path in (share / "subsoil_ros" / folder).glob(pattern)} == expected


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A copy of the sources, built as the documentation says."""
    directory = tmp_path_factory.mktemp("workspace")
    for name in SOURCES:
        source = ROOT / name
        if source.is_dir():
            ignored = shutil.ignore_patterns("__pycache__", "node_modules")
            shutil.copytree(source, directory / name, symlinks=True, ignore=ignored)
        else:
            shutil.copy2(source, directory / name)
    write_packages(directory / "scratch", directory / "msg_defs")
    scratch = [f"scratch/{name}" for name in PACKAGES]
    run(["colcon", "build", "--base-paths", ".", "msg_defs", *scratch], directory)
    return directory


def test_set_up_puts_the_package_where_ros2_looks():
    """After `make setup` the environment is a ROS prefix that holds this package."""
    assert_is_ros_package(Path(sys.prefix))


@pytest.mark.full
def test_colcon_puts_the_package_where_ros2_looks(workspace):
    """After `colcon build` install/subsoil_ros is a ROS prefix that holds this package."""
    assert_is_ros_package(workspace / "install" / "subsoil_ros")


@pytest.mark.full
def test_colcon_workspace_runs_its_own_code(workspace):
    """With install/setup.bash sourced, program, package and messages come from the workspace."""
    ask = "import subsoil_ros, subsoil_msgs.msg as m; print(subsoil_ros.__file__, m.Grant().tick, m.__file__)"
    lines = run(
        [
            "bash",
            "-c",
            f". install/setup.bash && cd / && python3 -c '{ask}' && "
            f"{workspace}/install/subsoil_ros/lib/subsoil_ros/subsoil --help",
        ],
        workspace,
    ).splitlines()
    package, tick, message = lines[0].split()
    assert Path(package).is_relative_to(workspace / "install" / "subsoil_ros")
    assert Path(message).is_relative_to(workspace / "install" / "subsoil_msgs")
    assert tick == "0"
    assert "usage: subsoil" in lines[1]


@pytest.mark.full
def test_colcon_test_passes(workspace):
    """`colcon test` of both packages, tests that need the compiled messages; `colcon test-result` counts.

    All tests take as long as `make test`; here are those of the types and their bytes under rclpy.
    """
    few = ["tests/unit/recording/test_recording_types.py", "tests/unit/recording/test_recording_rclpy.py"]
    command = ["colcon", "test", "--base-paths", ".", "msg_defs", "--return-code-on-test-failure"]
    run([*command, "--packages-select", "subsoil_msgs", "subsoil_ros", "--pytest-args", *few], workspace)
    said = run(["colcon", "test-result"], workspace)
    tests, errors, failures, skipped = map(int, re.findall(r"(\d+) (?:tests|errors|failures|skipped)", said))
    assert tests > 10
    assert (errors, failures) == (0, 0)
    assert skipped < tests // 2


def pytest_in(workspace: Path, *tests: str) -> None:
    """Runs tests in the workspace, with its packages; none may be skipped."""
    command = f". install/setup.bash && python3 -m pytest -q -p no:cacheprovider {' '.join(tests)}"
    said = run(["bash", "-c", command], workspace)
    assert re.search(r"^\d+ passed", said.splitlines()[-1]), said
    assert "skipped" not in said.splitlines()[-1], said


@pytest.mark.full
def test_where_simulation_interfaces_is_installed_its_types_are_served(workspace):
    """Every service and the action over DDS, in the standard's own messages."""
    ask = "from subsoil_ros.ros.nodes.run_services import dialect; print(dialect())"
    said = run(["bash", "-c", f". install/setup.bash && python3 -c '{ask}'"], workspace)
    assert "simulation_interfaces" in said
    assert "standard=True" in said
    pytest_in(workspace, "tests/system/test_simulation_services.py")


@pytest.mark.full
def test_where_tf2_msgs_is_installed_tf_is_live(workspace):
    """/tf arrives, with the bytes of the bag, and moves; and a soil follows it."""
    pytest_in(
        workspace,
        "tests/system/test_conventions.py::test_tf_moves_live",
        "tests/system/test_follow.py::test_frames_of_tf_are_followed",
    )
