"""The bag of a real run, read by three makers: rosbags, mcap with mcap-ros2-support, Foxglove's libraries.

Each reads every message of every topic from the schemas inside the file. The digests of all times and
values, numbers by their bits, are the same.
"""

import hashlib
import json
import re
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from subsoil_ros.recording.types import typestore

HERE = Path(__file__).parent
Topics = dict[str, dict[str, Any]]


def bits(value: float) -> str:
    """Bits of a float64."""
    return struct.pack(">d", value).hex()


def values(value: Any, path: str) -> Iterator[str]:
    """Values of a message in the order of its fields, as read_bag.mjs writes them."""
    if isinstance(value, str):
        yield f'{path}="{value}"'
    elif isinstance(value, (bool, int, float, np.number)):
        yield f"{path}={bits(float(value))}"
    elif isinstance(value, bytes | bytearray | memoryview) or getattr(value, "dtype", None) == np.uint8:
        data = bytes(value)
        yield f"{path}=bytes {len(data)} {hashlib.sha256(data).hexdigest()}"
    elif isinstance(value, list | tuple | np.ndarray):
        yield f"{path}={len(value)} elements"
        for index, item in enumerate(value):
            yield from values(item, f"{path}[{index}]")
    else:
        for name in field_names(value):
            yield from values(getattr(value, name), f"{path}.{name}")


def field_names(message: Any) -> list[str]:
    """Fields of a message of either Python library, in the order of its definition."""
    if hasattr(message, "__msgtype__"):
        return [name for name, _ in typestore().fielddefs[message.__msgtype__][1]]
    names = getattr(message, "__slots__", None)
    return list(names if names is not None else vars(message))


def digested(messages: Iterator[tuple[str, int, Any]]) -> Topics:
    """Count, digest and first values by topic, of (topic, log time, message)."""
    topics: Topics = {}
    digests: dict[str, Any] = {}
    for name, time_ns, message in messages:
        lines = [f"time={time_ns}", *values(message, "")]
        topic = topics.setdefault(name, {"count": 0, "first": lines})
        topic["count"] += 1
        digests.setdefault(name, hashlib.sha256()).update(("\n".join(lines) + "\n").encode())
    for name, digest in digests.items():
        topics[name]["digest"] = digest.hexdigest()
    return topics


def mcap_file(bag: Path) -> Path:
    """The file in the folder."""
    (path,) = bag.glob("*.mcap")
    return path


@pytest.fixture(scope="module")
def by_rosbags(machine_bag: Path) -> Topics:
    """What rosbags reads."""
    with AnyReader([machine_bag]) as reader:
        return digested(
            (connection.topic, time_ns, reader.deserialize(data, connection.msgtype))
            for connection, time_ns, data in reader.messages()
        )


def test_every_topic_of_a_run_is_there(by_rosbags: Topics) -> None:
    """What is compared below is not nothing: all topics of a machine in soil, none empty."""
    assert set(by_rosbags) >= {
        "/clock", "/tf", "/subsoil/grant", "/subsoil/tool_motions", "/subsoil/tool_wrenches",
        "/subsoil/mechanism_state", "/subsoil/soil_state", "/subsoil/coupling_report", "/subsoil/soil/points",
        "/subsoil/tool_markers", "/subsoil/tool/shank/pose", "/subsoil/tool/shank/wrench",
    }  # fmt: skip
    assert all(topic["count"] > 0 for topic in by_rosbags.values())
    assert by_rosbags["/subsoil/grant"]["count"] == by_rosbags["/clock"]["count"] > 100


def test_mcap_with_ros2_support_reads_the_same(machine_bag: Path, by_rosbags: Topics) -> None:
    """mcap and mcap-ros2-support, the makers of the format."""
    decoder = pytest.importorskip("mcap_ros2.decoder")
    with mcap_file(machine_bag).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        found = digested(
            (item.channel.topic, item.message.log_time, item.decoded_message)
            for item in reader.iter_decoded_messages()
        )
    for name, topic in by_rosbags.items():
        assert found[name]["first"] == topic["first"]
    assert found == by_rosbags


@pytest.fixture(scope="module")
def node_modules() -> None:
    """The JavaScript libraries of package-lock.json; without node or npm there are none."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("node and npm are not installed")
    if not (HERE / "node_modules").is_dir():
        command = ["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund"]
        result = subprocess.run(command, cwd=HERE, capture_output=True, text=True, timeout=300, check=False)
        if result.returncode:
            pytest.skip(f"npm cannot install the libraries: {result.stderr.strip().splitlines()[-1:]}")


@pytest.mark.usefixtures("node_modules")
def test_the_libraries_of_foxglove_read_the_same(machine_bag: Path, by_rosbags: Topics) -> None:
    """@mcap/core and @foxglove/rosmsg2-serialization, which Foxglove itself opens bags with."""
    result = subprocess.run(
        ["node", str(HERE / "read_bag.mjs"), str(mcap_file(machine_bag))],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    found: Topics = json.loads(result.stdout)
    for name, topic in by_rosbags.items():
        assert found[name]["first"] == topic["first"]
    assert found == by_rosbags


def test_rerun_makes_particles_frames_and_curves_of_it(machine_bag: Path, tmp_path: Path) -> None:
    """A fourth maker: rerun's importer finds points, moving frames, URDF, and the fields that are plotted."""
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    program, recording = str(Path(sys.executable).with_name("rerun")), str(tmp_path / "bag.rrd")
    subprocess.run(
        [program, "mcap", "convert", str(mcap_file(machine_bag)), "--output", recording],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    result = subprocess.run(
        [program, "rrd", "print", recording], capture_output=True, text=True, timeout=120, check=True
    )
    found: dict[str, str] = {}
    for topic, columns in re.findall(r" - (/\S+) - data columns: \[(.*)\]", result.stdout):
        found[topic] = found.get(topic, "") + columns
    for topic, column in {
        "/subsoil/soil/points": "Points3D:positions",
        "/tf": "Transform3D:translation",
        "/robot_description": "TextDocument:text",
        "/subsoil/tool/shank/pose": "InstancePoses3D:translations",
        "/subsoil/mechanism_state": "subsoil_msgs.msg.MechanismState:message",
        "/subsoil/coupling_report": "subsoil_msgs.msg.CouplingReport:message",
    }.items():
        assert column in found[topic]
