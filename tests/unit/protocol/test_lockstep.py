"""Whole executions of the lockstep protocol without ROS, under any interleaving of its messages."""

import random
import re
from collections import deque
from dataclasses import dataclass, field

import pytest

from subsoil_ros.coupling.protocol import (
    ACK_LAG_TICKS,
    COUPLER,
    MECHANISM,
    RECORDER,
    SOIL,
    Coupler,
    Needs,
    Participant,
    RecordBarrier,
)
from subsoil_ros.errors import InputError, ProtocolError, RunError
from subsoil_ros.messages import (
    Command,
    Grant,
    NodeState,
    NodeStatus,
    TickAck,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from subsoil_ros.schedule import Schedule

RUN = "run"
TOOLS = ("share",)
SERIES_TICKS = 5


def motion(tick: int) -> tuple[ToolMotion, ...]:
    """A motion that tells its tick."""
    return (ToolMotion("share", float(tick), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),)


def wrench(tick: int) -> tuple[ToolWrench, ...]:
    """A wrench that tells its tick."""
    return (ToolWrench("share", float(tick), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0),)


def node_status(node: str, state: NodeState = NodeState.READY, run_id: str = RUN, **other) -> NodeStatus:
    """A node's word."""
    values = {
        "scene_hash": "hash", "package_version": "1", "message_hashes": (), "capabilities": (),
        "process_id": 1, "tick": -1, **other,
    }  # fmt: skip
    return NodeStatus(run_id, node, state, **values)


def due(tick: int) -> tuple[str, ...]:
    """What the recorder waits for."""
    series = ("soil_state", "coupling_report") if (tick + 1) % SERIES_TICKS == 0 else ()
    return ("grant", "tool_motions", "tool_wrenches", *series)


@dataclass
class Execution:
    """Coupler, mechanism, soil and recorder, joined by queues whose order among one another is random.

    `disturb` may replace a message on its way by none, or by several.
    """

    seed: int
    ticks: int = 40
    window: int = 4
    disturb: object = None
    slow: bool = False  # the coupler grants fewer ticks ahead at times
    log: list[tuple[str, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        schedule = Schedule(self.ticks)
        names = (MECHANISM, SOIL, RECORDER)
        self.coupler = Coupler(node_status(COUPLER), names, TOOLS, schedule, self.window)
        self.mechanism = Participant(RUN, schedule, Needs.WRENCHES, TOOLS)
        self.soil = Participant(RUN, schedule, Needs.MOTIONS, TOOLS)
        self.barrier: RecordBarrier[object] = RecordBarrier(schedule, due, self.window)
        self.recorded: list[tuple[int, list[str]]] = []
        self.queues: dict[tuple[str, str], deque] = {}

    def run(self) -> None:
        """Until nothing is on its way any more."""
        self.coupler.accept_node_status(node_status(MECHANISM, initial_motions=motion(-1)))
        self.coupler.accept_node_status(node_status(SOIL, initial_wrenches=wrench(-1)))
        self.coupler.accept_node_status(node_status(RECORDER))
        self.mechanism.start(wrench(-1))
        self._grant()
        while waiting := [key for key, queue in self.queues.items() if queue]:
            key = self.random.choice(waiting)
            self._deliver(key[1], self.queues[key].popleft())

    def _send(self, message: object, *receivers: str) -> None:
        for receiver in receivers:
            copies = [message] if self.disturb is None else self.disturb(message, receiver)
            self.queues.setdefault((type(message).__name__, receiver), deque()).extend(copies)

    def _grant(self) -> None:
        ahead = 1 + self.coupler.done_tick % 5 if self.slow else None
        for grant in self.coupler.next_grants(ahead):
            self._send(grant, MECHANISM, SOIL, RECORDER)

    def _deliver(self, receiver: str, message: object) -> None:
        if receiver == COUPLER:
            self._deliver_coupler(message)
        elif receiver == RECORDER:
            self._deliver_recorder(message)
        else:
            node = self.mechanism if receiver == MECHANISM else self.soil
            accept = {
                Grant: node.accept_grant,
                ToolMotions: node.accept_motions,
                ToolWrenches: node.accept_wrenches,
            }
            accept[type(message)](message)
            self._work(receiver, node)

    def _work(self, name: str, node: Participant) -> None:
        while (work := node.next_work()) is not None:
            tick = work.tick
            self.log.append((name, tick))
            if name == MECHANISM:
                assert work.wrenches == wrench(tick - 1)
                self._send(ToolMotions(RUN, tick, 0, motion(tick)), SOIL, COUPLER, RECORDER)
            else:
                assert work.motions == motion(tick)
                self._send(ToolWrenches(RUN, tick, 0, wrench(tick)), MECHANISM, COUPLER, RECORDER)
                if "soil_state" in due(tick):
                    self._send(("soil_state", tick), RECORDER)
            node.finish(tick)

    def _deliver_coupler(self, message: object) -> None:
        accept = {
            ToolMotions: self.coupler.accept_motions,
            ToolWrenches: self.coupler.accept_wrenches,
            TickAck: self.coupler.accept_ack,
        }
        accept[type(message)](message)
        while (finished := self.coupler.take_finished()) is not None:
            assert finished.motions == motion(finished.tick)
            assert finished.wrenches == wrench(finished.tick)
            self.log.append((COUPLER, finished.tick))
            if "coupling_report" in due(finished.tick):
                self._send(("coupling_report", finished.tick), RECORDER)
        self._grant()

    def _deliver_recorder(self, message) -> None:
        names = {Grant: "grant", ToolMotions: "tool_motions", ToolWrenches: "tool_wrenches"}
        name, tick = message if isinstance(message, tuple) else (names[type(message)], message.tick)
        self.barrier.add(name, tick, message)
        if name == "grant":
            self.barrier.note_grant(tick)
        elif name == "coupling_report":
            self.barrier.note_finished(tick)
        while (whole := self.barrier.take_tick()) is not None:
            self.recorded.append((whole[0], [name for name, _ in whole[1]]))
            acknowledged = self.barrier.next_ack()
            if acknowledged is not None:
                self._send(TickAck(RUN, acknowledged), COUPLER)


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize(("window", "slow"), [(1, False), (2, False), (8, False), (8, True)])
def test_every_interleaving_completes_each_tick_once(seed: int, window: int, slow: bool) -> None:
    """Whatever the order of delivery, all ticks happen once, in order, and are recorded whole."""
    execution = Execution(seed, window=window, slow=slow)
    execution.run()
    assert execution.coupler.finished
    for name in (MECHANISM, SOIL, COUPLER):
        assert [tick for who, tick in execution.log if who == name] == list(range(execution.ticks))
    assert execution.recorded == [(tick, list(due(tick))) for tick in range(execution.ticks)]


@pytest.mark.parametrize("seed", range(10))
def test_nobody_runs_ahead_of_the_window(seed: int) -> None:
    """Motion and soil are never more than the grant window beyond what the coupler has seen finished."""
    execution = Execution(seed, window=3)
    execution.run()
    done = -1
    for name, tick in execution.log:
        if name == COUPLER:
            done = tick
        else:
            assert tick <= done + 3


def test_serial_order() -> None:
    """The soil answers tick k after the mechanism moved it, the mechanism moves k+1 after the answer."""
    execution = Execution(seed=0, window=8)
    execution.run()
    assert [entry for entry in execution.log if entry[0] != COUPLER] == [
        (name, tick) for tick in range(execution.ticks) for name in (MECHANISM, SOIL)
    ]


def test_a_slow_recorder_holds_the_run() -> None:
    """Without acknowledgements the run stands at the bound of the lag, and goes on with the first one."""
    execution = Execution(
        seed=1,
        ticks=3 * ACK_LAG_TICKS,
        disturb=lambda message, receiver: [] if receiver == RECORDER else [message],
    )
    execution.run()
    assert execution.coupler.done_tick == ACK_LAG_TICKS - 1
    execution._deliver(COUPLER, TickAck(RUN, 9))
    assert execution.queues[("Grant", MECHANISM)][-1].tick == ACK_LAG_TICKS + 3  # the window
    assert "tick_ack" not in execution.coupler.missing()


def _at(kind: type, receiver: str, tick: int, copies: int):
    def disturb(message, to):
        hit = isinstance(message, kind) and to == receiver and message.tick == tick
        return [message] * (copies if hit else 1)

    return disturb


MESSAGES = [
    (Grant, MECHANISM),
    (Grant, SOIL),
    (Grant, RECORDER),
    (ToolMotions, SOIL),
    (ToolMotions, COUPLER),
    (ToolMotions, RECORDER),
    (ToolWrenches, MECHANISM),
    (ToolWrenches, COUPLER),
    (ToolWrenches, RECORDER),
]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("kind", "receiver"), MESSAGES)
def test_a_repeated_message_is_named(kind: type, receiver: str, seed: int) -> None:
    """A message that comes twice ends the run with its tick and the one that was due."""
    execution = Execution(seed, disturb=_at(kind, receiver, 17, copies=2))
    with pytest.raises(ProtocolError, match="tick 17"):
        execution.run()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("kind", "receiver"), MESSAGES)
def test_a_lost_message_never_passes(kind: type, receiver: str, seed: int) -> None:
    """After a loss the run ends with both ticks named, or stands still and says what it waits for."""
    execution = Execution(seed, disturb=_at(kind, receiver, 17, copies=0))
    fault = ""
    try:
        execution.run()
    except ProtocolError as error:
        fault = str(error)
    assert not execution.coupler.finished
    assert execution.barrier.done_tick < execution.barrier.last_tick
    words = fault or execution.coupler.missing() + execution.barrier.missing()
    assert re.search("tick 18 came where tick 17 is due" if fault else "tick 1[78]", words)


def test_foreign_run_is_refused() -> None:
    """A message of another run is refused with both runs and ticks."""
    node = Participant(RUN, Schedule(10), Needs.MOTIONS, TOOLS)
    with pytest.raises(ProtocolError, match="tick 4 is of run 'other', this is run 'run', at tick 0"):
        node.accept_motions(ToolMotions("other", 4, 0, motion(4)))


def test_other_tools_are_refused() -> None:
    """A message about other tools than the scene's is refused."""
    node = Participant(RUN, Schedule(10), Needs.MOTIONS, ("share", "wheel"))
    with pytest.raises(ProtocolError, match=r"tools \['share'\], the scene has \['share', 'wheel'\]"):
        node.accept_motions(ToolMotions(RUN, 0, 0, motion(0)))


def test_ungranted_answer_is_refused() -> None:
    """The coupler refuses a tick that it has not granted."""
    coupler = Execution(seed=0).coupler
    with pytest.raises(ProtocolError, match="tick 0 came, granted is tick -1"):
        coupler.accept_motions(ToolMotions(RUN, 0, 0, motion(0)))


def test_abort_stops_the_work_and_names_the_last_tick() -> None:
    """After ABORT no participant advances; the record ends with the tick that the abort names."""
    execution = Execution(seed=3)
    execution.run()
    aborted = Execution(seed=3)
    aborted.coupler.accept_node_status(node_status(MECHANISM, initial_motions=motion(-1)))
    aborted.coupler.accept_node_status(node_status(SOIL, initial_wrenches=wrench(-1)))
    aborted.coupler.accept_node_status(node_status(RECORDER))
    aborted.mechanism.start(wrench(-1))
    for grant in aborted.coupler.next_grants():
        aborted.mechanism.accept_grant(grant)
        aborted.barrier.add("grant", grant.tick, grant)
    for accept, name, record in (
        (aborted.coupler.accept_motions, "tool_motions", ToolMotions(RUN, 0, 0, motion(0))),
        (aborted.coupler.accept_wrenches, "tool_wrenches", ToolWrenches(RUN, 0, 0, wrench(0))),
    ):
        accept(record)
        aborted.barrier.add(name, 0, record)
    assert aborted.coupler.take_finished() is not None
    grant = aborted.coupler.abort("disk full")
    assert (grant.tick, grant.command, grant.reason) == (0, Command.ABORT, "disk full")
    assert aborted.coupler.abort("second") is grant
    aborted.mechanism.accept_grant(grant)
    assert aborted.mechanism.next_work() is None
    assert aborted.coupler.next_grants() == ()
    aborted.barrier.cut(grant.tick)
    assert aborted.barrier.take_tick()[0] == 0
    assert aborted.barrier.finished


@pytest.mark.parametrize(
    ("word", "message"),
    [
        (node_status(SOIL, scene_hash="other"), "soil runs scene other, the coupler hash"),
        (node_status(SOIL, package_version="2"), "soil is subsoil_ros 2, the coupler 1"),
        (
            node_status(SOIL, message_hashes=("Grant RIHS01_a", "TickAck RIHS01_b")),
            r"coupler \(Grant, TickAck\)",
        ),
        (
            node_status(SOIL, capabilities=("driver_command",)),
            "soil cannot do 'tick_mean', .*force: tick_mean",
        ),
        (node_status(SOIL, run_id="other"), "run 'other'"),
    ],
)
def test_handshake_refuses_what_does_not_fit(word: NodeStatus, message: str) -> None:
    """A node of another scene, version, message or run, or unable, is refused by name before tick 0."""
    needed = {SOIL: {"tick_mean": "coupling.force: tick_mean"}}
    coupler = Coupler(node_status(COUPLER), (SOIL, RECORDER), TOOLS, Schedule(9), 1, needed=needed)
    coupler.accept_node_status(
        node_status(SOIL, NodeState.STARTING, capabilities=("tick_mean", "driver_command"))
    )
    with pytest.raises(ProtocolError, match=message):
        coupler.accept_node_status(word)


@pytest.mark.parametrize(
    ("there", "found"), [((), "does not have"), (("contact_law hysteretic 2222",), "has other sources of")]
)
def test_handshake_refuses_another_contact_law(there: tuple[str, ...], found: str) -> None:
    """A soil node without the scene's outside law, or with it from other sources, is refused by name."""
    needed = {SOIL: {"contact_law hysteretic 1111": "soil.law.kind: hysteretic"}}
    coupler = Coupler(node_status(COUPLER), (SOIL,), TOOLS, Schedule(9), 1, needed=needed)
    with pytest.raises(ProtocolError, match=f"soil {found} contact law 'hysteretic', .*soil.law.kind"):
        coupler.accept_node_status(node_status(SOIL, NodeState.STARTING, capabilities=there))
    coupler.accept_node_status(
        node_status(SOIL, NodeState.STARTING, capabilities=("contact_law hysteretic 1111",))
    )


def test_two_nodes_of_one_name_are_refused() -> None:
    """A second node of the same name is refused with both processes."""
    coupler = Execution(seed=0).coupler
    coupler.accept_node_status(node_status(SOIL, NodeState.STARTING))
    with pytest.raises(ProtocolError, match="processes 1 and 2"):
        coupler.accept_node_status(node_status(SOIL, NodeState.STARTING, process_id=2))


def test_fault_of_a_participant_is_told() -> None:
    """A fault ends the run with the node's own words."""
    coupler = Execution(seed=0).coupler
    with pytest.raises(RunError, match="soil: tick 7: overlap too deep"):
        coupler.accept_node_status(node_status(SOIL, NodeState.FAULT, message="tick 7: overlap too deep"))


def test_bad_input_that_a_participant_finds_stays_bad_input() -> None:
    """A node that cannot be built from the scene ends the run as a scene that cannot be loaded does."""
    coupler = Execution(seed=0).coupler
    fault = node_status(SOIL, NodeState.FAULT, message="tools: they overlap every particle", exit_status=2)
    with pytest.raises(InputError, match="soil: tools: they overlap every particle"):
        coupler.accept_node_status(fault)


def test_nothing_is_granted_before_all_are_ready() -> None:
    """Tick 0 waits for every participant, and the coupler says for whom."""
    coupler = Execution(seed=0).coupler
    coupler.accept_node_status(node_status(MECHANISM, initial_motions=motion(-1)))
    coupler.accept_node_status(node_status(RECORDER, NodeState.STARTING))
    assert coupler.next_grants() == ()
    assert coupler.missing() == "ready from recorder, soil"


def test_message_that_is_not_due_is_refused_by_the_recorder() -> None:
    """The recorder refuses what the schedule does not know: nothing invented gets into a bag."""
    barrier: RecordBarrier[bytes] = RecordBarrier(Schedule(10), due, 4)
    with pytest.raises(ProtocolError, match="soil_state: tick 3 came"):
        barrier.add("soil_state", 3, b"")


def test_a_tick_is_recorded_when_no_abort_can_name_an_earlier_one() -> None:
    """Whole ticks beyond what the coupler has surely finished wait, and are dropped by an abort."""
    barrier: RecordBarrier[bytes] = RecordBarrier(Schedule(40), due, grant_window=3)
    for tick in range(4):
        for name in due(tick):
            barrier.add(name, tick, b"")
    barrier.note_grant(3)  # granted within a window of 3: tick 0 is finished
    assert barrier.take_tick()[0] == 0
    assert barrier.take_tick() is None
    barrier.cut(1)
    assert barrier.take_tick()[0] == 1
    assert barrier.take_tick() is None
    assert barrier.finished


def test_the_record_begins_with_the_initial_state() -> None:
    """What is due before tick 0 is handed out first, in recording order, once, as soon as it is certain."""
    barrier: RecordBarrier[bytes] = RecordBarrier(Schedule(40), due, 3, initial=("motions", "report"))
    assert barrier.missing() == "tick -1: motions, report"
    for name in due(0):
        barrier.add(name, 0, b"")
    barrier.note_grant(3)
    assert barrier.take_tick() is None
    barrier.add("report", -1, b"1")
    barrier.add("motions", -1, b"2")
    with pytest.raises(ProtocolError, match="motions: tick -1 is repeated"):
        barrier.add("motions", -1, b"2")
    assert barrier.take_tick() == (-1, [("motions", b"2"), ("report", b"1")])
    assert barrier.next_ack() is None
    found = barrier.take_tick()
    assert found is not None
    assert found[0] == 0


def test_an_abort_before_the_first_grant_waits_for_nothing() -> None:
    """The initial state of a run that cannot begin is not waited for; once a tick was granted, it is."""
    unborn: RecordBarrier[bytes] = RecordBarrier(Schedule(40), due, 3, initial=("motions",))
    unborn.cut(-1)
    assert unborn.finished
    begun: RecordBarrier[bytes] = RecordBarrier(Schedule(40), due, 3, initial=("motions",))
    begun.note_grant(0)
    begun.cut(-1)
    assert not begun.finished
    begun.add("motions", -1, b"")
    assert begun.take_tick() == (-1, [("motions", b"")])
    assert begun.finished
