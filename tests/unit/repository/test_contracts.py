"""Rules of the repository that a machine can check."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

import subsoil_ros
from subsoil_ros import messages
from tests.units import field_lines, unit_of

ROOT = Path(__file__).parents[3]
LISTS = sorted(path for path in (ROOT / "requirements").glob("*.txt") if path.stem != "lock")
MESSAGE_FILES = sorted((ROOT / "msg_defs" / "msg").glob("*.msg"))
UNIT_IN_COMMENT = re.compile(r"\[[^\]]+\]")


def constants(text: str) -> dict[str, int]:
    """Constants of a message text."""
    return {name: int(value) for name, value in re.findall(r"^uint8 ([A-Z]+)=(\d+)\b", text, re.MULTILINE)}


@pytest.mark.parametrize("path", MESSAGE_FILES, ids=lambda path: path.stem)
def test_every_message_field_has_a_unit(path):
    """A reader of a message needs no other document to know its units."""
    without = [
        name
        for _, name, comment in field_lines(path.read_text())
        if not unit_of(name) and not UNIT_IN_COMMENT.search(comment)
    ]
    assert not without


@pytest.mark.parametrize(
    ("message", "enumeration"), [("Grant", messages.Command), ("NodeStatus", messages.NodeState)]
)
def test_constants_are_those_of_the_records(message, enumeration):
    """A number on the wire means the same on both sides."""
    text = (ROOT / "msg_defs" / "msg" / f"{message}.msg").read_text()
    assert constants(text) == {member.name: member.value for member in enumeration}


def test_cmake_builds_every_message():
    """No message file is forgotten in CMakeLists.txt."""
    text = (ROOT / "msg_defs" / "CMakeLists.txt").read_text()
    assert sorted(re.findall(r'"msg/(\w+)\.msg"', text)) == [path.stem for path in MESSAGE_FILES]
    services = sorted(path.stem for path in (ROOT / "msg_defs" / "srv").glob("*.srv"))
    assert sorted(re.findall(r'"srv/(\w+)\.srv"', text)) == services
    actions = sorted(path.stem for path in (ROOT / "msg_defs" / "action").glob("*.action"))
    assert sorted(re.findall(r'"action/(\w+)\.action"', text)) == actions


def test_one_version_everywhere():
    """Both ROS packages and the Python package carry the same version."""
    found = {
        "package.xml": ElementTree.parse(ROOT / "package.xml").findtext("version"),
        "msg_defs/package.xml": ElementTree.parse(ROOT / "msg_defs" / "package.xml").findtext("version"),
    }
    pyproject = (ROOT / "msg_defs" / "pyproject.toml").read_text()
    found["msg_defs/pyproject.toml"] = re.search(r'^version = "(.+)"$', pyproject, re.MULTILINE).group(1)
    assert set(found.values()) == {subsoil_ros.__version__}, found


@pytest.mark.parametrize("name", [path.stem for path in LISTS])
def test_every_requirement_is_locked(name):
    """Set-up installs exact versions only, and lock.txt is the one place that names them."""
    lock = (ROOT / "requirements" / "lock.txt").read_text().lower()
    wanted = (ROOT / "requirements" / f"{name}.txt").read_text().splitlines()
    names = [
        line.split(";")[0].split("[")[0].lower().replace("_", "-")
        for line in wanted
        if line and not line.startswith("#")
    ]
    assert [name for name in names if f"\n{name}==" not in lock] == []
