"""The record of a run as the page draws it: its draft, the mean, and the newest soil, also while it grows."""

import os
import struct
from array import array
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import MAGIC_SIZE, breakup_chunk
from numpy.typing import NDArray

from ..analysis.columns import DRAFT, TIME, tick_cells
from ..analysis.metrics_window import metrics_window
from ..analysis.series import Series
from ..analysis.stationarity import stationarity
from ..loading.loader import load_scene
from ..messages import CouplingReport, MechanismState, SoilCloud, SoilState, ToolMotions, ToolWrenches
from ..recording.message_codec import reader
from ..recording.soil_clouds import cloud_from_message
from ..recording.topics import TOPIC_OF, bag_topic
from ..recording.types import deserialize, message_type
from ..schedule import Schedule

_RECORD = struct.Struct("<BQ")  # opcode and size of a record
_CLOUD, _POINTS = bag_topic(TOPIC_OF[SoilCloud]), message_type(SoilCloud)

MOST_PARTICLES = 50_000
"""Of the soil that is drawn: every second, third ... particle where there are more."""

MOST_POINTS = 1000
"""Of a curve: about the pixels of its width."""

STILL, FAST = (115.0, 82.0, 51.0), (242.0, 204.0, 26.0)
"""Colours: brown, and yellow for the fastest hundredth of the particles."""

GOLDEN = 0.618
"""Neighbours are darkened to different parts, so that one sees grains."""


class GrowingBag:
    """The messages of a bag file that is being written, each once."""

    def __init__(self, file: Path) -> None:
        self._file, self._at = file, MAGIC_SIZE
        self._topics: dict[int, str] = {}

    def added(self) -> Iterator[tuple[str, int, bytes]]:
        """Topic, time [ns] and bytes of what came since the last call; a record that is cut off waits.

        Raises:
            Errors of BROKEN: the file is damaged.
        """
        with self._file.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            while self._at + _RECORD.size <= size:
                stream.seek(self._at)
                opcode, length = _RECORD.unpack(stream.read(_RECORD.size))
                if self._at + _RECORD.size + length > size:
                    return
                self._at += _RECORD.size + length
                if opcode == Opcode.CHUNK:
                    chunk = Chunk.read(ReadDataStream(BytesIO(stream.read(length))))
                    yield from self._messages(chunk)

    def _messages(self, chunk: Chunk) -> Iterator[tuple[str, int, bytes]]:
        for record in breakup_chunk(chunk, validate_crc=True):
            if isinstance(record, Channel):
                self._topics[record.id] = record.topic
            elif isinstance(record, Message):
                yield self._topics[record.channel_id], record.log_time, record.data


class GrowingRun:
    """A run that goes on; of one that was resumed, what came since.

    Raises:
        InputError, OSError: its scene or its bag cannot be read.
    """

    def __init__(self, folder: Path, file: Path) -> None:
        self._resolved = resolved = load_scene(folder / "scene.yaml")
        self._scene, self._step_ns = resolved.scene, resolved.timing.communication_step_ns
        self._schedule, self._bag = Schedule.of(self._scene, resolved.timing), GrowingBag(file)
        kinds: list[type] = [ToolMotions, CouplingReport]
        kinds += [MechanismState] * (self._scene.mechanism is not None)
        kinds += [ToolWrenches, SoilState] * (self._scene.soil is not None)
        self._readers = {bag_topic(TOPIC_OF[kind]): (kind, reader(kind)) for kind in kinds}
        self._ticks: dict[int, dict[type, Any]] = {}  # not yet complete
        self._kept = array("d"), array("d"), array("d")  # time, draft, whether it counts for the mean

    def look(self) -> bytes:
        """Read what was added; the newest soil of it, b"" without one."""
        newest, columns = b"", dict[str, list[float]]()
        for topic, time_ns, data in self._bag.added():
            if topic == _CLOUD:
                newest = data
            elif topic in self._readers and self._schedule.series_due(time_ns // self._step_ns - 1):
                kind, read = self._readers[topic]
                self._ticks.setdefault(time_ns, {})[kind] = read(data)
                if len(self._ticks[time_ns]) == len(self._readers):
                    for name, value in tick_cells(self._scene, self._ticks.pop(time_ns)):
                        columns.setdefault(name, []).append(value)
        if DRAFT in columns:
            series = Series({name: np.array(values) for name, values in columns.items()}, "", 0.0)
            window = metrics_window(series, self._resolved)
            counts = window.rows & (not window.whole_run)
            for kept, values in zip(self._kept, (series[TIME], series[DRAFT], counts), strict=True):
                kept.extend(values.tolist())
        return soil_bytes(cloud_from_message(deserialize(newest, _POINTS), self._step_ns)) if newest else b""

    def draft(self) -> dict[str, Any]:
        """As `drawn`."""
        times, draft, counts = map(np.array, self._kept)
        if not len(times):
            return drawn(times, draft, self._scene.duration_s)
        rows = next(rows for rows in (counts > 0.0, times > 0.0, times <= 0.0) if rows.any())
        known = stationarity(times[rows], draft[rows])
        half = None if known is None else known.mean_half_width
        return drawn(times, draft, self._scene.duration_s, float(draft[rows].mean()), half)


def drawn(
    time_s: NDArray[np.float64], draft_newton: NDArray[np.float64], duration_s: float,
    mean: float | None = None, half_width: float | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Time [s] and draft [N] so far, duration [s] of the scene, and the mean with its interval in words."""
    words = "" if mean is None else f"{mean:.0f} N"
    words += "" if half_width is None else f" +- {half_width:.0f} N"
    every = -(-len(time_s) // MOST_POINTS) or 1
    some = slice((len(time_s) - 1) % every, None, every)  # the last is among them
    return {
        "time_s": time_s[some].tolist(), "draft_newton": draft_newton[some].tolist(),
        "duration_s": duration_s, "mean": words,
    }  # fmt: skip


def soil_bytes(cloud: SoilCloud) -> bytes:
    """What soil.js draws; b"" without particles.

    float64: time [s], longest side of the box around most of the soil and side of the cube of a grain [m];
    float32 (n, 3): positions [m] from the median of the soil; uint8 (n, 3): colours.
    """
    positions, speeds = np.asarray(cloud.positions_m), np.asarray(cloud.speeds_m_per_s)
    if not len(speeds):
        return b""
    every = -(-len(speeds) // MOST_PARTICLES)
    positions, speeds = positions[::every], speeds[::every]
    moved = np.clip(speeds / max(float(np.percentile(speeds, 99)), 1e-3), 0.0, 1.0)[:, None]
    grain = 1.0 - 0.3 * (GOLDEN * np.arange(len(speeds)) % 1.0)[:, None]
    colours = (grain * (np.array(STILL) + moved * np.subtract(FAST, STILL))).astype(np.uint8)
    places = (positions - np.median(positions, axis=0)).astype("<f4")
    sides = np.ptp(np.percentile(places, (1.0, 99.0), axis=0), axis=0)
    head = struct.pack("<ddd", cloud.end_time_ns * 1e-9, sides.max(), (sides.prod() / len(places)) ** (1 / 3))
    return head + places.tobytes() + colours.tobytes()
