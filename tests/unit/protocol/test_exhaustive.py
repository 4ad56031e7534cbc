"""Every interleaving of small runs of the real state machines: no deadlock, no tick twice, none ahead.

The recorder hears all at once here: the order in which it hears makes no
difference to others but in the time of its acknowledgements, which may be late. A test of its own gives it
every order of its messages.
"""

import pickle
import re
from contextlib import suppress
from dataclasses import dataclass

import pytest

from subsoil_ros.coupling.protocol import CONTROLLER, COUPLER, RECORDER, RecordBarrier
from subsoil_ros.errors import ProtocolError
from tests.unit.protocol.system import Case, Due, System

MOST_STATES = 100_000
"""More would say that a case is too large to be looked at whole; none comes near."""


@dataclass(frozen=True)
class Plan:
    """What may be done beside the delivery of messages, each at any moment."""

    faults: tuple[str, ...] = ()  # one of these, once: "lose", "repeat"
    user: tuple[str, ...] = ()  # in this order: "pause", "resume", "step N", "abort"


@dataclass(frozen=True)
class Moment:
    """A state, and what is left of the plan."""

    system: bytes
    faults_left: bool
    user_done: int


def successors(moment: Moment, plan: Plan):
    """Every moment that may be next, and whether anything at all could happen without the user."""
    for key in pickle.loads(moment.system).moving():
        for deed in ("deliver", *(plan.faults if moment.faults_left else ())):
            system = pickle.loads(moment.system)
            getattr(system, deed)(key)
            yield system, Moment(system.frozen(), moment.faults_left and deed == "deliver", moment.user_done)
    if moment.user_done < len(plan.user):
        system = pickle.loads(moment.system)
        name, *count = plan.user[moment.user_done].split()
        with suppress(ProtocolError):  # of a step: no tick may be left
            getattr(system, name)(*map(int, count))
        yield system, Moment(system.frozen(), moment.faults_left, moment.user_done + 1)


def explore(case: Case, plan: Plan, judge) -> int:
    """Goes through all moments, `judge`s those where nothing is on its way; the number of moments."""
    first = Moment(System(case).frozen(), bool(plan.faults), 0)
    seen, waiting, ends = {first}, [first], 0
    while waiting:
        moment = waiting.pop()
        following = list(successors(moment, plan))
        if not following:
            judge(pickle.loads(moment.system), plan)
            ends += 1
        for system, after in following:
            if system.fault:
                assert plan.faults, system.fault
                assert not after.faults_left, system.fault
                assert re.search(r"tick \d+ (came|is repeated)", system.fault)
                ends += 1
            elif after not in seen:
                seen.add(after)
                waiting.append(after)
                assert len(seen) < MOST_STATES
    assert ends
    return len(seen)


def complete(system: System, plan: Plan) -> None:
    """Every tick done once by every participant, and recorded."""
    assert system.complete, system.coupler.missing()
    last = system.case.last_tick
    expected = dict.fromkeys(system.done, last)
    if CONTROLLER in expected:
        expected[CONTROLLER] = last // system.case.control_ticks * system.case.control_ticks
    assert system.done == expected


def complete_or_named(system: System, plan: Plan) -> None:
    """After a loss: complete if the message was needless, else the coupler says what the run waits for."""
    if not system.complete:
        assert re.search(r"(of|after) tick -?\d", system.coupler.missing())


def aborted(system: System, plan: Plan) -> None:
    """The record ends with the tick that the abort names, and no participant goes on."""
    grant = system.coupler.abort_grant
    assert grant is not None
    assert system.done[RECORDER] == grant.tick == system.done[COUPLER]
    assert all(node.abort == grant for node in system.nodes.values())


@pytest.fixture(autouse=True)
def _short_lag(monkeypatch: pytest.MonkeyPatch) -> None:
    """The recorder's lag counts in runs of three ticks too."""
    monkeypatch.setattr("subsoil_ros.coupling.protocol.coupler.ACK_LAG_TICKS", 2)
    monkeypatch.setattr("subsoil_ros.coupling.protocol.record_barrier.ACK_EVERY_TICKS", 1)


