"""The mechanism as a node: advances each granted tick under the soil's last wrenches."""

import time
from typing import cast

from rclpy.context import Context

from ...coupling.checkpoints import CouplingState, restore_engine
from ...coupling.engines import Mechanism, MotionSource, build_mechanism
from ...coupling.protocol import CONTROLLER, COUPLER, MECHANISM, RECORDER, SOIL, Needs, Participant
from ...coupling.run_settings import RunSettings
from ...errors import SceneError
from ...messages import (
    Command,
    DriverCommand,
    Grant,
    MechanismState,
    NodeState,
    NodeStatus,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from ...ticks import tick_end_ns
from ..process.heartbeat import Heartbeat
from ..process.node_process import run_process
from .diagnostics import Health
from .lockstep_node import LockstepNode
from .visualization_publisher import VisualizationPublisher


class MechanismNode(LockstepNode):
    """Publishes the motions of every granted tick; has no clock and no physics of its own.

    The engine is the scene's mechanism, or an external machine, which has no state to publish.
    """

    def __init__(
        self, engine: MotionSource, run: RunSettings, heartbeat: Heartbeat, context: Context | None = None
    ) -> None:
        super().__init__(MECHANISM, run, heartbeat, context)
        scene = run.resolved.scene
        self._engine = engine
        self._mechanism = cast(Mechanism, engine) if scene.mechanism is not None else None
        self._with_soil = scene.soil is not None
        needs = Needs.WRENCHES if self._with_soil else Needs.NOTHING
        self._participant = Participant(run.run_id, run.schedule, needs, tuple(scene.tools), commanded=True)
        self._checkpoint_writer = run.checkpoint_writer()
        self._state: MechanismState | None = None  # the last one published
        self._engine_s = 0.0  # spent in the engine
        at_once = (SOIL,) if self._with_soil else ()
        self._motions = self.tick_publisher(ToolMotions, at_once, (COUPLER, RECORDER))
        controllers = (CONTROLLER,) if scene.controller is not None else ()
        if self._mechanism is not None:
            self._states = self.publisher(MechanismState, (RECORDER, *controllers))
        self._visualization = VisualizationPublisher(self, run.resolved)
        self._initial_motions = (
            CouplingState.of(run.resumed).motions
            if self._mechanism is None and run.resumed is not None  # it gives those of tick -1 only
            else engine.initial_motions()
        )
        self.heartbeat.say(NodeState.STARTING, motions=self._initial_motions)
        self.listen(NodeStatus, self._on_node_status, ())
        self.listen_grants(self._accept, self._work)
        if self._with_soil:
            self.listen(ToolWrenches, self._on_wrenches, (SOIL,))
        if controllers:
            self.listen(DriverCommand, self._on_command, controllers)
        self._started = not self._with_soil
        self._initial_wrenches: tuple[ToolWrench, ...] = ()

    def on_poll(self) -> None:
        """Publish READY once the messages that tick 0 needs are here and every node listens."""
        self._visualization.poll()
        if self.heartbeat.state is NodeState.STARTING and self._started and self.matched:
            self.say_ready(motions=self._initial_motions)

    def health(self) -> Health:
        """Residuals of the constraints, from the last state published."""
        values: dict[str, str | float | int] = {"engine_s": self._engine_s}
        if self._state is not None:
            names = ("position_residual_m", "velocity_residual_m_per_s", "draft_newton")
            values |= {name: getattr(self._state, name) for name in names}
        return Health(values=values)

    def _on_node_status(self, node_status: NodeStatus) -> None:
        if (
            node_status.node == SOIL
            and node_status.state is NodeState.READY
            and node_status.run_id == self.run.run_id
        ):
            if not self._started:
                self._initial_wrenches = node_status.initial_wrenches
                self._participant.start(self._initial_wrenches)
                self._started = True
        else:
            self.follow_coupler_end(node_status)

    def _accept(self, grant: Grant) -> None:
        if grant.command is Command.CHECKPOINT:
            self._participant.accept_keep(grant)
            self._keep(grant.tick)
            return
        self._participant.accept_grant(grant)
        if grant.command is Command.ABORT:
            self.finish_aborted(grant)
            return
        schedule = self._participant.schedule
        if grant.tick == 0 and self._mechanism is not None:
            self._publish(self._mechanism.initial_state(self.run.run_id, self._initial_wrenches))
        elif grant.tick == schedule.first_tick and schedule.control_due(grant.tick):
            self._publish_state(grant.tick - 1)  # a resumed run, whose controller has not received it

    def _on_wrenches(self, wrenches: ToolWrenches) -> None:
        self._participant.accept_wrenches(wrenches)
        self._work()

    def _on_command(self, command: DriverCommand) -> None:
        self._participant.accept_command(command)
        self._work()

    def _work(self) -> None:
        while (work := self._participant.next_work()) is not None:
            tick = work.tick
            end_ns = tick_end_ns(tick, self._communication_step_ns)
            if work.command is not None and self._mechanism is not None:
                self._mechanism.command(work.command)
            begin = time.perf_counter()
            motions = self._engine.advance(tick, work.wrenches)
            self._engine_s += time.perf_counter() - begin
            schedule = self._participant.schedule
            if schedule.checkpoint_due(tick):
                self._keep(tick)  # before the motions, which imply that the part is written
            self._motions.publish(self.bytes_of(ToolMotions(self.run.run_id, tick, end_ns, motions)))
            if schedule.series_due(tick):
                self._visualization.move(self._publish_state(tick), motions, end_ns)
            self._participant.finish(tick)
            if self._checkpoint_writer is not None and self._participant.finished:
                self._checkpoint_writer.note_end(tick, MECHANISM, self._engine)
            self.note_tick(tick, self._participant.finished)
        if self._participant.waits_for_grant:
            self.flush()

    def _publish_state(self, tick: int) -> MechanismState | None:
        if self._mechanism is None:
            return None
        end_ns = tick_end_ns(tick, self._communication_step_ns)
        return self._publish(self._mechanism.state(self.run.run_id, tick, end_ns))

    def _publish(self, state: MechanismState) -> MechanismState:
        self._states.publish(self.bytes_of(state))
        self._state = state
        return state

    def _keep(self, tick: int) -> None:
        if self._checkpoint_writer is not None:
            self._checkpoint_writer.keep(tick, MECHANISM, self._engine)


def build(
    run: RunSettings,
    heartbeat: Heartbeat,
    context: Context | None = None,
    engine: MotionSource | None = None,
) -> MechanismNode:
    """The node with its engine: the scene's mechanism, unless another one is given.

    Raises:
        SceneError: the scene has no mechanism, or it cannot be assembled.
        InputError: the checkpoint to continue from does not fit.
    """
    engine = engine or build_mechanism(run.resolved)
    if engine is None:
        raise SceneError(f"{run.resolved.path}: has no 'mechanism'; no mechanism node is needed for it")
    if run.resumed is not None:
        restore_engine(engine, run.resumed, MECHANISM)
    return MechanismNode(engine, run, heartbeat, context)


def main() -> int:
    """Runs the node as a process."""
    return run_process(MECHANISM, build)


if __name__ == "__main__":
    raise SystemExit(main())
