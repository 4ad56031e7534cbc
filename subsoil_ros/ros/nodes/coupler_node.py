"""The coupler as a node: grants ticks, accounts the interface energy, publishes /clock, ends the run."""

import statistics
import time
from collections import deque
from collections.abc import Callable
from functools import partial

from rclpy.context import Context

from ...analysis.known_mean import build_stop_rule
from ...coupling.checkpoints import CouplingState
from ...coupling.energy_account import InterfaceAccount, InterfaceWork, account_of
from ...coupling.exit_status import KEEP_S, SIGNAL_STATUS, ExitStatus
from ...coupling.protocol import (
    ACK_LAG_TICKS,
    CONTROLLER,
    COUPLER,
    MECHANISM,
    RECORDER,
    SOIL,
    Coupler,
    FinishedTick,
    needed_capabilities,
)
from ...coupling.stopping import OnCheck
from ...errors import RunError
from ...messages import (
    CouplingReport,
    DriverCommand,
    Grant,
    NodeState,
    NodeStatus,
    TickAck,
    ToolMotions,
    ToolWrenches,
)
from ...recording.standard import clock
from ...recording.topics import CLOCK
from ...recording.types import serialize
from ...ticks import INITIAL_TICK, tick_end_ns
from ..process.heartbeat import STARTUP_S, Heartbeat, NodeRun
from ..process.node_process import report_to_supervisor, run_process
from ..process.parameters import NodeSettings
from ..services.diagnostics import Health, Level
from ..services.pause_services import PauseServices
from ..services.run_clock import RunClock
from ..services.run_control import RunControl
from ..services.simulation_services import SimulationServices, StepsAction
from ..transport.convert import rclpy_class
from ..transport.qos import VISUALIZATION_QOS
from .lockstep_node import LockstepNode, one_line

DEADLINE_S = 60.0
"""Smallest time limit of a tick: kernels that a later tick needs may have to be compiled."""

DEADLINE_MEDIANS = 50.0
"""Time limit of a tick over the median of the last ticks, where that is longer."""

NEAR = 0.5
"""Part of a bound at which diagnostics warn: early enough to act before the run ends or waits at it."""

END_WORD_S = 10.0
"""Time for the status ENDED of the coupler to reach every node."""

PROGRESS_S = 10.0
"""Wall time between two lines of the log about progress: six a minute, so a run of hours can be followed."""

REST_S = 0.001
REST_WINDOW = 4
"""The coupler pauses for the grant window over this number, a quarter of it: no node waits for a grant."""


