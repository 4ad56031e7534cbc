"""The coupler as a node: grants ticks, accounts the interface energy, publishes /clock, ends the run."""

import time
from functools import partial

from rclpy.context import Context

from ...analysis.known_mean import build_stop_rule
from ...coupling.checkpoints import CouplingState
from ...coupling.energy_account import InterfaceWork
from ...coupling.exit_status import SIGNAL_STATUS, ExitStatus
from ...coupling.observer import RunObserver
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
from ...coupling.run_settings import RunSettings
from ...coupling.tick_rules import TickRules
from ...coupling.time_limits import DEADLINE_S, END_WORD_S, FAULT_S, KEEP_S, PROGRESS_S, STARTUP_S
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
from ...recording.message_codec import standard_bytes
from ...recording.standard_messages import clock
from ...recording.topics import CLOCK
from ...ticks import INITIAL_TICK, tick_end_ns
from ...yaml_document import Document
from ..process.heartbeat import Heartbeat, first_status
from ..process.node_process import one_line, report_to_supervisor, run_process
from ..transport.qos import VISUALIZATION_QOS, rclpy_class
from .diagnostics import Health, Level
from .lockstep_node import LockstepNode
from .run_control import RunControl
from .run_services import PauseServices, SimulationServices, StepsAction
from .wall_times import RunClock, TickTimes

DEADLINE_MEDIANS = 50.0
"""Time limit of a tick over the median of the last ticks, where that is longer."""

NEAR = 0.5
"""Part of a bound at which diagnostics warn: early enough to act before the run ends or waits at it."""


