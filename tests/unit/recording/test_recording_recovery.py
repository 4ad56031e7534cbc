"""Bags whose writer was killed or whose file was cut: what is mended, and that others read it."""

import os
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from subsoil_ros.errors import InputError
from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.recording.bag_info import describe
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.recording.recovery import recover
from tests.unit.recording.recording_samples import (
    INTERVAL_NS,
    SCENE,
    SERIES_TICKS,
    TICKS,
    end_ns,
    raw_messages,
    records_of,
    write_long_bag,
)


def test_a_truncated_bag_is_mended(tmp_path):
    """Cut anywhere, the whole chunks come back in order, equal bit for bit, for readers of all makers."""
    writer = BagWriter(tmp_path / "bag", SCENE, Timing(INTERVAL_NS, 1500, 1, 1))
    write_long_bag(writer, 1500)
    writer.close()
    path = next((tmp_path / "bag").glob("*.mcap"))
    everything = raw_messages(tmp_path / "bag")
    with path.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    third = chunks[2]
    os.truncate(path, third.chunk_start_offset + third.chunk_length // 2)
    (tmp_path / "bag/metadata.yaml").unlink()

    result = recover(tmp_path / "bag")

    mended = raw_messages(tmp_path / "bag")
    assert mended == everything[: len(mended)]
    assert end_ns(100) < mended[-1][1] <= third.message_start_time
    assert (result.message_count, result.end_time_ns) == (len(mended), mended[-1][1])
    assert result.damaged_path.is_file()
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == len(mended)
    assert recover(tmp_path / "bag").damaged_path is None


def test_a_bag_that_is_being_written_is_read_and_left_alone(tmp_path, caplog):
    """Readers say who writes it and read what is there; `recover` refuses; the writer goes on to its end."""
    writer = BagWriter(tmp_path / "bag", SCENE, Timing(INTERVAL_NS, 1500, 1, 1))
    write_long_bag(writer, 1000)
    found = describe(tmp_path / "bag")
    assert f"is being written by process {os.getpid()}; reading what is there" in caplog.text
    assert found.message_count > 1000
    with pytest.raises(InputError, match=f"written by process {os.getpid()}; wait for its end"):
        recover(tmp_path / "bag")
    for record in records_of(TICKS - 1)[1:3]:
        writer.write(type(record)("run", 1000, end_ns(1000), record.tools))
    writer.close()
    assert {item.suffix for item in (tmp_path / "bag").iterdir()} == {".mcap", ".yaml"}
    whole = describe(tmp_path / "bag").message_count
    assert found.message_count < whole == len(raw_messages(tmp_path / "bag"))


def test_only_the_file_named_is_touched(tmp_path):
    """A whole file by itself is left alone; a stranger's metadata.yaml stays where another file is mended."""
    writer = BagWriter(tmp_path / "bag", SCENE, Timing(INTERVAL_NS, 1500, 1, 1))
    write_long_bag(writer, 1500)
    writer.close()
    folder = tmp_path / "mine"
    folder.mkdir()
    path = next((tmp_path / "bag").glob("*.mcap")).rename(folder / "alone.mcap")
    before = path.read_bytes()
    assert recover(path).damaged_path is None
    assert path.read_bytes() == before
    stranger = "rosbag2_bagfile_information: {relative_file_paths: [other.mcap]}\n"
    (folder / "metadata.yaml").write_text(stranger)
    (folder / "other.mcap").write_bytes(b"")
    path.write_bytes(before[:-1])
    assert recover(path).damaged_path is not None
    assert (folder / "metadata.yaml").read_text() == stranger
    files = {"alone.mcap", "alone.mcap.damaged", "other.mcap", "metadata.yaml"}
    assert {item.name for item in folder.iterdir()} == files


def test_a_damaged_description_is_replaced_and_kept(tmp_path):
    """metadata.yaml of a bag whose file has another name, or cut off: the mended bag has its own."""
    writer = BagWriter(tmp_path / "bag", SCENE, Timing(INTERVAL_NS, 1500, 1, 1))
    write_long_bag(writer, 1500)
    writer.close()
    bag = tmp_path / "bag"
    path = next(bag.glob("*.mcap")).rename(bag / "renamed.mcap")
    assert recover(bag).damaged_path is None  # a whole bag is left alone
    path.write_bytes(path.read_bytes()[:-1])
    described = (bag / "metadata.yaml").read_text()
    recover(bag)
    assert (bag / "metadata.yaml.damaged").read_text() == described
    with AnyReader([bag]) as reader:
        assert reader.message_count > 0


def test_the_bag_says_what_was_thinned(bag: Path) -> None:
    """Every how many ticks clouds and series are there: in file and metadata.yaml, also when mended."""
    expected = {
        "communication_step_ns": str(INTERVAL_NS),
        "lockstep_messages": "every tick",
        "series": f"the start, every {SERIES_TICKS} ticks, and the last",
        "clouds": f"thinned: every {round(0.1e9 / INTERVAL_NS)} ticks, and the last",
    }
    (path,) = bag.glob("*.mcap")
    path.write_bytes(path.read_bytes()[:-1])  # no footer any more
    recover(bag)
    with path.open("rb") as stream:
        notes = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
    assert notes["subsoil_ros"] == expected
    metadata = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert metadata["custom_data"] == expected
    with AnyReader([bag]) as reader:  # others still read it
        assert reader.message_count > 0
