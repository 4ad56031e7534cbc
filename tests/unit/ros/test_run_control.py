"""Requests to a run, against a coupler by hand."""

from types import SimpleNamespace
from typing import cast

from subsoil_ros.coupling.protocol.coupler import Coupler
from subsoil_ros.ros.nodes.run_control import Result, RunControl


def test_a_pause_ends_the_steps_that_would_go_further() -> None:
    """Else their caller waited for as long as the pause lasts."""
    coupler = SimpleNamespace(done_tick=9, paused=True, step=lambda count: 9 + count, pause=lambda: 12)
    control = RunControl(cast(Coupler, coupler), lambda: None, lambda status: None)
    answers: list[tuple[str, Result, str]] = []
    control.step(2, lambda result, why: answers.append(("short", result, why)))
    control.step(90, lambda result, why: answers.append(("long", result, why)))
    control.pause(lambda result, why: answers.append(("pause", result, why)))
    assert answers == [("long", Result.OPERATION_FAILED, "paused at the end of tick 12")]
    coupler.done_tick = 12
    control.note_done()
    assert answers[1:] == [("short", Result.OK, ""), ("pause", Result.OK, "")]
