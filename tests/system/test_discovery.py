"""Who can hear a run: no other machine unless the environment allows it, and none unprotected."""

import subprocess
import sys
from pathlib import Path

import pytest

from subsoil_ros.ros.process.supervisor import start_node
from tests.system.conftest import SCENE

VARIABLES = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "ROS_DOMAIN_ID")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, ["LOCALHOST", "None", "9"]),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, ["SUBNET", "None", "9"]),
        ({"ROS_STATIC_PEERS": "10.0.0.2"}, ["LOCALHOST", "10.0.0.2", "9"]),
    ],
)
def test_the_environment_sets_the_range(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: dict[str, str], expected: list[str]
) -> None:
    """Localhost by default; what is set reaches the nodes as it is, with the run's own domain."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    words = f"import os; print(*[os.environ.get(name) for name in {VARIABLES}])"
    node = start_node("soil", ("-c", words), tmp_path / "log", {}, 9)
    assert node.popen.wait(30.0) == 0
    node.popen.stdin.close()
    assert (tmp_path / "log").read_text().split() == expected


def test_security_that_cannot_be_had_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Asked for security, a Fast DDS without it runs nothing: exit 3, its words on one line, no traceback."""
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(tmp_path))
    (tmp_path / "enclaves").mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "subsoil_ros.ros.nodes.coupler_node", "--ros-args", "-p", f"scene:={SCENE}"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    if "security libraries" not in done.stderr and "security files" in done.stderr:
        pytest.skip("this Fast DDS has security, and asks for a keystore")
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    line = done.stderr.strip().splitlines()[-1]
    assert line.startswith("coupler: no ROS node can be made: ")
    assert "doesn't have the security libraries" in line
