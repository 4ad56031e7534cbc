"""`subsoil bag info`: counts, rates, sizes, types, packing, notes and run of a bag."""

import json
from pathlib import Path

import pytest
from mcap.reader import make_reader

from subsoil_ros.cli.main import main
from subsoil_ros.errors import RecordingError
from subsoil_ros.messages import Command, Grant
from subsoil_ros.recording.bag_info import describe
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.recording.types import type_hash
from tests.unit.recording.recording_samples import (
    INTERVAL_NS,
    SCENE,
    SERIES_TICKS,
    TICKS,
    TIMING,
    end_ns,
    raw_messages,
)


def test_counts_sizes_and_rates_are_those_of_the_messages(bag: Path) -> None:
    """As mcap's own reader gives them, one by one."""
    facts = describe(bag)
    expected: dict[str, list[int]] = {}
    for topic, _, _, _, data in raw_messages(bag):
        expected.setdefault(topic, []).append(len(data))
    assert {topic.name: (topic.message_count, topic.size_bytes) for topic in facts.topics} == {
        name: (len(sizes), sum(sizes)) for name, sizes in expected.items()
    }
    by_name = {topic.name: topic for topic in facts.topics}
    assert by_name["/subsoil/grant"].rate_hz == pytest.approx(1e9 / INTERVAL_NS, rel=1e-12)
    assert by_name["/subsoil/soil/points"].rate_hz == 0.0
    assert by_name["/tf"].type_hash == type_hash("tf2_msgs/msg/TFMessage")
    assert facts.span_ns == (end_ns(0), end_ns(TICKS - 1))
    assert facts.message_count == len(raw_messages(bag))


def test_packing_is_that_of_the_chunks(bag: Path) -> None:
    """Sizes before and after compression, from the index of the file."""
    facts = describe(bag)
    with facts.path.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert (facts.chunk_count, facts.compression) == (len(chunks), "zstd")
    assert facts.chunk_bytes == sum(chunk.uncompressed_size for chunk in chunks)
    assert facts.packed_bytes == sum(chunk.compressed_size for chunk in chunks) < facts.file_bytes
    assert facts.file_bytes == facts.path.stat().st_size
    assert (facts.profile, facts.library) == ("ros2", "subsoil_ros")


@pytest.mark.parametrize(("last", "complete"), [(Command.END, True), (Command.RUN, False)])
def test_run_and_its_end_are_read_from_the_grants(tmp_path: Path, last: Command, complete: bool) -> None:
    """A bag whose last grant is not END was cut."""
    writer = BagWriter(tmp_path / "bag", SCENE, TIMING)
    for tick in range(5):
        writer.write(Grant("run7", tick, last if tick == 4 else Command.RUN))
    writer.close()
    facts = describe(tmp_path / "bag")
    assert (facts.run_id, facts.complete) == ("run7", complete)
    assert facts.notes["series"] == f"the start, every {SERIES_TICKS} ticks, and the last"


def test_the_verb_prints_it_all(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Topics, hashes, packing, run and notes on screen; the same as JSON."""
    assert main(["bag", "info", str(bag)]) == 0
    text = capsys.readouterr().out
    for part in (
        "/subsoil/tool_wrenches", "subsoil_msgs/msg/ToolWrenches", type_hash("subsoil_msgs/msg/ToolWrenches"),
        "zstd", "profile 'ros2'", "run run, to its end", "series: the start, every 20 ticks",
        "of simulated time",
    ):  # fmt: skip
        assert part in text
    assert main(["bag", "info", "--json", str(bag)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["run_id"] == "run"
    assert document["complete"] is True
    counts = {topic["name"]: topic["message_count"] for topic in document["topics"]}
    assert counts["/clock"] == TICKS


def test_a_damaged_chunk_is_an_error_with_its_cure(bag: Path) -> None:
    """Not a number that is wrong."""
    (path,) = bag.glob("*.mcap")
    with path.open("rb") as stream:
        chunk = make_reader(stream).get_summary().chunk_indexes[0]
    content = bytearray(path.read_bytes())
    middle = chunk.chunk_start_offset + chunk.chunk_length // 2
    content[middle] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="subsoil bag recover"):
        describe(bag)


def test_an_empty_bag_is_described(tmp_path: Path) -> None:
    """No message, no topic, no division by zero."""
    BagWriter(tmp_path / "bag", SCENE, TIMING).close()
    facts = describe(tmp_path / "bag")
    assert (facts.topics, facts.message_count, facts.span_ns, facts.run_id) == ((), 0, (0, 0), "")
    assert main(["bag", "info", str(tmp_path / "bag")]) == 0


def test_a_bag_without_scene_is_refused(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bags of other makers: exit 2, and what to name instead; nothing is written."""
    before = sorted(bag.parent.iterdir())
    for verb in ("report", "render"):
        assert main([verb, str(bag)]) == 2
        err = capsys.readouterr().err
        assert len(err.strip().splitlines()) == 1
        assert "contains no scene" in err
        assert "name the folder of its run" in err
    assert sorted(bag.parent.iterdir()) == before
