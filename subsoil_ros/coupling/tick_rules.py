"""Rules of a tick, the same in every mode: interface account, stop rule, early end, checkpoints."""

from collections import deque
from dataclasses import replace
from typing import Protocol

from ..errors import InputError
from ..messages import CouplingReport, ToolMotion, ToolWrench
from ..ticks import INITIAL_TICK
from ..yaml_document import Document
from .checkpoints import CheckpointWriter, CouplingState, StopState
from .energy_account import account_of
from .observer import RunObserver
from .run_settings import RunSettings


class StopRule(Protocol):
    """Observes the exchange of every tick, and decides at check ticks whether the run ends."""

    state: StopState

    def add(self, tick: int, motions: tuple[ToolMotion, ...], wrenches: tuple[ToolWrench, ...]) -> None:
        """Add the exchange of `tick`."""
        ...

    def check(self) -> bool:
        """Decide from the ticks added whether the run ends with the next tick."""
        ...

    def result(self) -> Document:
        """Present result for the mean, in the form of `run.stop_when` of summary.json."""
        ...


class TickRules:
    """Rules of a run, applied tick by tick by whoever exchanges motions and wrenches.

    Each finished tick is passed to `add`, which accounts for it, then to `check`, which may fail the run or
    end it early. `state` is the exchange at the end of the last tick checked, `schedule` that of the run: it
    ends with the next tick once a check has decided so.

    Args:
        state: the exchange before the first tick.
        stop_rule: rule of a scene with stop_when, in the same state.
        checkpoint_writer: commits the checkpoints; None: there are none.

    Raises:
        InputError: the scene has stop_when, and no rule is given.
    """

    def __init__(
        self,
        settings: RunSettings,
        state: CouplingState,
        observer: RunObserver,
        stop_rule: StopRule | None = None,
        checkpoint_writer: CheckpointWriter | None = None,
    ) -> None:
        self.schedule = settings.schedule
        self.state = state
        scene, timing = settings.resolved.scene, settings.resolved.timing
        step_s = timing.communication_step_s
        self.account = account_of(
            scene, state.motions, state.wrenches, step_s, state.work, begun=state.tick > INITIAL_TICK
        )
        self._run_id, self._step_ns = settings.run_id, timing.communication_step_ns
        self._observer, self._stop_rule, self._writer = observer, stop_rule, checkpoint_writer
        self._added = state  # the tick to check next
        self._uncommitted: deque[CouplingState] = deque()
        if self.schedule.check_ticks and stop_rule is None:
            raise InputError(
                f"{settings.resolved.path}: has stop_when, and this run has no rule; give stop_rule"
            )
        if stop_rule is not None and self.schedule.check_due(state.tick):  # the run is resumed at a check
            self._end_or_continue(stop_rule, state.tick)

    def initial_report(self) -> CouplingReport:
        """The account before tick 0, as it is recorded."""
        return self.state.work.report(self._run_id, INITIAL_TICK, self._step_ns, 0.0)

    def add(
        self, tick: int, motions: tuple[ToolMotion, ...], wrenches: tuple[ToolWrench, ...], wall_time_s: float
    ) -> CouplingReport | None:
        """Account for a finished tick; return the report of a series tick, None at other ticks.

        wall_time_s: since tick 0, earlier runs included.
        """
        work = self.account.add(motions, wrenches)
        self._added = CouplingState(tick, motions, wrenches, work, wall_time_s)
        if not self.schedule.series_due(tick):
            return None
        return work.report(self._run_id, tick, self._step_ns, wall_time_s)

    def check(self) -> None:
        """Check the tick added last, and decide at check ticks whether the run ends with the next one.

        Raises:
            PhysicsError: the interface account is out of its bound, or not finite.
            RecordingError: the disk cannot be written.
        """
        state, rule = self._added, self._stop_rule
        self.account.check(state.tick)
        if rule is not None:
            rule.add(state.tick, state.motions, state.wrenches)
            if self.schedule.check_due(state.tick):
                rule.check()
                self._end_or_continue(rule, state.tick)
            elif state.tick == self.schedule.last_tick and not rule.state.stops:
                self._observer.on_check(rule.result())
            state = replace(state, stopping=rule.state)
        self.state = state
        if self._writer is not None and self.schedule.checkpoint_due(state.tick):
            self._uncommitted.append(state)
        if self._writer is not None and state.tick == self.schedule.last_tick:
            self._writer.note_coupling_end(state)

    def commit(self, recorded_tick: int) -> None:
        """Make the checkpoints valid that are due up to `recorded_tick`, whose record is written.

        Raises:
            RecordingError: the disk cannot be written.
        """
        while self._writer is not None and self._uncommitted and self._uncommitted[0].tick <= recorded_tick:
            self._writer.commit(self._uncommitted.popleft())

    def _end_or_continue(self, rule: StopRule, tick: int) -> None:
        """After check tick `tick`."""
        self._observer.on_check(rule.result())
        if rule.state.stops:
            self.schedule = self.schedule.ends_with(tick + 1)
