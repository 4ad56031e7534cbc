"""Bags whose writer was killed or whose file was cut: what is mended, and that others read it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.messages import ToolWrenches
from subsoil_ros.recording.bag_folder import CHUNK_BYTES
from subsoil_ros.recording.bag_reader import BagReader
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.recording.recovery import recover
from tests.unit.recording.recording_samples import (
    INTERVAL_NS,
    SCENE,
    SERIES_TICKS,
    end_ns,
    raw_messages,
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


WRITING = """
import sys
from pathlib import Path
sys.path[:0] = {paths!r}
from recording_samples import INTERVAL_NS, SCENE, write_long_bag
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.limits.stable_steps import Timing
write_long_bag(BagWriter(Path({bag!r}), SCENE, Timing(INTERVAL_NS, 10**9, 1, 1)), 10**9)
"""


def killed_writer(bag: Path, size_bytes: int) -> None:
    """Kills a process that writes a bag without end, in the middle of it, once the file has some size."""
    paths = [str(Path(__file__).parent), *(item for item in sys.path if item)]
    source = WRITING.format(paths=paths, bag=str(bag))
    process = subprocess.Popen([sys.executable, "-c", source])
    try:
        deadline = time.monotonic() + 120.0
        while sum(path.stat().st_size for path in bag.glob("*.mcap")) < size_bytes:
            assert process.poll() is None, "the writer ended"
            assert time.monotonic() < deadline
            time.sleep(0.01)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()


def test_a_writer_killed_while_it_writes_loses_at_most_the_last_chunk(tmp_path):
    """After SIGKILL in mid-write every whole chunk comes back, tick by tick, for readers of two makers."""
    bag = tmp_path / "bag"
    killed_writer(bag, 500_000)
    (path,) = bag.glob("*.mcap")
    written = path.stat().st_size
    result = recover(bag)
    assert path.stat().st_size > written - CHUNK_BYTES
    ticks = [record.tick for record in BagReader(bag).records(ToolWrenches)]
    assert ticks == list(range(len(ticks)))
    assert len(ticks) > 500
    with AnyReader([bag]) as reader:
        assert reader.message_count == result.message_count
        read = sum(
            reader.deserialize(data, connection.msgtype) is not None
            for connection, _, data in reader.messages()
        )
    assert read == result.message_count
    with path.open("rb") as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=["/subsoil/tool_wrenches"]
        )
        assert [item.decoded_message.tick for item in decoded] == ticks


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
