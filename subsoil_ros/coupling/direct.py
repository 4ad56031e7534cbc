"""A run without ROS: the engines called one after the other. The oracle of the other two ways."""

import time
from collections.abc import Callable
from typing import Any, Protocol

from ..messages import Command, Grant, MechanismState, ToolMotions, ToolWrenches
from ..scene.loader import ResolvedScene
from ..ticks import tick_end_ns
from .control import Controller
from .ending import interrupted
from .engines import Mechanism, Mover, Soil
from .exchange import account_of
from .schedule import schedule_of


class RecordSink(Protocol):
    """Takes the records of a run, tick by tick."""

    def write(self, record: Any) -> None:
        """Takes one record."""
        ...


def run_direct(
    resolved: ResolvedScene,
    run_id: str,
    mover: Mover,
    soil: Soil | None,
    sink: RecordSink,
    on_tick: Callable[[int], None] = lambda tick: None,
    stop_signal: Callable[[], int] = lambda: 0,
    controller: Controller | None = None,
) -> None:
    """Runs a scene from tick 0 to its last, writing every record.

    Args:
        mover: the mechanism of the scene, or the paths of its tools.
        on_tick: called after each tick is written.
        controller: of the scene, if it names one.
        stop_signal: asked before each tick; a signal's number other than 0 ends the run there.

    Raises:
        InterruptedRunError: stop_signal asked for it.
        RunError: an engine or the interface account failed. Every finished tick is written.
    """
    interval_ns = resolved.timing.interval_ns
    schedule = schedule_of(resolved.scene, resolved.timing)
    parallel = resolved.scene.coupling.scheme == "parallel"
    mechanism: Mechanism | None = mover if resolved.scene.mechanism is not None else None  # type: ignore[assignment]
    motions = mover.initial_motions()
    wrenches = soil.start(motions) if soil is not None else ()
    account = account_of(resolved.scene, motions, wrenches)
    state: MechanismState | None = None  # at the last series tick
    start = time.monotonic()
    for tick in range(schedule.tick_count):
        signal_number = stop_signal()
        if signal_number:
            raise interrupted(signal_number).error()
        end_ns = tick_end_ns(tick, interval_ns)
        command = None
        if controller is not None and mechanism is not None and state and schedule.control_due(tick):
            command = controller.command(tick, state)
            mechanism.command(command)
        before, motions = motions, mover.advance(tick, wrenches)
        if soil is not None:
            wrenches = soil.advance(tick, before if parallel else motions)
        work = account.add(motions, wrenches)
        sink.write(Grant(run_id, tick, Command.END if tick == schedule.last_tick else Command.RUN))
        if command is not None:
            sink.write(command)
        sink.write(ToolMotions(run_id, tick, end_ns, motions))
        if soil is not None:
            sink.write(ToolWrenches(run_id, tick, end_ns, wrenches))
        if schedule.series_due(tick):
            if mechanism is not None:
                state = mechanism.state(run_id, tick, end_ns)
                sink.write(state)
            if soil is not None:
                sink.write(soil.state(run_id, tick, end_ns))
            sink.write(work.report(run_id, tick, interval_ns, time.monotonic() - start))
        if soil is not None and schedule.cloud_due(tick):
            sink.write(soil.cloud(tick, end_ns))
        on_tick(tick)
        account.check(tick)