CASES = [
    *(Case(window=window, soil=soil) for window in (1, 2, 3) for soil in (True, False)),
    Case(ticks=2, control_ticks=1),
    Case(ticks=5, first_tick=3),
    Case(ticks=5, soil=False, series_ticks=2, control_ticks=2),
    Case(ticks=4, check_ticks=2, stop_tick=0),
    Case(ticks=5, window=1, check_ticks=2, stop_tick=2, series_ticks=3),
    Case(ticks=5, check_ticks=2),
    Case(ticks=3, check_ticks=3, stop_tick=1),
    Case(ticks=6, check_ticks=2, stop_tick=2, first_tick=3),
    Case(ticks=6, check_ticks=3, stop_tick=4, first_tick=3),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_every_order_of_messages_completes(case: Case) -> None:
    """Whatever comes first: each tick exactly once by every participant."""
    explore(case, Plan(), complete)


def test_every_order_completes_where_no_acknowledgement_is_awaited(monkeypatch: pytest.MonkeyPatch) -> None:
    """The window alone holds the nodes back."""
    monkeypatch.setattr("subsoil_ros.coupling.protocol.coupler.ACK_LAG_TICKS", 256)
    explore(Case(window=3), Plan(), complete)


@pytest.mark.full
@pytest.mark.parametrize(
    "user",
    [
        ("pause", "resume"),
        ("pause", "step 1", "resume"),
        ("pause", "step 2", "pause", "step 1", "resume"),
        ("pause", "resume", "pause", "step 1", "step 5"),
    ],
    ids=", ".join,
)
@pytest.mark.parametrize(
    "case",
    [Case(window=1), Case(soil=False, window=2), Case(ticks=5, window=2, check_ticks=2, stop_tick=0)],
    ids=str,
)
def test_pauses_and_steps_at_any_moment_lose_nothing(case: Case, user: tuple[str, ...]) -> None:
    """Paused, stepped and resumed at any moments, a run does each tick exactly once."""
    explore(case, Plan(user=user), complete)


@pytest.mark.parametrize("case", [Case(ticks=3, window=2, paused=True)], ids=str)
def test_a_paused_run_goes_no_further_than_its_steps(case: Case) -> None:
    """Started paused, one step and then two do just these ticks; then the run stands, and is not late."""

    def stands(system: System, plan: Plan) -> None:
        assert system.done[RECORDER] == 1
        assert system.coupler.standing
        assert not system.complete

    explore(case, Plan(user=("step 1", "step 1")), stands)
    explore(case, Plan(user=("step 1", "step 2")), complete)


@pytest.mark.parametrize(
    ("case", "user"),
    [
        (Case(ticks=2), ("abort",)),
        (Case(ticks=2), ("pause", "step 1", "abort")),
        (Case(ticks=2, window=1), ("abort",)),
        (Case(ticks=2, soil=False, control_ticks=1), ("abort",)),
    ],
    ids=str,
)
def test_an_abort_at_any_moment_ends_the_run_for_all(case: Case, user: tuple[str, ...]) -> None:
    """The record is cut where the abort says, and no participant advances after it has heard."""
    explore(case, Plan(user=user), aborted)


@pytest.mark.full
@pytest.mark.parametrize("faults", [("lose",), ("repeat",)], ids=str)
@pytest.mark.parametrize(
    "case",
    [
        Case(window=1),
        Case(ticks=2, window=2),
        Case(soil=False, control_ticks=1),
        Case(ticks=4, check_ticks=2, stop_tick=0),
    ],
    ids=str,
)
def test_one_message_lost_or_twice_is_never_unseen(case: Case, faults: tuple[str, ...]) -> None:
    """The run ends with the tick named, or stands and says what it waits for, or the message was needless."""
    explore(case, Plan(faults=faults), complete_or_named)


def test_the_recorder_takes_every_order_of_its_messages() -> None:
    """Three ticks of grants, motions, wrenches, states and reports, however the five streams mix."""
    case = Case()
    due = Due(case)
    streams = {
        name: [tick for tick in range(case.ticks) if name in due(tick)] for name in due(case.ticks - 1)
    }
    seen, waiting = {tuple(0 for _ in streams)}, [tuple(0 for _ in streams)]
    while waiting:
        heard = waiting.pop()
        barrier: RecordBarrier[int] = RecordBarrier(case.schedule, due, case.window)
        taken = []
        for (name, ticks), count in zip(streams.items(), heard, strict=True):
            for tick in ticks[:count]:
                barrier.add(name, tick, tick)
                if name == "grant":
                    barrier.note_grant(tick)
                elif name == "coupling_report":
                    barrier.note_finished(tick)
        while (whole := barrier.take_tick()) is not None:
            taken.append(whole[0])
            assert [name for name, _ in whole[1]] == list(due(whole[0]))
        assert taken == list(range(min(heard)))  # whole ticks, once, in order; the report makes them certain
        assert barrier.finished == (min(heard) == case.ticks)
        for place, (count, ticks) in enumerate(zip(heard, streams.values(), strict=True)):
            after = (*heard[:place], count + 1, *heard[place + 1 :])
            if count < len(ticks) and after not in seen:
                seen.add(after)
                waiting.append(after)
    assert len(seen) == (case.ticks + 1) ** len(streams)
