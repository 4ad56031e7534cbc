"""Check ticks and an END before the last tick of the scene."""

import pytest

from subsoil_ros.coupling.protocol import COUPLER, MECHANISM, Coupler, Needs, Participant, RecordBarrier
from subsoil_ros.errors import ProtocolError
from subsoil_ros.messages import Command, Grant, ToolMotions
from subsoil_ros.schedule import Schedule
from tests.unit.protocol.system import RUN, TOOLS, motion, node_status

TICKS, CHECK_TICKS = 20, 5
ENDS = [4, 9, 14, 19]
"""Ticks with which END may come; the check ticks are those before them."""


def coupler(first_tick: int = 0, window: int = 64) -> Coupler:
    """One that may grant; the mechanism is all there is."""
    schedule = Schedule(TICKS, check_ticks=CHECK_TICKS, first_tick=first_tick)
    found = Coupler(node_status(COUPLER), (MECHANISM,), TOOLS, schedule, window)
    found.accept_node_status(node_status(MECHANISM, initial_motions=motion(-1)))
    return found


def do(found: Coupler, ticks: range) -> None:
    """The mechanism does these ticks."""
    for tick in ticks:
        found.accept_motions(ToolMotions(RUN, tick, 0, motion(tick)))
        assert found.take_finished() is not None


def granted(found: Coupler) -> list[tuple[int, Command]]:
    """What is granted now."""
    return [(grant.tick, grant.command) for grant in found.next_grants()]


def participant(first_tick: int = 0) -> Participant:
    """One that needs nothing."""
    schedule = Schedule(TICKS, check_ticks=CHECK_TICKS, first_tick=first_tick)
    return Participant(RUN, schedule, Needs.NOTHING, TOOLS)


def test_schedule_has_a_check_before_every_early_end() -> None:
    """And a series and a cloud at the tick with which the run ends, but no checkpoint."""
    schedule = Schedule(TICKS, 5, 3, checkpoint_ticks=5, check_ticks=CHECK_TICKS)
    assert [tick + 1 for tick in range(-1, TICKS) if schedule.check_due(tick)] == ENDS
    assert (schedule.series_due(9), schedule.cloud_due(9), schedule.checkpoint_due(9)) == (True, False, True)
    ended = schedule.ends_with(9)
    assert ended.last_tick == 9
    assert (ended.series_due(9), ended.cloud_due(9), ended.checkpoint_due(9)) == (True, True, False)


def test_nothing_is_granted_beyond_a_check_tick_before_its_decision() -> None:
    """However wide the window; then as far as the next check tick, and END with the last tick."""
    found = coupler()
    first = 0
    for end in ENDS:
        assert [tick for tick, _ in granted(found)] == list(range(first, end))
        assert granted(found) == []
        do(found, range(first, end))
        assert granted(found) == []
        found.decide(end - 1, ends=False)
        first = end
    assert granted(found) == [(19, Command.END)]


def test_the_tick_after_a_check_may_be_the_last() -> None:
    """It is granted with END, nothing after it, and with it the run is finished."""
    found = coupler()
    granted(found)
    do(found, range(4))
    found.decide(3, ends=True)
    assert granted(found) == [(4, Command.END)]
    assert not found.finished
    do(found, range(4, 5))
    assert granted(found) == []
    assert found.finished
    assert found.last_tick == 4


def test_a_run_that_goes_on_from_a_check_tick_waits_for_its_decision() -> None:
    """The state of a check tick is kept before the tick after it is granted."""
    found = coupler(first_tick=9)
    assert granted(found) == []
    found.decide(8, ends=True)
    assert granted(found) == [(9, Command.END)]


@pytest.mark.parametrize(
    ("tick", "message"), [(4, "done is tick 3"), (2, "done is tick 3"), (8, "done is tick 3")]
)
def test_decisions_that_are_not_due_are_refused(tick: int, message: str) -> None:
    """Only the check tick that is done is decided, once."""
    found = coupler()
    granted(found)
    do(found, range(4))
    with pytest.raises(ProtocolError, match=message):
        found.decide(tick, ends=True)
    found.decide(3, ends=False)
    with pytest.raises(ProtocolError, match="check of tick 3: tick 8 is to be decided"):
        found.decide(3, ends=False)


def test_a_run_without_checks_has_no_decisions() -> None:
    """And is granted as far as its window."""
    found = Coupler(node_status(COUPLER), (), TOOLS, Schedule(TICKS), 8)
    assert len(granted(found)) == 8
    with pytest.raises(ProtocolError, match="no tick is to be decided"):
        found.decide(-1, ends=True)


@pytest.mark.parametrize("tick", range(TICKS))
def test_a_participant_takes_end_after_a_check_only(tick: int) -> None:
    """Its last tick is that one; elsewhere END is refused."""
    found = participant(first_tick=tick)
    grant = Grant(RUN, tick, Command.END)
    if tick not in ENDS:
        with pytest.raises(ProtocolError, match=f"END came with tick {tick}, the last tick is 19"):
            found.accept_grant(grant)
        return
    found.accept_grant(grant)
    work = found.next_work()
    assert work is not None
    found.finish(work.tick)
    assert found.finished
    assert found.last_tick == tick


def test_a_participant_takes_nothing_after_end() -> None:
    """Neither a later RUN nor a second END."""
    found = participant(first_tick=4)
    found.accept_grant(Grant(RUN, 4, Command.END))
    with pytest.raises(ProtocolError, match=r"tick 5 came, but the run ends with tick 4"):
        found.accept_grant(Grant(RUN, 5, Command.RUN))


def test_the_last_tick_of_the_scene_has_to_be_end() -> None:
    """RUN is refused there, checks or not."""
    found = participant(first_tick=TICKS - 1)
    with pytest.raises(ProtocolError, match="RUN came with tick 19"):
        found.accept_grant(Grant(RUN, TICKS - 1, Command.RUN))


def barrier() -> RecordBarrier[int]:
    """One that takes a cloud at the end alone."""
    return RecordBarrier(
        Schedule(TICKS, check_ticks=CHECK_TICKS, first_tick=4),
        lambda tick: ("grant",),
        4,
        due_at_end=lambda tick: ("grant", "cloud"),
    )


def test_the_recorder_takes_what_is_due_at_an_early_end_before_its_grant() -> None:
    """Messages of several publishers come in any order; the tick is whole once all of it is here."""
    found = barrier()
    found.note_finished(TICKS)
    found.add("cloud", 4, 0)
    assert found.take_tick() is None
    found.end(4)
    found.add("grant", 4, 0)
    assert found.take_tick() == (4, [("grant", 0), ("cloud", 0)])
    assert found.finished
    assert found.next_ack() == 4


def test_the_recorder_refuses_what_an_end_alone_makes_due() -> None:
    """A cloud of a tick that is granted with RUN; one of a tick with which no run ends; END there."""
    found = barrier()
    found.note_finished(TICKS)
    found.add("cloud", 4, 0)
    found.add("grant", 4, 0)
    with pytest.raises(ProtocolError, match="cloud: tick 4 came, nothing of it is due then"):
        found.take_tick()
    with pytest.raises(ProtocolError, match="cloud: tick 5 came"):
        found.add("cloud", 5, 0)
    with pytest.raises(ProtocolError, match="END came with tick 5"):
        found.end(5)
