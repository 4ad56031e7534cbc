"""Records of a run into a bag, and into a live view: the same content whether records or bytes come in."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import ProtocolError, RecordingError, SubsoilError
from ..limits.stable_steps import Timing
from ..loading.loader import ResolvedScene
from ..loading.scene_bundle import SceneBundle, pack
from ..messages import (
    CouplingReport,
    Grant,
    MechanismState,
    RunRecord,
    SoilCloud,
    SoilState,
    ToolMotions,
    ToolWrenches,
)
from ..scene.record import SPEED_BITS, position_step_m
from ..scene.scene import Scene
from ..schedule import Schedule
from ..ticks import INITIAL_TICK, tick_end_ns
from .bag_folder import BagFolder, TopicInfo
from .bag_reader import scene_attachments, scene_notes
from .live_view import SERIES_DEPTH, LiveView
from .message_codec import reader, standard_bytes, writer
from .soil_clouds import cloud_from_message, height_map
from .standard_messages import clock, latched_messages, tool_messages, transforms
from .topics import (
    CLOCK,
    HEIGHT_MAP,
    LATCHED,
    RECORD_OF,
    TOPIC_OF,
    TRANSFORMS,
    bag_topic,
    derived_topics,
    qos_profile,
    recorded_topics,
)
from .types import Message, deserialize, message_type, schema_text, serialize, type_hash

_RANK = {topic: rank for rank, topic in enumerate(RECORD_OF)}
_NEEDED_FOR_VISUALIZATION = {TOPIC_OF[kind] for kind in (ToolMotions, ToolWrenches, MechanismState)}
_NEWEST_ONLY = {CLOCK, HEIGHT_MAP, *RECORD_OF} - {
    TOPIC_OF[kind] for kind in (MechanismState, SoilState, CouplingReport)
}
"""Topics of every tick, and clouds: a live view shows only the newest message since its last delivery."""

_CLOUD = TOPIC_OF[SoilCloud]


class _Pending(NamedTuple):
    rank: int
    topic: str
    data: bytes
    record: Any  # None if it came as bytes


class BagWriter:
    """Writes the bag of a run tick by tick, and derives the standard messages.

    Ticks come in ascending order, the records of one tick in any order: a tick is written when the next
    one begins. In the bag they have the order of recording/topics.py, a cloud followed by the height map, on
    series ticks followed by poses, wrenches and /tf, then by /clock. Not for use from several threads at
    once.
    """

    def __init__(
        self,
        directory: Path,
        scene: Scene,
        timing: Timing,
        latched: Mapping[str, Message] | None = None,
        live_port: int = 0,
        bundle: SceneBundle | None = None,
    ) -> None:
        """Create `directory` with the bag in it.

        latched: messages by topic (description.latched_messages), written at the time of the first tick.
        live_port: where a live view serves; 0: there is none.
        bundle: the scene, so that the bag is complete alone.

        Raises:
            InputError: it exists or cannot be created, or the live view cannot serve.
            RecordingError: the definitions of subsoil_msgs are not found.
        """
        self._scene, self._soil = scene, scene.particle_soil or scene.terrain_soil
        self._communication_step_ns = timing.communication_step_ns
        self._schedule = Schedule.of(scene, timing)
        self._types = {topic: message_type(kind) for topic, kind in RECORD_OF.items()}
        self._types.update(derived_topics(scene) | LATCHED)
        self._writers = {kind: writer(kind, timing.communication_step_ns) for kind in TOPIC_OF}
        self._readers = {topic: reader(RECORD_OF[topic]) for topic in _NEEDED_FOR_VISUALIZATION}
        self._latched = dict(latched or {})  # not yet written
        self._tick = INITIAL_TICK
        self._pending: list[_Pending] = []  # of self._tick
        schema_text(message_type(Grant))  # without message definitions there is no bag
        self._live = self._open_live_view(live_port) if live_port else None
        try:
            notes, attachments = scene_notes(bundle), scene_attachments(bundle)
            self._folder = BagFolder(
                directory, notes={**_notes(scene, timing), **notes}, attachments=attachments
            )
        except SubsoilError:
            if self._live is not None:
                self._live.close()
            raise

    def write(self, record: RunRecord) -> None:
        """Write any record of messages.py.

        Raises:
            RecordingError: there is no message for it, or the disk cannot be written.
            ProtocolError: its tick is over.
        """
        kind = type(record)
        if kind not in TOPIC_OF:
            raise RecordingError(
                f"no message carries a {kind.__name__}; give one of the records of messages.py"
            )
        topic, data = TOPIC_OF[kind], self._writers[kind](record)
        kept = record if topic in _NEEDED_FOR_VISUALIZATION or topic == _CLOUD else None
        self._add(record.tick, _Pending(_RANK[topic], topic, data, kept))

    def write_raw(self, topic: str, tick: int, cdr: bytes) -> None:
        """Write the CDR bytes of a message on one of the topics of records (topics.TOPIC_OF).

        Raises:
            ProtocolError: the topic carries no record (derived topics do not), or its tick is over.
            RecordingError: the disk cannot be written.
        """
        rank = _RANK.get(topic)
        if rank is None:
            raise ProtocolError(f"topic '{topic}' is not recorded as it is; recorded are {', '.join(_RANK)}")
        self._add(tick, _Pending(rank, topic, cdr, None))

    def sync(self) -> None:
        """Write everything received so far to the disk; the last tick received must be complete.

        Raises:
            RecordingError: the disk cannot be written.
        """
        pending, self._pending = self._pending, []
        if pending:
            self._write_tick(self._tick, pending)
        self._folder.sync()

    def close(self) -> None:
        """Finishes the bag. Idempotent."""
        pending, self._pending = self._pending, []
        try:
            if pending:
                self._write_tick(self._tick, pending)
        finally:
            try:
                self._folder.close()
            finally:
                if self._live is not None:
                    self._live.close()

    def _add(self, tick: int, item: _Pending) -> None:
        if tick < self._tick:
            raise ProtocolError(
                f"{item.topic}: tick {tick} comes after tick {self._tick}; a bag is written in order of ticks"
            )
        if tick > self._tick:
            finished, self._pending = self._pending, []
            if finished:
                self._write_tick(self._tick, finished)
            self._tick = tick
        self._pending.append(item)

    def _write_tick(self, tick: int, pending: list[_Pending]) -> None:
        time_ns = tick_end_ns(tick, self._communication_step_ns)
        for topic, message in self._latched.items():
            self._emit_message(topic, time_ns, message)
        self._latched = {}
        pending.sort(key=lambda item: item.rank)  # stable: equal topics stay in their order
        for item in pending:
            self._emit(item.topic, time_ns, item.data)
        if tick == INITIAL_TICK:
            return
        self._write_height_map(time_ns, pending)
        if self._schedule.series_due(tick):
            self._write_standard_messages(time_ns, pending)
        self._emit(CLOCK, time_ns, standard_bytes(CLOCK, clock(time_ns)))

    def _write_height_map(self, time_ns: int, pending: list[_Pending]) -> None:
        for item in pending:
            if item.topic == _CLOUD and self._soil is not None:
                cloud = item.record or cloud_from_message(
                    deserialize(item.data, self._types[_CLOUD]), self._communication_step_ns
                )
                self._emit_message(HEIGHT_MAP, time_ns, height_map(cloud, self._soil))

    def _write_standard_messages(self, time_ns: int, pending: list[_Pending]) -> None:
        records = {
            RECORD_OF[item.topic]: item.record
            if item.record is not None
            else self._readers[item.topic](item.data)
            for item in pending
            if item.topic in _NEEDED_FOR_VISUALIZATION
        }
        motions, wrenches = (
            records[kind].tools if kind in records else () for kind in (ToolMotions, ToolWrenches)
        )
        for topic, record in tool_messages(self._scene, motions, wrenches, time_ns):
            self._emit(topic, time_ns, standard_bytes(topic, record))
        state: MechanismState | None = records.get(MechanismState)
        if state is not None or motions:
            places = transforms(self._scene, state, motions, time_ns)
            self._emit(TRANSFORMS, time_ns, standard_bytes(TRANSFORMS, places))

    def _emit_message(self, topic: str, time_ns: int, message: Message) -> None:
        self._emit(topic, time_ns, serialize(message))

    def _emit(self, topic: str, time_ns: int, data: bytes) -> None:
        name = bag_topic(topic)
        if name not in self._folder:
            self._folder.add_topic(self._info(topic))
        self._folder.write(name, time_ns, data)
        if self._live is not None:
            self._live.write(name, time_ns, data)

    def _info(self, topic: str) -> TopicInfo:
        kind = self._types[topic]
        return TopicInfo(bag_topic(topic), kind, schema_text(kind), type_hash(kind), [qos_profile(topic)])

    def _open_live_view(self, port: int) -> LiveView:
        """A view with every topic of the run from the start."""
        live = LiveView(port, f"subsoil {self._scene.name}")
        for topic in (*self._latched, *recorded_topics(self._scene)):
            live.add_topic(self._info(topic), 1 if topic in _NEWEST_ONLY else SERIES_DEPTH)
        return live


def _notes(scene: Scene, timing: Timing) -> dict[str, str]:
    """Notes on what the messages do not show: records of every tick, and thinned records."""
    record = scene.record
    cloud_ticks = Schedule.of(scene, timing).cloud_ticks
    notes = {
        "communication_step_ns": str(timing.communication_step_ns),
        "lockstep_messages": "every tick",
        "series": f"the start, every {record.series_ticks} ticks, and the last",
        "clouds": f"thinned: every {cloud_ticks} ticks, and the last" if cloud_ticks else "none",
    }
    if cloud_ticks and record.cloud_region is not None:
        spans = zip("xyz", record.cloud_region.spans_m, strict=True)
        named = ", ".join(f"{axis} {span[0]:g} to {span[1]:g} m" for axis, span in spans if span)
        notes["cloud_region"] = f"thinned: only particles with their centre in {named}"
    if cloud_ticks and record.cloud_resolution_m > 0.0:
        step_m = position_step_m(record.cloud_resolution_m)
        notes["cloud_resolution"] = (
            f"rounded: positions to multiples of {step_m:.6g} m, speeds to {SPEED_BITS} significant bits"
        )
    return notes


def open_bag(directory: Path, resolved: ResolvedScene, live_port: int = 0) -> BagWriter:
    """Return the writer of a run's bag, which also contains the machine's description and the scene.

    live_port: where a live view serves; 0: there is none.

    Raises:
        InputError: the folder exists or cannot be created, or the live view cannot serve.
        RecordingError: the definitions of subsoil_msgs are not found.
    """
    latched = latched_messages(resolved)
    bundle = pack(resolved, with_bed=False)
    return BagWriter(directory, resolved.scene, resolved.timing, latched, live_port, bundle)
