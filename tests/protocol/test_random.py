"""Longer runs of the real state machines, by chance: every order, delays, a loss or a repetition, pauses."""

import random
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from subsoil_ros.errors import ProtocolError

from .system import Case, System

CASES = st.builds(
    Case,
    ticks=st.integers(1, 30),
    window=st.integers(1, 8),
    soil=st.booleans(),
    series_ticks=st.just(2),
    control_ticks=st.sampled_from([0, 2, 6]),
    prompt=st.just(False),
)
FAULTS = st.sampled_from(["", "lose", "repeat"])


@settings(max_examples=150, deadline=None)
@given(case=CASES, fault=FAULTS, moment=st.integers(0, 200), pauses=st.booleans(), seed=st.integers(0, 2**32))
def test_a_run_completes_or_ends_in_a_named_fault(
    case: Case, fault: str, moment: int, pauses: bool, seed: int
) -> None:
    """Each tick exactly once by everybody; or a fault that names a tick; or it says what it waits for."""
    chance = random.Random(seed)
    system, deliveries, struck = System(case), 0, False
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
        assert not (fault == "lose" and struck) or case.control_ticks  # a state after the last command


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
