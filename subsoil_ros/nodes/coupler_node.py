"""The coupler as a node: grants ticks, accounts the interface energy, publishes /clock, ends the run."""

import statistics
import time
from collections import deque
from collections.abc import Callable

from rclpy.context import Context

from ..coupling.exchange import InterfaceAccount, account_of
from ..coupling.protocol import COUPLER, MECHANISM, RECORDER, SOIL, Coupler, FinishedTick
from ..coupling.schedule import schedule_of
from ..errors import RunError
from ..messages import CouplingReport, Grant, NodeHello, NodeState, TickAck, ToolMotions, ToolWrenches
from ..recording.standard import clock
from ..recording.topics import CLOCK
from ..recording.types import message_class, serialize
from ..ticks import INITIAL_TICK, tick_end_ns
from .convert import rclpy_class
from .lifeline import STARTUP_S, Lifeline, NodeRun
from .lockstep_node import LockstepNode, one_line
from .process import NodeSettings, report_to_supervisor, run_process
from .qos import PEOPLE_QOS

DEADLINE_S = 60.0
"""A tick may take this long in any case; kernels that a later tick needs may have to be compiled."""

DEADLINE_MEDIANS = 50.0
"""A tick may take so many times the median of the last ones."""

END_WORD_S = 10.0
"""Time for the word that the run is over to reach everybody."""

REST_S = 0.001
REST_WINDOW = 4
"""With grants for so many ticks ahead, nobody waits for the coupler while it rests."""

_MEASURED_TICKS = 101


class CouplerNode(LockstepNode):
    """Lets nobody run ahead, waits for nobody for ever, and judges the interface energy."""

    def __init__(
        self,
        run: NodeRun,
        lifeline: Lifeline,
        context: Context | None = None,
        on_progress: Callable[[int], None] = lambda tick: None,
    ) -> None:
        super().__init__(COUPLER, run, lifeline, context)
        scene, timing = run.resolved.scene, run.resolved.timing
        names = run.participants
        self._coupler = Coupler(
            run.hello(COUPLER),
            names,
            tuple(scene.tools),
            timing.tick_count,
            scene.coupling.grant_window,
            soil=scene.soil is not None,
        )
        self.rest_s = REST_S if scene.coupling.grant_window >= REST_WINDOW else 0.0
        self._schedule = schedule_of(scene, timing)
        self._on_progress = on_progress
        self._account: InterfaceAccount | None = None  # from the initial exchange
        self._progress_tick = INITIAL_TICK
        self._start = self._last_advance = time.monotonic()
        self._tick_times_s: deque[float] = deque(maxlen=_MEASURED_TICKS)
        self._grants = self.publisher(Grant, names)
        self._reports = self.publisher(CouplingReport, (RECORDER,))
        self._clock_publisher = self.create_publisher(
            rclpy_class("rosgraph_msgs/msg/Clock"), CLOCK, PEOPLE_QOS
        )
        mover = MECHANISM if scene.mechanism is not None else SOIL
        self.listen(ToolMotions, self._on_motions, (mover,))
        if scene.soil is not None:
            self.listen(ToolWrenches, self._on_wrenches, (SOIL,))
        if run.recorded:
            self.listen(TickAck, self._on_ack, (RECORDER,))
        self.listen(NodeHello, self._on_hello, names)

    def on_poll(self) -> None:
        """Starts the run when all are ready; finds out what is late.

        Raises:
            RunError: a tick or the start-up takes longer than it may.
        """
        now = time.monotonic()
        if self._account is None:
            if self._coupler.ready and self.matched:
                self._begin(now)
        elif self._coupler.done_tick != self._progress_tick:
            self._progress_tick = self._coupler.done_tick
            self._on_progress(self._progress_tick)
        allowed_s = self._allowed_s()
        if now - self._last_advance > allowed_s:
            raise RunError(f"no {self._coupler.missing()} within {allowed_s:.0f} s")

    def on_fault(self, error: BaseException) -> None:
        """Tells everybody the tick at which the record is cut, and why."""
        self._grants.publish(self.bytes_of(self._coupler.abort(one_line(error))))

    @property
    def done_tick(self) -> int:
        """The last tick that all have finished."""
        return self._coupler.done_tick

    def _allowed_s(self) -> float:
        if self._coupler.done_tick < 0:
            return STARTUP_S
        return max(DEADLINE_S, DEADLINE_MEDIANS * statistics.median(self._tick_times_s))

    def _begin(self, now: float) -> None:
        coupler = self._coupler
        self._account = account_of(self.run.resolved.scene, coupler.initial_motions, coupler.initial_wrenches)
        self._start = self._last_advance = now
        self.lifeline.say(NodeState.RUNNING)
        self._grant()

    def _grant(self) -> None:
        if self._account is None:
            return
        for grant in self._coupler.next_grants():
            self._grants.publish(self.bytes_of(grant))

    def _on_hello(self, hello: NodeHello) -> None:
        self._coupler.accept_hello(hello)

    def _on_motions(self, motions: ToolMotions) -> None:
        self._coupler.accept_motions(motions)
        self._follow()

    def _on_wrenches(self, wrenches: ToolWrenches) -> None:
        self._coupler.accept_wrenches(wrenches)
        self._follow()

    def _on_ack(self, ack: TickAck) -> None:
        self._coupler.accept_ack(ack)
        self._last_advance = time.monotonic()
        self._grant()
        if self._coupler.finished:
            self._end()

    def _follow(self) -> None:
        while (finished := self._coupler.take_finished()) is not None:
            self._account_for(finished)
        self._grant()
        if self._coupler.finished:
            self._end()

    def _account_for(self, finished: FinishedTick) -> None:
        assert self._account is not None  # no tick is granted before
        tick, now = finished.tick, time.monotonic()
        self._tick_times_s.append(now - self._last_advance)
        self._last_advance = now
        work = self._account.add(finished.motions, finished.wrenches)
        if self._schedule.series_due(tick):
            report = work.report(self.run.run_id, tick, self._interval_ns, now - self._start)
            self._reports.publish(self.bytes_of(report))
        self._clock_publisher.publish(serialize(clock(message_class, tick_end_ns(tick, self._interval_ns))))
        self.lifeline.tick = tick
        self._account.check(tick)

    def _end(self) -> None:
        self._on_progress(self._coupler.done_tick)
        self.lifeline.say(NodeState.ENDED)
        self.lifeline.flush(END_WORD_S)
        self.finish(0)


def build(
    settings: NodeSettings, run: NodeRun, lifeline: Lifeline, context: Context | None = None
) -> CouplerNode:
    """The node; under a supervisor it reports its progress there."""
    if not settings.supervised:
        return CouplerNode(run, lifeline, context)
    return CouplerNode(run, lifeline, context, on_progress=lambda tick: report_to_supervisor(tick=tick))


def main() -> int:
    """Runs the node as a process."""
    return run_process(COUPLER, build)


if __name__ == "__main__":
    raise SystemExit(main())
