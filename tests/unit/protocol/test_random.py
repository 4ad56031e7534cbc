"""Longer runs of the real state machines, by chance: every order, delays, a loss or a repetition, pauses."""

import random
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from subsoil_ros.coupling.protocol import MECHANISM
from subsoil_ros.errors import ProtocolError
from tests.unit.protocol.system import Case, System

CASES = st.builds(
    Case,
    ticks=st.integers(1, 30),
    window=st.integers(1, 8),
    soil=st.booleans(),
    series_ticks=st.just(2),
    control_ticks=st.sampled_from([0, 2, 6]),
    prompt=st.just(False),
)
CHECKED = st.builds(
    Case,
    ticks=st.just(30),
    window=st.integers(1, 8),
    soil=st.booleans(),
    series_ticks=st.integers(1, 5),
    check_ticks=st.just(5),
    stop_tick=st.sampled_from([-1, 3, 13, 28]),
    first_tick=st.sampled_from([0, 2, 4]),
    prompt=st.just(False),
).filter(lambda case: case.stop_tick < 0 or case.first_tick <= case.stop_tick + 1)
"""Runs that a check may end before their last tick."""
FAULTS = st.sampled_from(["", "lose", "repeat"])


@settings(max_examples=150, deadline=None)
@given(
    case=st.one_of(CASES, CHECKED),
    fault=FAULTS,
    moment=st.integers(0, 200),
    pauses=st.booleans(),
    seed=st.integers(0, 2**32),
)
def test_a_run_completes_or_ends_in_a_named_fault(
    case: Case, fault: str, moment: int, pauses: bool, seed: int
) -> None:
    """Each tick exactly once by each participant; or a fault names a tick; or it says what it waits for."""
    chance = random.Random(seed)
    system, deliveries, struck, needless = System(case), 0, False, False
    while not system.fault:
        moving = system.moving()
        if not moving and system.coupler.paused:
            system.resume()
            continue
        if not moving:
            break
        # few queues move at first: some nodes are much later than others
        key = moving[min(int(chance.expovariate(1.0)), len(moving) - 1)]
        if fault and not struck and deliveries >= moment:
            # the mechanism does not need the wrenches of the last tick, which the soil has then done; an
            # acknowledgement of a tick is one of all before it too
            last = getattr(system.queues[key][0], "tick", None) == case.last_tick
            needless = key == ("tool_wrenches", MECHANISM) if last else key[0] == "tick_ack"
            getattr(system, fault)(key)
            struck = True
            continue
        if pauses and chance.random() < 0.1:
            _touch(system, chance)
            continue
        system.deliver(key)
        deliveries += 1
    if system.fault:
        assert struck
        assert re.search(r"tick \d+ (came|is repeated)", system.fault)
    elif not system.complete:
        assert struck
        words = system.coupler.missing() + system.barrier.missing()
        assert re.search(r"tick -?\d+", words)
    else:
        assert (
            not (fault == "lose" and struck) or needless or case.control_ticks
        )  # a state after the last command


def _touch(system: System, chance: random.Random) -> None:
    """The user pauses, steps or resumes."""
    if not system.coupler.paused:
        system.pause()
    elif chance.random() < 0.5:
        system.resume()
    elif system.coupler.done_tick < system.coupler.last_tick:
        try:
            system.step(chance.randint(1, 5))
        except ProtocolError as error:
            _refuse_other_words(error)


def _refuse_other_words(error: ProtocolError) -> None:
    assert "no tick is left" in str(error)


def test_steps_are_refused_in_words() -> None:
    """A step needs a pause, a number above 0 and a tick that is left."""
    system = System(Case(ticks=2))
    with pytest.raises(ProtocolError, match="not paused"):
        system.step(1)
    system = System(Case(ticks=2, paused=True))
    with pytest.raises(ProtocolError, match="0 steps"):
        system.step(0)
    assert system.coupler.step(9) == 1
    with pytest.raises(ProtocolError, match="no tick is left"):
        system.step(1)


def test_a_controller_that_is_late_is_named() -> None:
    """Its command does not come: all stand before that tick, and the coupler says whose turn it is."""
    system = System(Case(ticks=9, window=8, control_ticks=4))
    while moving := [key for key in system.moving() if key != ("driver_command", MECHANISM)]:
        key = moving[0]
        (system.lose if key[0] == "driver_command" else system.deliver)(key)
    assert system.done[MECHANISM] == system.coupler.done_tick == 3
    assert system.coupler.missing() == "driver_command of tick 4 from controller"
