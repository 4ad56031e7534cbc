"""Bags and checkpoints of a process that is killed while it writes them."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from subsoil_ros.messages import ToolWrenches
from subsoil_ros.recording.bag_folder import CHUNK_BYTES
from subsoil_ros.recording.bag_reader import BagReader
from subsoil_ros.recording.checkpoint import KEPT, newest_valid
from subsoil_ros.recording.recovery import recover

CHECKPOINTS = """
import sys
from pathlib import Path
import numpy as np
from subsoil_ros.recording.checkpoint import commit, write_part
for tick in range(int(sys.argv[2]), 10**6):
    write_part(Path(sys.argv[1]), tick, "soil", {"array": np.full(30_000, float(tick))})
    write_part(Path(sys.argv[1]), tick, "mechanism", {"tick": np.array(tick)})
    commit(Path(sys.argv[1]), tick, ["soil", "mechanism"],
           {"time_s": 0.0, "run_id": "", "scene_hash": "", "coupling": {}})
    print(tick, flush=True)
"""


BAG = """
import sys
from pathlib import Path
sys.path[:0] = {paths!r}
from tests.unit.recording.recording_samples import INTERVAL_NS, SCENE, write_long_bag
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.limits.stable_steps import Timing
write_long_bag(BagWriter(Path({bag!r}), SCENE, Timing(INTERVAL_NS, 10**9, 1, 1)), 10**9)
"""


def killed_writer(bag: Path, size_bytes: int) -> None:
    """Kills a process that writes a bag without end, in the middle of it, once the file has some size."""
    paths = [str(Path(__file__).parents[2]), *(item for item in sys.path if item)]
    source = BAG.format(paths=paths, bag=str(bag))
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


def test_killed_at_any_moment_there_is_a_whole_one(tmp_path: Path) -> None:
    """kill -9 of a process that does nothing but write checkpoints: the newest valid one never goes back."""
    chance, last = random.Random(1), -1
    for _ in range(8):
        process = subprocess.Popen(
            [sys.executable, "-c", CHECKPOINTS, str(tmp_path), str(last + 1)], stdout=subprocess.PIPE
        )
        assert process.stdout is not None
        process.stdout.readline()  # one was written
        time.sleep(0.1 * chance.random())
        process.kill()
        process.communicate()
        found, refusals = newest_valid(tmp_path)
        assert refusals == []
        assert found.tick > last
        assert (found.read_part("soil")["array"] == found.tick).all()
        assert found.read_part("mechanism")["tick"] == found.tick
        last = found.tick
    assert len(list(tmp_path.glob("*/manifest.json"))) <= KEPT + 1
