"""metadata.yaml as rosbag2 of Jazzy reads it (rosbag2_storage yaml.hpp, qos.cpp, version 9), field by field.

rosbag2 itself is in no package registry. What its reader demands is written down here: which keys it
looks up, as what type it takes them, and which words it knows.
"""

from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader

from subsoil_ros.recording.bag_writer import BagWriter, open_bag
from tests.unit.recording.recording_samples import RESOLVED, SCENE, TIMING, raw_messages, records_of

WORDS = {  # rmw_qos_*_policy_from_str
    "history": {"system_default", "keep_last", "keep_all"},
    "reliability": {"system_default", "reliable", "best_effort", "best_available"},
    "durability": {"system_default", "transient_local", "volatile", "best_available"},
    "liveliness": {"system_default", "automatic", "manual_by_topic", "best_available"},
}
UINT64 = range(2**64)


class OnlyText(yaml.SafeLoader):
    """Everything as text, as yaml-cpp keeps a scalar until it is asked for a type."""


OnlyText.yaml_implicit_resolvers = {}


def unsigned(text: str) -> int:
    """As yaml-cpp's as<uint64_t>()."""
    assert text.isdecimal(), text
    assert int(text) in UINT64
    return int(text)


def check_duration(node: dict[str, str]) -> None:
    """rmw_time_t."""
    unsigned(node["sec"])
    unsigned(node["nsec"])


def check_profile(node: dict[str, Any]) -> None:
    """convert<Rosbag2QoS>::decode; keep_last takes its depth as int."""
    for policy, words in WORDS.items():
        assert node[policy] in words
    assert unsigned(node["depth"]) < 2**31
    for name in ("deadline", "lifespan", "liveliness_lease_duration"):
        check_duration(node[name])
    assert node["avoid_ros_namespace_conventions"] in ("true", "false")


def check_metadata(node: dict[str, Any], file_name: str) -> dict[str, int]:
    """convert<BagMetadata>::decode. Gives the messages by topic."""
    assert unsigned(node["version"]) == 9
    assert node["storage_identifier"] == "mcap"
    unsigned(node["duration"]["nanoseconds"])
    unsigned(node["starting_time"]["nanoseconds_since_epoch"])
    counts = {}
    for topic in node["topics_with_message_count"]:
        metadata = topic["topic_metadata"]
        counts[metadata["name"]] = unsigned(topic["message_count"])
        assert metadata["serialization_format"] == "cdr"
        assert metadata["type"].count("/msg/") == 1
        assert metadata["type_description_hash"].startswith("RIHS01_")
        assert len(metadata["type_description_hash"]) == len("RIHS01_") + 64
        assert isinstance(metadata["offered_qos_profiles"], list)
        for profile in metadata["offered_qos_profiles"]:
            check_profile(profile)
    assert unsigned(node["message_count"]) == sum(counts.values())
    assert node["relative_file_paths"] == [file_name]
    assert (node["compression_format"], node["compression_mode"]) == ("", "")
    (file,) = node["files"]
    assert file["path"] == file_name
    unsigned(file["starting_time"]["nanoseconds_since_epoch"])
    unsigned(file["duration"]["nanoseconds"])
    assert unsigned(file["message_count"]) == sum(counts.values())
    assert all(isinstance(value, str) for item in (node["custom_data"] or {}).items() for value in item)
    assert node["ros_distro"] == "jazzy"
    return counts


@pytest.fixture
def full_bag(tmp_path: Path) -> Path:
    """A bag with every topic a run can have but commands."""
    writer = open_bag(tmp_path / "bag", RESOLVED)
    for tick in (0, 19, TIMING.tick_count - 1):
        for record in records_of(tick):
            writer.write(record)
    writer.close()
    return tmp_path / "bag"


def test_rosbag2_finds_every_field_it_asks_for(full_bag: Path) -> None:
    """In the folder's metadata.yaml, and in the copy inside the MCAP file, which a lone file is read by."""
    (path,) = full_bag.glob("*.mcap")
    document = yaml.load((full_bag / "metadata.yaml").read_text(), Loader=OnlyText)
    counts = check_metadata(document["rosbag2_bagfile_information"], path.name)
    expected: dict[str, int] = {}
    for topic, *_ in raw_messages(full_bag):
        expected[topic] = expected.get(topic, 0) + 1
    assert counts == expected
    with path.open("rb") as stream:
        inside = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
    serialized = yaml.load(inside["rosbag2"]["serialized_metadata"], Loader=OnlyText)
    assert check_metadata(serialized, path.name) == counts


def test_channels_say_the_same_as_the_metadata(full_bag: Path) -> None:
    """rosbag2's MCAP plugin takes profiles and hashes from the channels, types' texts from the schemas."""
    (path,) = full_bag.glob("*.mcap")
    document = yaml.safe_load((full_bag / "metadata.yaml").read_text())
    topics = {
        item["topic_metadata"]["name"]: item["topic_metadata"]
        for item in document["rosbag2_bagfile_information"]["topics_with_message_count"]
    }
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    for channel in summary.channels.values():
        topic, schema = topics[channel.topic], summary.schemas[channel.schema_id]
        assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
        assert schema.name == topic["type"]
        assert channel.metadata["topic_type_hash"] == topic["type_description_hash"]
        assert yaml.safe_load(channel.metadata["offered_qos_profiles"]) == topic["offered_qos_profiles"]


def test_what_comes_once_is_offered_to_late_comers(full_bag: Path) -> None:
    """URDF and meshes: who starts RViz after `ros2 bag play` gets them."""
    document = yaml.safe_load((full_bag / "metadata.yaml").read_text())
    durability = {
        item["topic_metadata"]["name"]: item["topic_metadata"]["offered_qos_profiles"][0]["durability"]
        for item in document["rosbag2_bagfile_information"]["topics_with_message_count"]
    }
    for topic in ("/subsoil/tool_markers", "/robot_description"):
        assert durability.pop(topic) == "transient_local"
    assert set(durability.values()) == {"volatile"}


def test_a_bag_of_nothing_is_readable_too(tmp_path: Path) -> None:
    """A run that failed before its first tick."""
    BagWriter(tmp_path / "bag", SCENE, TIMING).close()
    document = yaml.load((tmp_path / "bag/metadata.yaml").read_text(), Loader=OnlyText)
    assert check_metadata(document["rosbag2_bagfile_information"], "bag_0.mcap") == {}