class CouplerNode(LockstepNode):
    """Keeps participants in step, limits the time of a tick, and checks the interface energy."""

    def __init__(
        self,
        run: RunSettings,
        heartbeat: Heartbeat,
        context: Context | None = None,
        observer: RunObserver | None = None,
    ) -> None:
        """observer: receives the last tick several times a second, and each check."""
        super().__init__(COUPLER, run, heartbeat, context)
        scene = run.resolved.scene
        names = run.participants
        self._coupler = Coupler(
            first_status(run, COUPLER),
            names,
            tuple(scene.tools),
            run.schedule,
            scene.coupling.grant_window,
            needed=needed_capabilities(scene),
            paused=run.paused,
        )
        self._observer = observer or RunObserver()
        self._checkpoint_writer = run.checkpoint_writer()
        self._keep_said = False
        self._keep_deadline: float | None = None  # of the checkpoint before a requested end
        self._fault: NodeStatus | None = None  # of a node that had finished more ticks than are known here
        self._fault_deadline = 0.0
        self._rules: TickRules | None = None  # from the initial exchange
        self._progress_tick = INITIAL_TICK
        self._last_advance = self._progress_s = time.monotonic()
        self._times = TickTimes()
        self._wall = RunClock()
        self._grants = self.tick_publisher(Grant, (), names)
        self._reports = self.publisher(CouplingReport, (RECORDER,))
        self._clock_publisher = self.create_publisher(
            rclpy_class("rosgraph_msgs/msg/Clock"), CLOCK, VISUALIZATION_QOS
        )
        motion_source = MECHANISM if scene.moved_by_participant else SOIL
        self.listen_ticks(ToolMotions, self._on_motions, motion_source)
        if scene.soil is not None:
            self.listen_ticks(ToolWrenches, self._on_wrenches, SOIL)
        if RECORDER in names:
            self.listen(TickAck, self._on_ack, (RECORDER,))
        self.listen(NodeStatus, self._on_node_status, names)
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
        self._refuse_fault(now)
        if self._rules is None:
            if self._coupler.ready and self.matched:
                self._begin(now)
        elif self._coupler.done_tick != self._progress_tick:
            self._progress_tick = self._coupler.done_tick
            self._observer.on_tick(self._progress_tick)
            self._log_progress(now)
        if self._coupler.standing:
            self._last_advance = now  # no deadline while the run is paused
            self._times.restart(self._coupler.done_tick)
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
        coupler, rules = self._coupler, self._rules
        if rules is None:
            return Health(message=f"waits for {coupler.missing()}")
        account = rules.account
        coupling = self.run.resolved.scene.coupling
        lag = coupler.done_tick - coupler.acknowledged_tick if RECORDER in self.run.participants else 0
        values: dict[str, str | float | int] = {
            "state": "paused" if coupler.paused else "running",
            "interface_residual_joule": account.work.residual_joule,
            "interface_residual_ratio": account.work.residual_ratio,
            "residual_bound": coupling.residual_bound,
            "interface_work_joule": account.work.absolute_work_joule,
            "tick_time_median_s": self._times.median_s,
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
        checkpoint_writer, rules, now = self._checkpoint_writer, self._rules, time.monotonic()
        if (
            checkpoint_writer is None
            or rules is None
            or rules.state.tick < self._first_tick
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
            self._publish_grants(grant)
        if self._coupler.acknowledged_tick < grant.tick or not checkpoint_writer.all_kept(grant.tick):
            return False
        checkpoint_writer.commit(rules.state)
        return True

    def on_fault(self, error: BaseException) -> None:
        """Publish to all nodes the tick at which the record is cut, and the reason."""
        self._publish_grants(self._coupler.abort(one_line(error)))
        self._control.refuse_waiting(f"the run has ended: {one_line(error)}")

    @property
    def done_tick(self) -> int:
        """The last tick that all have finished."""
        return self._coupler.done_tick

    def _allowed_s(self) -> float:
        if self._coupler.done_tick < self._first_tick:
            return STARTUP_S
        return max(DEADLINE_S, DEADLINE_MEDIANS * self._times.median_s)

    def _begin(self, now: float) -> None:
        coupler = self._coupler
        resumed = self.run.resumed
        before = (
            CouplingState.of(resumed)
            if resumed is not None
            else CouplingState(
                INITIAL_TICK, coupler.initial_motions, coupler.initial_wrenches, InterfaceWork()
            )
        )
        self._rules = TickRules(
            self.run,
            before,
            self._observer,
            build_stop_rule(self.run.resolved, resumed),
            self._checkpoint_writer,
        )
        self._last_advance = now
        self._times.restart(coupler.done_tick)
        self._wall.start(before.wall_time_s)
        self._decide(self._rules)  # the run may be resumed at a check tick
        if resumed is None:
            self._reports.publish(self.bytes_of(self._rules.initial_report()))
        self._say_pacing()
        self._wall.stand(self._coupler.standing)
        self._grant()

    def _decide(self, rules: TickRules) -> None:
        """After a check tick, continue or end the run with the next tick, as the rules have decided."""
        tick = rules.state.tick
        if rules.schedule.check_due(tick):
            self._coupler.decide(tick, ends=rules.schedule.last_tick == tick + 1)

    def _on_pacing(self) -> None:
        """Handle a request for a pause, its end, or steps."""
        self._last_advance = time.monotonic()
        self._times.restart(self._coupler.done_tick)
        if self._rules is not None:
            self._say_pacing()
            self._wall.stand(self._coupler.standing)
        self._grant()

    def _say_pacing(self) -> None:
        state = NodeState.PAUSED if self._coupler.paused else NodeState.RUNNING
        if self.heartbeat.state is not state:
            self.heartbeat.say(state)
            words = f"run '{self.run.run_id}': {state.name.lower()} after tick {self._coupler.done_tick}"
            advice = "; call its service resume or step to continue" if self._coupler.paused else ""
            self.get_logger().info(words + advice)

    def _grant(self) -> None:
        if self._rules is None:
            return
        self._publish_grants(*self._coupler.next_grants(self._times.ahead))

    def _publish_grants(self, *grants: Grant) -> None:
        for grant in grants:
            self._grants.publish(self.bytes_of(grant))
        self.flush()

    def _on_node_status(self, node_status: NodeStatus) -> None:
        of_run = node_status.run_id == self.run.run_id and node_status.node in self.run.participants
        behind = node_status.tick > self._coupler.done_tick
        if not (node_status.state is NodeState.FAULT and of_run and behind):
            self._coupler.accept_node_status(node_status)
        elif self._fault is None:
            self._fault, self._fault_deadline = node_status, time.monotonic() + FAULT_S

    def _refuse_fault(self, now: float) -> None:
        """Raise a fault that waits, once the batches with all ticks that the node had finished are here."""
        fault = self._fault
        if fault is not None and (self._coupler.done_tick >= fault.tick or now > self._fault_deadline):
            self._coupler.accept_node_status(fault)

    def _on_motions(self, ticks: list[ToolMotions]) -> None:
        try:
            for motions in ticks:
                self._coupler.accept_motions(motions)
        finally:
            self._follow()  # the ticks before one that is refused are done

    def _on_wrenches(self, ticks: list[ToolWrenches]) -> None:
        try:
            for wrenches in ticks:
                self._coupler.accept_wrenches(wrenches)
        finally:
            self._follow()

    def _on_command(self, command: DriverCommand) -> None:
        self._coupler.accept_command(command)
        self._follow()

    def _on_ack(self, ack: TickAck) -> None:
        self._coupler.accept_ack(ack)
        self._last_advance = time.monotonic()
        if self._rules is not None:
            self._rules.commit(ack.tick)
        self._grant()
        if self._coupler.finished:
            self._end()

    def _follow(self) -> None:
        while (finished := self._coupler.take_finished()) is not None:
            self._apply_rules(finished)
        self._times.note(self._coupler.done_tick)
        self._refuse_fault(time.monotonic())
        if self._control.waiting:
            self._control.note_done()
        self._wall.stand(self._coupler.standing)
        self._grant()
        if self._coupler.finished:
            self._end()

    def _apply_rules(self, finished: FinishedTick) -> None:
        rules, tick = self._rules, finished.tick
        assert rules is not None  # no tick is granted before
        self._last_advance = time.monotonic()
        report = rules.add(tick, finished.motions, finished.wrenches, self._wall.elapsed_s)
        if report is not None:
            self._reports.publish(self.bytes_of(report))
        if self._clock_publisher.get_subscription_count():
            now = clock(tick_end_ns(tick, self._communication_step_ns))
            self._clock_publisher.publish(standard_bytes(CLOCK, now))
        self.heartbeat.tick = tick
        rules.check()
        self._decide(rules)
        rules.commit(self._coupler.acknowledged_tick)

    def _end(self) -> None:
        self._observer.on_tick(self._coupler.done_tick)
        self._control.refuse_waiting("the run has ended")
        self.heartbeat.say(NodeState.ENDED)
        self.heartbeat.flush(END_WORD_S)
        self.get_logger().info(f"run '{self.run.run_id}' has ended with tick {self._coupler.done_tick}")
        self.finish(0)


class _ReportingObserver(RunObserver):
    """Reports to the supervisor."""

    def on_tick(self, tick: int) -> None:
        report_to_supervisor(tick=tick)

    def on_check(self, result: Document) -> None:
        report_to_supervisor(check=result)


def build(run: RunSettings, heartbeat: Heartbeat, context: Context | None = None) -> CouplerNode:
    """Build the node; under a supervisor it reports its progress to it."""
    return CouplerNode(run, heartbeat, context, _ReportingObserver() if run.supervised else None)


def main() -> int:
    """Runs the node as a process."""
    return run_process(COUPLER, build)


if __name__ == "__main__":
    raise SystemExit(main())
