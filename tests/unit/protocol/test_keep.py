"""Runs that go on from a later tick, and the word to keep a state, under any interleaving."""

import pytest

from subsoil_ros.coupling.protocol import COUPLER, MECHANISM, SOIL, Coupler, Needs, Participant, RecordBarrier
from subsoil_ros.errors import ProtocolError
from subsoil_ros.messages import Command, Grant
from subsoil_ros.schedule import Schedule
from tests.unit.protocol.test_lockstep import RUN, TOOLS, Execution, due, motion, node_status, wrench

FIRST = 17


class Resumed(Execution):
    """A run that goes on with tick FIRST."""

    def __post_init__(self) -> None:
        super().__post_init__()
        names = (MECHANISM, SOIL, "recorder")
        schedule = Schedule(self.ticks, first_tick=FIRST)
        self.coupler = Coupler(node_status(COUPLER), names, TOOLS, schedule, self.window)
        self.mechanism = Participant(RUN, schedule, Needs.WRENCHES, TOOLS)
        self.soil = Participant(RUN, schedule, Needs.MOTIONS, TOOLS)
        self.barrier = RecordBarrier(schedule, due, self.window)
        start = self.mechanism.start
        self.mechanism.start = lambda wrenches: start(wrenches=wrench(FIRST - 1))  # type: ignore[method-assign]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("window", [1, 8])
def test_a_resumed_run_has_each_later_tick_once(seed: int, window: int) -> None:
    """The first tick takes the wrenches of the one before it; none of the earlier comes again."""
    execution = Resumed(seed, window=window)
    execution.run()
    assert execution.coupler.finished
    for name in (MECHANISM, SOIL, COUPLER):
        assert [tick for who, tick in execution.log if who == name] == list(range(FIRST, execution.ticks))
    assert execution.recorded == [(tick, list(due(tick))) for tick in range(FIRST, execution.ticks)]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("held_at", [0, 7, 25])
def test_held_back_all_stand_at_one_tick(seed: int, held_at: int) -> None:
    """No more grants: all participants finish what was granted; the word to keep names that tick to all."""
    execution = Execution(seed, window=4)
    take = execution.coupler.take_finished

    def hold_then_take() -> object:
        if execution.coupler.done_tick == held_at:
            execution.coupler.hold()
        return take()

    execution.coupler.take_finished = hold_then_take  # type: ignore[method-assign,assignment]
    execution.run()
    grant = execution.coupler.keep()
    assert grant is not None
    assert (grant.command, grant.run_id) == (Command.CHECKPOINT, RUN)
    assert held_at <= grant.tick <= held_at + 4
    for node in (execution.mechanism, execution.soil):
        node.accept_keep(grant)
        assert node.done_tick == grant.tick
    execution.barrier.note_finished(grant.tick)
    while execution.barrier.take_tick():
        pass
    assert execution.barrier.done_tick == grant.tick
    assert execution.barrier.next_ack(at_once=True) in (grant.tick, None)
    assert execution.barrier.next_ack(at_once=True) is None
    assert execution.coupler.next_grants() == ()


def test_the_word_to_keep_waits_for_what_was_granted() -> None:
    """Not while ticks are granted, nor before the last granted one is done."""
    execution = Execution(seed=0)
    for word in (
        node_status(MECHANISM, initial_motions=motion(-1)),
        node_status(SOIL, initial_wrenches=wrench(-1)),
    ):
        execution.coupler.accept_node_status(word)
    execution.coupler.accept_node_status(node_status("recorder"))
    assert execution.coupler.next_grants()
    with pytest.raises(ProtocolError, match="CHECKPOINT while ticks are being granted"):
        execution.coupler.keep()
    execution.coupler.hold()
    assert execution.coupler.keep() is None


@pytest.mark.parametrize(("run_id", "tick"), [(RUN, 0), (RUN, 3), ("other", -1)])
def test_a_state_of_another_tick_or_run_is_not_kept(run_id: str, tick: int) -> None:
    """Who does not stand at the tick named has nothing to keep of it."""
    participant = Participant(RUN, Schedule(10), Needs.NOTHING, TOOLS)
    participant.accept_grant(Grant(RUN, 0))
    with pytest.raises(ProtocolError, match=r"CHECKPOINT came|is of run"):
        participant.accept_keep(Grant(run_id, tick, Command.CHECKPOINT))