class CouplerNode(LockstepNode):
    """Keeps participants in step, limits the time of a tick, and checks the interface energy."""

    def __init__(
        self,
        run: NodeRun,
        heartbeat: Heartbeat,
        context: Context | None = None,
        on_progress: Callable[[int], None] = lambda tick: None,
        paused: bool = False,
        on_check: OnCheck = lambda result: None,
    ) -> None:
        super().__init__(COUPLER, run, heartbeat, context)
        scene = run.resolved.scene
        names = run.participants
        self._coupler = Coupler(
            run.node_status(COUPLER),
            names,
            tuple(scene.tools),
            run.schedule,
            scene.coupling.grant_window,
            needed=needed_capabilities(scene),
            paused=paused,
        )
        self._stop_rule = build_stop_rule(run.resolved, run.resumed)
        self._on_check = on_check
        self._checkpoint_writer = run.checkpoint_writer()
        self._to_commit: deque[CouplingState] = deque()  # checkpoints whose record is not yet on the disk
        self._last: CouplingState | None = None  # the exchange at the end of the last finished tick
        self._keep_said = False
        self._keep_deadline: float | None = None  # of the checkpoint before a requested end
        self.rest_s = REST_S if scene.coupling.grant_window >= REST_WINDOW else 0.0
        self._on_progress = on_progress
        self._account: InterfaceAccount | None = None  # from the initial exchange
        self._progress_tick = INITIAL_TICK
        self._last_advance = self._progress_s = time.monotonic()
        self._wall = RunClock()
        self._grants = self.publisher(Grant, names)
        self._reports = self.publisher(CouplingReport, (RECORDER,))
        self._clock_publisher = self.create_publisher(
            rclpy_class("rosgraph_msgs/msg/Clock"), CLOCK, VISUALIZATION_QOS
        )
        motion_source = MECHANISM if scene.moved_by_participant else SOIL
        self.listen(ToolMotions, self._on_motions, (motion_source,))
        if scene.soil is not None:
            self.listen(ToolWrenches, self._on_wrenches, (SOIL,))
        if RECORDER in names:
            self.listen(TickAck, self._on_ack, (RECORDER,))
        self.listen(NodeStatus, self._coupler.accept_node_status, names)
        if scene.controller is not None:
            self.listen(DriverCommand, self._on_command, (CONTROLLER,))
        self._control = RunControl(self._coupler, self._on_pacing, heartbeat.request_stop)
        guarded = partial(self._guarded, after_end=True)
        self._pausing = PauseServices(self, self._control, guarded)
        self._simulation = SimulationServices(self, self._control, guarded)
        self._steps = StepsAction(heartbeat, self._control)

    def on_poll(self) -> None:
        """Start the run when all are ready; check the time limit of the tick.

        Raises:
            RunError: a tick or the start-up exceeds its time limit.
        """
        self._steps.poll()
        now = time.monotonic()
        if self._account is None:
            if self._coupler.ready and self.matched:
                self._begin(now)
        elif self._coupler.done_tick != self._progress_tick:
            self._progress_tick = self._coupler.done_tick
            self._on_progress(self._progress_tick)
            self._log_progress(now)
        if self._coupler.standing:
            self._last_advance = now  # no deadline while the run is paused
            self.discount_wait()
        allowed_s = self._allowed_s()
        if now - self._last_advance > allowed_s:
            raise RunError(f"no {self._coupler.missing()} within {allowed_s:.0f} s")

    def on_ended(self) -> None:
        """End goals of the action that come after the end of the run."""
        self._steps.poll()

    def waits_for(self) -> str:
        """The nodes that are not ready, in words."""
        return self._coupler.missing() if not self._coupler.ready else super().waits_for()

    def _log_progress(self, now: float) -> None:
        if now - self._progress_s >= PROGRESS_S:
            self._progress_s = now
            tick, last = self._coupler.done_tick, self._coupler.last_tick
            self.get_logger().info(f"tick {tick} of {last}, {100.0 * tick / max(last, 1):.0f} %")

    def health(self) -> Health:
        """The interface account, the time that a tick takes, the lag of the recorder."""
        coupler, account = self._coupler, self._account
        if account is None:
            return Health(message=f"waits for {coupler.missing()}")
        coupling = self.run.resolved.scene.coupling
        lag = coupler.done_tick - coupler.acknowledged_tick if RECORDER in self.run.participants else 0
        values: dict[str, str | float | int] = {
            "state": "paused" if coupler.paused else "running",
            "interface_residual_joule": account.work.residual_joule,
            "interface_residual_ratio": account.work.residual_ratio,
            "residual_bound": coupling.residual_bound,
            "interface_work_joule": account.work.absolute_work_joule,
            "tick_time_median_s": statistics.median(self.tick_times_s) if self.tick_times_s else 0.0,
            "recorder_lag_ticks": lag,
        }
        if account.nears_bound(NEAR):
            return Health(Level.WARN, "the interface energy residual comes near its bound", values)
        if lag > NEAR * ACK_LAG_TICKS:
            return Health(Level.WARN, f"the recorder is {lag} ticks behind; the disk is slow", values)
        return Health(Level.OK, "paused" if coupler.paused else "running", values)

    def on_stop(self, stop: ExitStatus) -> None:
        """Write a checkpoint of an interrupted run, within KEEP_S, then end it.

        Raises:
            RunError: the checkpoint is written, or cannot be.
        """
        if self._is_kept_before(stop):
            raise stop.error()

    def _is_kept_before(self, stop: ExitStatus) -> bool:
        """Take the next step towards a checkpoint; return whether nothing is left to wait for."""
        checkpoint_writer, now = self._checkpoint_writer, time.monotonic()
        if (
            checkpoint_writer is None
            or self._last is None
            or stop.code <= SIGNAL_STATUS
            or self.heartbeat.lost
        ):
            return True
        if self._keep_deadline is None:
            self._keep_deadline = now + KEEP_S
            self._coupler.hold()
        grant = self._coupler.keep()
        if now > self._keep_deadline or (grant is not None and checkpoint_writer.last_tick == grant.tick):
            return True
        if grant is None:
            return False
        if not self._keep_said:
            self._keep_said = True
            self._grants.publish(self.bytes_of(grant))
        if self._coupler.acknowledged_tick < grant.tick or not checkpoint_writer.all_kept(grant.tick):
            return False
        checkpoint_writer.commit(self._last)
        return True

    def on_fault(self, error: BaseException) -> None:
        """Publish to all nodes the tick at which the record is cut, and the reason."""
        self._grants.publish(self.bytes_of(self._coupler.abort(one_line(error))))
        self._control.refuse_waiting(f"the run has ended: {one_line(error)}")

    @property
    def done_tick(self) -> int:
        """The last tick that all have finished."""
        return self._coupler.done_tick

    def _allowed_s(self) -> float:
        if self._coupler.done_tick < self._first_tick:
            return STARTUP_S
        usual_s = statistics.median(self.tick_times_s) if self.tick_times_s else 0.0
        return max(DEADLINE_S, DEADLINE_MEDIANS * usual_s)

    def _begin(self, now: float) -> None:
        coupler = self._coupler
        resumed = self.run.resumed
        before = CouplingState.of(resumed) if resumed is not None else None
        self._account = account_of(
            self.run.resolved.scene,
            coupler.initial_motions,
            coupler.initial_wrenches,
            before.work if before is not None else None,
        )
        self._last_advance = now
        self._wall.start(before.wall_time_s if before is not None else 0.0)
        if coupler.schedule.check_due(coupler.done_tick):  # the run is resumed at a check tick
            self._decide(coupler.done_tick)
        if resumed is None:
            self._report(INITIAL_TICK, self._account.work, 0.0)
        self._say_pacing()
        self._wall.stand(self._coupler.standing)
        self._grant()

    def _report(self, tick: int, work: InterfaceWork, wall_time_s: float) -> None:
        report = work.report(self.run.run_id, tick, self._communication_step_ns, wall_time_s)
        self._reports.publish(self.bytes_of(report))

    def _decide(self, tick: int) -> None:
        """Continue after a check tick, or end the run with the next tick."""
        rule = self._stop_rule
        assert rule is not None  # of a scene with check ticks
        self._on_check(rule.result())
        self._coupler.decide(tick, ends=rule.state.stops)

    def _on_pacing(self) -> None:
        """Handle a request for a pause, its end, or steps."""
        self._last_advance = time.monotonic()
        self.discount_wait()
        if self._account is not None:
            self._say_pacing()
            self._wall.stand(self._coupler.standing)
        self._grant()

    def _say_pacing(self) -> None:
        window = self.run.resolved.scene.coupling.grant_window
        self.rest_ticks = 0 if self._coupler.paused else window // REST_WINDOW  # the caller of steps waits
        state = NodeState.PAUSED if self._coupler.paused else NodeState.RUNNING
        if self.heartbeat.state is not state:
            self.heartbeat.say(state)
            words = f"run '{self.run.run_id}': {state.name.lower()} after tick {self._coupler.done_tick}"
            advice = "; call its service resume or step to continue" if self._coupler.paused else ""
            self.get_logger().info(words + advice)

    def _grant(self) -> None:
        if self._account is None:
            return
        for grant in self._coupler.next_grants():
            self._grants.publish(self.bytes_of(grant))

    def _on_motions(self, motions: ToolMotions) -> None:
        self._coupler.accept_motions(motions)
        self._follow()

    def _on_wrenches(self, wrenches: ToolWrenches) -> None:
        self._coupler.accept_wrenches(wrenches)
        self._follow()

    def _on_command(self, command: DriverCommand) -> None:
        self._coupler.accept_command(command)
        self._follow()

    def _on_ack(self, ack: TickAck) -> None:
        self._coupler.accept_ack(ack)
        self._last_advance = time.monotonic()
        self._commit_recorded()
        self._grant()
        if self._coupler.finished:
            self._end()

    def _follow(self) -> None:
        while (finished := self._coupler.take_finished()) is not None:
            self._account_for(finished)
        self._control.note_done()
        self._wall.stand(self._coupler.standing)
        self._grant()
        if self._coupler.finished:
            self._end()

    def _account_for(self, finished: FinishedTick) -> None:
        assert self._account is not None  # no tick is granted before
        tick, schedule = finished.tick, self._coupler.schedule
        self._last_advance = time.monotonic()
        work = self._account.add(finished.motions, finished.wrenches)
        if schedule.series_due(tick):
            self._report(tick, work, self._wall.elapsed_s)
        self._clock_publisher.publish(serialize(clock(tick_end_ns(tick, self._communication_step_ns))))
        self.heartbeat.tick = tick
        self._account.check(tick)
        stopping = None
        if self._stop_rule is not None:
            self._stop_rule.add(tick, finished.motions, finished.wrenches)
            if schedule.check_due(tick):
                self._stop_rule.check()
                self._decide(tick)
            elif tick == schedule.last_tick and not self._stop_rule.state.stops:
                self._on_check(self._stop_rule.result())
            stopping = self._stop_rule.state
        schedule = self._coupler.schedule  # which the check may have shortened
        elapsed_s = self._wall.elapsed_s
        self._last = CouplingState(tick, finished.motions, finished.wrenches, work, elapsed_s, stopping)
        if self._checkpoint_writer is not None and schedule.checkpoint_due(tick):
            self._to_commit.append(self._last)
            self._commit_recorded()
        if self._checkpoint_writer is not None and tick == schedule.last_tick:
            self._checkpoint_writer.note_coupling_end(self._last)

    def _commit_recorded(self) -> None:
        """Commit checkpoints whose record is on the disk; without a recorder, at once."""
        recorded = self._coupler.acknowledged_tick
        while self._checkpoint_writer is not None and self._to_commit and self._to_commit[0].tick <= recorded:
            self._checkpoint_writer.commit(self._to_commit.popleft())

    def _end(self) -> None:
        self._on_progress(self._coupler.done_tick)
        self._control.refuse_waiting("the run has ended")
        self.heartbeat.say(NodeState.ENDED)
        self.heartbeat.flush(END_WORD_S)
        self.get_logger().info(f"run '{self.run.run_id}' has ended with tick {self._coupler.done_tick}")
        self.finish(0)


def build(
    settings: NodeSettings, run: NodeRun, heartbeat: Heartbeat, context: Context | None = None
) -> CouplerNode:
    """Build the node; under a supervisor it reports its progress to it."""
    if not settings.supervised:
        return CouplerNode(run, heartbeat, context, paused=settings.paused)
    return CouplerNode(
        run,
        heartbeat,
        context,
        on_progress=lambda tick: report_to_supervisor(tick=tick),
        paused=settings.paused,
        on_check=lambda result: report_to_supervisor(check=result),
    )


def main() -> int:
    """Runs the node as a process."""
    return run_process(COUPLER, build)


if __name__ == "__main__":
    raise SystemExit(main())
