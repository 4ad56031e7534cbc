"""A run without ROS: the engines called one after the other. The reference for the other two modes."""

import time
from collections.abc import Iterator
from typing import Protocol

from ..messages import Command, Grant, MechanismState, RunRecord, ToolMotions, ToolWrenches
from ..recording.soil_clouds import recorded_cloud
from ..ticks import INITIAL_TICK, tick_end_ns
from .checkpoints import CheckpointWriter, CouplingState, restore_engine
from .energy_account import InterfaceWork
from .engines import Engines, soil_state
from .exit_status import interrupted
from .observer import RunObserver
from .run_settings import RunSettings
from .tick_rules import StopRule, TickRules


class RecordSink(Protocol):
    """Receives the records of a run, tick by tick."""

    def write(self, record: RunRecord) -> None:
        """Write one record."""
        ...


def run_direct(
    settings: RunSettings,
    engines: Engines,
    sink: RecordSink | None = None,
    observer: RunObserver | None = None,
    *,
    stop_rule: StopRule | None = None,
    checkpoint_writer: CheckpointWriter | None = None,
) -> None:
    """Run a scene from its first tick, or from a checkpoint, to its last one, writing every record.

    Args:
        sink: receives the record; None: nothing is recorded.
        observer: receives each tick that is written and each check, and may end the run.
        stop_rule: rule of a scene with stop_when, in the state of the checkpoint resumed from.
        checkpoint_writer: writes checkpoints, when they are due and on a signal; None: there are none.

    Raises:
        InputError: the scene has stop_when, and no rule is given.
        InterruptedRunError: the observer returned a signal.
        RunError: an engine or the interface account failed. Every finished tick is written.
    """
    observer = observer or RunObserver()
    run_id, resolved = settings.run_id, settings.resolved
    step_ns = resolved.timing.communication_step_ns
    source, soil, controller = engines.motion_source, engines.soil, engines.controller
    mechanism = engines.mechanism
    particles = engines.particles
    before = _state_before(settings, engines)
    start = time.monotonic() - before.wall_time_s
    rules = TickRules(settings, before, observer, stop_rule, checkpoint_writer)
    write = sink.write if sink is not None else _forget
    machine: MechanismState | None = None  # at the last series tick, for the controller
    if settings.resumed is None:
        for record in _initial_records(run_id, rules, engines) if sink is not None else ():
            write(record)
    elif mechanism is not None:
        machine = mechanism.state(run_id, before.tick, tick_end_ns(before.tick, step_ns))
    while (tick := rules.state.tick + 1) <= rules.schedule.last_tick:
        if signal_number := observer.stop_signal():
            state = rules.state
            if checkpoint_writer is not None and state.tick not in (before.tick, checkpoint_writer.last_tick):
                _keep(engines, checkpoint_writer, state.tick)
                checkpoint_writer.commit(state)
            raise interrupted(signal_number).error()
        schedule, end_ns = rules.schedule, tick_end_ns(tick, step_ns)
        if particles is not None and tick == schedule.last_tick < settings.schedule.last_tick:
            particles.ends_with(tick)
        command = None
        if controller is not None and mechanism is not None and machine and schedule.control_due(tick):
            command = controller.command(tick, machine)
            mechanism.command(command)
        motions, wrenches = source.advance(tick, rules.state.wrenches), rules.state.wrenches
        if soil is not None:
            wrenches = soil.advance(tick, motions)
        report = rules.add(tick, motions, wrenches, time.monotonic() - start)
        write(Grant(run_id, tick, Command.END if tick == schedule.last_tick else Command.RUN))
        if command is not None:
            write(command)
        write(ToolMotions(run_id, tick, end_ns, motions))
        if soil is not None:
            write(ToolWrenches(run_id, tick, end_ns, wrenches))
        if report is not None:
            if mechanism is not None:
                machine = mechanism.state(run_id, tick, end_ns)
                write(machine)
            if soil is not None and sink is not None:
                write(soil_state(soil, run_id, tick, end_ns))
            write(report)
        if particles is not None and sink is not None and schedule.cloud_due(tick):
            write(recorded_cloud(particles.cloud(tick, end_ns), resolved.scene.record))
        observer.on_tick(tick)
        rules.check()
        if checkpoint_writer is not None and rules.schedule.checkpoint_due(tick):
            _keep(engines, checkpoint_writer, tick)
            rules.commit(tick)
    if checkpoint_writer is not None:
        for part, engine in engines.parts.items():
            checkpoint_writer.note_end(rules.state.tick, part, engine)


def _forget(record: RunRecord) -> None:
    """Do nothing: replaces a sink where nothing is recorded."""


def _keep(engines: Engines, checkpoint_writer: CheckpointWriter, tick: int) -> None:
    """Write the parts of a checkpoint at the end of `tick`."""
    for part, engine in engines.parts.items():
        checkpoint_writer.keep(tick, part, engine)


def _initial_records(run_id: str, rules: TickRules, engines: Engines) -> Iterator[RunRecord]:
    """Records of the state before tick 0."""
    state, soil, mechanism = rules.state, engines.soil, engines.mechanism
    yield ToolMotions(run_id, INITIAL_TICK, 0, state.motions)
    if soil is not None:
        yield ToolWrenches(run_id, INITIAL_TICK, 0, state.wrenches)
    if mechanism is not None:
        yield mechanism.initial_state(run_id, state.wrenches)
    if soil is not None:
        yield soil_state(soil, run_id, INITIAL_TICK, 0)
    yield rules.initial_report()


def _state_before(settings: RunSettings, engines: Engines) -> CouplingState:
    """The exchange before the first tick: the initial one, or a checkpoint restored in the engines."""
    if settings.resumed is not None:
        for part, engine in engines.parts.items():
            restore_engine(engine, settings.resumed, part)
        return CouplingState.of(settings.resumed)
    motions = engines.motion_source.initial_motions()
    wrenches = engines.soil.start(motions) if engines.soil is not None else ()
    return CouplingState(INITIAL_TICK, motions, wrenches, InterfaceWork())
