"""A run without ROS: the engines called one after the other. The reference for the other two modes."""

import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from ..errors import InputError
from ..loading.loader import ResolvedScene
from ..messages import Command, Grant, MechanismState, ToolMotions, ToolWrenches
from ..recording.checkpoint import Checkpoint
from ..ticks import INITIAL_TICK, tick_end_ns
from .checkpoints import CheckpointWriter, CouplingState, mover_part, restore_engine
from .cloud import recorded_cloud
from .control import Controller
from .energy_account import InterfaceWork, account_of
from .engines import Mechanism, MotionSource, Soil
from .exit_status import interrupted
from .protocol import SOIL
from .stopping import OnCheck, StopRule


class RecordSink(Protocol):
    """Receives the records of a run, tick by tick."""

    def write(self, record: Any) -> None:
        """Write one record."""
        ...


def run_direct(
    resolved: ResolvedScene,
    run_id: str,
    motion_source: MotionSource,
    soil: Soil | None,
    sink: RecordSink | None,
    on_tick: Callable[[int], None] = lambda tick: None,
    stop_signal: Callable[[], int] = lambda: 0,
    checkpoint_writer: CheckpointWriter | None = None,
    resumed: Checkpoint | None = None,
    controller: Controller | None = None,
    stop_rule: StopRule | None = None,
    on_check: OnCheck = lambda result: None,
) -> None:
    """Run a scene from tick 0, or from a checkpoint, to its last tick, writing every record.

    Args:
        motion_source: the mechanism of the scene, or the paths of its tools.
        sink: receives the record; None: nothing is recorded.
        on_tick: called after each tick is written.
        controller: the one of the scene, if it has one.
        stop_signal: called before each tick; a signal's number other than 0 ends the run there.
        checkpoint_writer: writes checkpoints, when they are due and on a signal; None: there are none.
        resumed: checkpoint to continue from; None: start at tick 0.
        stop_rule: rule of a scene with stop_when, in the state of `resumed`.
        on_check: called with the result of the rule, at each check and at the end.

    Raises:
        InputError: the scene has stop_when, and no rule is given.
        InterruptedRunError: stop_signal returned a signal.
        RunError: an engine or the interface account failed. Every finished tick is written.
    """
    communication_step_ns = resolved.timing.communication_step_ns
    schedule = resolved.schedule
    mechanism: Mechanism | None = motion_source if resolved.scene.mechanism is not None else None  # type: ignore[assignment]
    part = mover_part(resolved.scene)
    state = _first_state(motion_source, soil, part, resumed)
    account = account_of(resolved.scene, state.motions, state.wrenches, state.work)
    machine: MechanismState | None = None  # at the last series tick, for the controller
    if mechanism is not None and resumed is not None:
        machine = mechanism.state(run_id, state.tick, tick_end_ns(state.tick, communication_step_ns))
    start = time.monotonic() - state.wall_time_s
    write = sink.write if sink is not None else _forget
    if sink is not None and resumed is None:
        for record in _initial_records(run_id, state, mechanism, soil, communication_step_ns):
            write(record)
    if schedule.check_ticks and stop_rule is None:
        raise InputError(f"{resolved.path}: has stop_when, and this run has no rule; give stop_rule")

    def keep() -> None:
        """Write the checkpoint of `state`, unless it is written already."""
        if checkpoint_writer is None or state.tick in (first_tick - 1, checkpoint_writer.last_tick):
            return
        checkpoint_writer.keep(state.tick, part, motion_source)
        if soil is not None:
            checkpoint_writer.keep(state.tick, SOIL, soil)
        checkpoint_writer.commit(state)

    def end_with(tick: int) -> None:
        """Make `tick`, the next one, the last."""
        nonlocal schedule
        schedule = schedule.ends_with(tick)
        if soil is not None:
            soil.ends_with(tick)

    first_tick = state.tick + 1
    if stop_rule is not None and stop_rule.state.stops:
        end_with(first_tick)
        on_check(stop_rule.result())
    for tick in range(first_tick, schedule.tick_count):
        signal_number = stop_signal()
        if signal_number:
            keep()
            raise interrupted(signal_number).error()
        end_ns = tick_end_ns(tick, communication_step_ns)
        command = None
        if controller is not None and mechanism is not None and machine and schedule.control_due(tick):
            command = controller.command(tick, machine)
            mechanism.command(command)
        motions, wrenches = motion_source.advance(tick, state.wrenches), state.wrenches
        if soil is not None:
            wrenches = soil.advance(tick, motions)
        work = account.add(motions, wrenches)
        wall_time_s = time.monotonic() - start
        write(Grant(run_id, tick, Command.END if tick == schedule.last_tick else Command.RUN))
        if command is not None:
            write(command)
        write(ToolMotions(run_id, tick, end_ns, motions))
        if soil is not None:
            write(ToolWrenches(run_id, tick, end_ns, wrenches))
        if schedule.series_due(tick):
            if mechanism is not None:
                machine = mechanism.state(run_id, tick, end_ns)
                write(machine)
            if soil is not None and sink is not None:
                write(soil.state(run_id, tick, end_ns))
            write(work.report(run_id, tick, communication_step_ns, wall_time_s))
        if soil is not None and sink is not None and schedule.cloud_due(tick):
            write(recorded_cloud(soil.cloud(tick, end_ns), resolved.scene.record))
        on_tick(tick)
        account.check(tick)
        if stop_rule is not None:
            stop_rule.add(tick, motions, wrenches)
            if schedule.check_due(tick) and stop_rule.check():
                end_with(tick + 1)
            if schedule.check_due(tick) or (tick == schedule.last_tick and not stop_rule.state.stops):
                on_check(stop_rule.result())
        stopping = stop_rule.state if stop_rule is not None else None
        state = CouplingState(tick, motions, wrenches, work, wall_time_s, stopping)
        if schedule.checkpoint_due(tick):
            keep()
        if tick == schedule.last_tick:
            break
    if checkpoint_writer is not None:
        checkpoint_writer.note_end(state.tick, part, motion_source)
        if soil is not None:
            checkpoint_writer.note_end(state.tick, SOIL, soil)
        checkpoint_writer.note_coupling_end(state)


def _forget(record: Any) -> None:
    """Do nothing: replaces a sink where nothing is recorded."""


def _initial_records(
    run_id: str,
    state: CouplingState,
    mechanism: Mechanism | None,
    soil: Soil | None,
    communication_step_ns: int,
) -> Iterator[Any]:
    """Records of the state before tick 0."""
    yield ToolMotions(run_id, INITIAL_TICK, 0, state.motions)
    if soil is not None:
        yield ToolWrenches(run_id, INITIAL_TICK, 0, state.wrenches)
    if mechanism is not None:
        yield mechanism.initial_state(run_id, state.wrenches)
    if soil is not None:
        yield soil.state(run_id, INITIAL_TICK, 0)
    yield state.work.report(run_id, INITIAL_TICK, communication_step_ns, 0.0)


def _first_state(
    motion_source: MotionSource, soil: Soil | None, part: str, resumed: Checkpoint | None
) -> CouplingState:
    """The exchange before the first tick: the initial one, or a checkpoint restored in the engines."""
    if resumed is not None:
        restore_engine(motion_source, resumed, part)
        if soil is not None:
            restore_engine(soil, resumed, SOIL)
        return CouplingState.of(resumed)
    motions = motion_source.initial_motions()
    wrenches = soil.start(motions) if soil is not None else ()
    return CouplingState(INITIAL_TICK, motions, wrenches, InterfaceWork())
