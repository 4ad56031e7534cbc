"""The soil as a node: publishes the wrenches on the tools for the motions of each tick."""

import time
from dataclasses import fields

from rclpy.context import Context

from ...coupling.checkpoints import CouplingState, restore_engine
from ...coupling.engines import (
    PATHS,
    MotionSource,
    ParticleReadings,
    Resumable,
    Soil,
    build_paths,
    build_soil,
    soil_state,
)
from ...coupling.protocol import COUPLER, MECHANISM, RECORDER, SOIL, Needs, Participant
from ...coupling.run_settings import RunSettings
from ...errors import SceneError
from ...messages import (
    Command,
    Grant,
    NodeState,
    NodeStatus,
    SoilCloud,
    SoilState,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from ...recording.message_codec import standard_bytes
from ...recording.soil_clouds import recorded_cloud
from ...recording.standard_messages import tool_messages
from ...recording.topics import tool_topics
from ...ticks import INITIAL_TICK, tick_end_ns
from ..process.heartbeat import Heartbeat
from ..process.node_process import run_process
from ..transport.qos import VISUALIZATION_QOS, rclpy_class
from .diagnostics import Health, Level
from .lockstep_node import LockstepNode
from .visualization_publisher import VisualizationPublisher

_MONITORS = tuple(
    item.name
    for item in fields(SoilState)
    if item.name not in ("run_id", "tick", "end_time_ns", "lost_particles")
)


class SoilNode(LockstepNode):
    """Publishes the wrenches of every tick; has no clock and no physics of its own.

    In a scene without mechanism it also hosts the prescribed paths (`motion_source`) and publishes
    the motions.
    """

    def __init__(
        self,
        engine: Soil,
        motion_source: MotionSource | None,
        run: RunSettings,
        heartbeat: Heartbeat,
        context: Context | None = None,
    ) -> None:
        super().__init__(SOIL, run, heartbeat, context)
        scene = run.resolved.scene
        self._engine = engine
        self._particles = engine if isinstance(engine, ParticleReadings) else None
        self._motion_source = motion_source
        needs = Needs.MOTIONS if motion_source is None else Needs.NOTHING
        self._participant = Participant(run.run_id, run.schedule, needs, tuple(scene.tools))
        self._checkpoint_writer = run.checkpoint_writer()
        self._state: SoilState | None = None  # the last one published
        self._engine_s = 0.0  # spent in the engine
        self._initial_motions: tuple[ToolMotion, ...] = ()
        self._last_wrenches: tuple[ToolWrench, ...] | None = None  # None: the soil has not answered yet
        at_once = (MECHANISM,) if motion_source is None else ()
        self._wrenches = self.tick_publisher(ToolWrenches, at_once, (COUPLER, RECORDER))
        self._states = self.publisher(SoilState, (RECORDER,))
        self._clouds = self.publisher(SoilCloud, (RECORDER,)) if run.schedule.cloud_ticks else None
        self._tool_count = len(scene.tools)
        self._tool_publishers = {
            topic: self.create_publisher(rclpy_class(name), topic, VISUALIZATION_QOS)
            for topic, name in tool_topics(scene).items()
        }
        self._visualization = (
            VisualizationPublisher(self, run.resolved) if motion_source is not None else None
        )
        self.listen_grants(self._accept, self._work)
        if motion_source is None:
            self.listen(ToolMotions, self._on_motions, (MECHANISM,))
        else:
            self._motions = self.tick_publisher(ToolMotions, (), (COUPLER, RECORDER))
        self.listen(NodeStatus, self._on_node_status, ())

    def on_poll(self) -> None:
        """Start paths; publish READY once the initial wrenches are computed and every node listens."""
        if self._visualization is not None:
            self._visualization.poll()
        if self.heartbeat.state is not NodeState.STARTING:
            return
        if self._motion_source is not None and self._last_wrenches is None:
            self._start(self._motion_source.initial_motions())
        if self._last_wrenches is not None and self.matched:
            motions = self._initial_motions if self._motion_source is not None else ()
            self.say_ready(motions, self._last_wrenches)

    def health(self) -> Health:
        """Monitors of the last state published; a wedge model has none."""
        values: dict[str, str | float | int] = {"engine_s": self._engine_s}
        state = self._state
        if state is None or self.run.resolved.scene.particle_soil is None:
            return Health(values=values)
        values |= {name: getattr(state, name) for name in _MONITORS}
        if state.lost_particle_count:
            return Health(Level.WARN, f"{state.lost_particle_count} particles left the bin", values)
        return Health(values=values)

    def _start(self, motions: tuple[ToolMotion, ...]) -> None:
        self._initial_motions = motions
        if self.run.resumed is not None:
            self._last_wrenches = CouplingState.of(self.run.resumed).wrenches
        else:
            self._last_wrenches = self._engine.start(motions)

    def _on_node_status(self, node_status: NodeStatus) -> None:
        if (
            node_status.node == MECHANISM
            and self._motion_source is None
            and node_status.run_id == self.run.run_id
        ):
            if self._last_wrenches is None and len(node_status.initial_motions) == self._tool_count:
                self._start(node_status.initial_motions)
        else:
            self.follow_coupler_end(node_status)

    def _accept(self, grant: Grant) -> None:
        if grant.command is Command.CHECKPOINT:
            self._participant.accept_keep(grant)
            self._keep(grant.tick)
            return
        last_tick = self._participant.last_tick
        self._participant.accept_grant(grant)
        if grant.command is Command.ABORT:
            self.finish_aborted(grant)
            return
        early = grant.command is Command.END and grant.tick < last_tick
        if early and self._particles is not None:
            self._particles.ends_with(grant.tick)
        if grant.tick == 0:
            self._publish_state(INITIAL_TICK)

    def _on_motions(self, motions: ToolMotions) -> None:
        self._participant.accept_motions(motions)
        self._work()

    def _work(self) -> None:
        while (work := self._participant.next_work()) is not None:
            tick, motions = work.tick, work.motions
            end_ns = tick_end_ns(tick, self._communication_step_ns)
            if self._motion_source is not None:
                motions = self._motion_source.advance(tick, self._last_wrenches or ())
                self._motions.publish(self.bytes_of(ToolMotions(self.run.run_id, tick, end_ns, motions)))
            begin = time.perf_counter()
            wrenches = self._last_wrenches = self._engine.advance(tick, motions)
            self._engine_s += time.perf_counter() - begin
            schedule = self._participant.schedule
            if schedule.checkpoint_due(tick):
                self._keep(tick)  # before the wrenches, which imply that the part is written
            self._wrenches.publish(self.bytes_of(ToolWrenches(self.run.run_id, tick, end_ns, wrenches)))
            if schedule.series_due(tick):
                self._publish_state(tick)
                self._publish_standard_messages(motions, wrenches, end_ns)
            if self._clouds is not None and self._particles is not None and schedule.cloud_due(tick):
                cloud = recorded_cloud(self._particles.cloud(tick, end_ns), self.run.resolved.scene.record)
                self._clouds.publish(self.bytes_of(cloud))
            self._participant.finish(tick)
            if self._checkpoint_writer is not None and self._participant.finished:
                for part, engine in self._parts():
                    self._checkpoint_writer.note_end(tick, part, engine)
            self.note_tick(tick, self._participant.finished)
        if self._participant.waits_for_grant:
            self.flush()

    def _publish_state(self, tick: int) -> None:
        end_ns = tick_end_ns(tick, self._communication_step_ns)
        self._state = soil_state(self._engine, self.run.run_id, tick, end_ns)
        self._states.publish(self.bytes_of(self._state))

    def _parts(self) -> list[tuple[str, Resumable]]:
        """Parts of a checkpoint that this node writes, with their engines."""
        paths = [] if self._motion_source is None else [(PATHS, self._motion_source)]
        return [(SOIL, self._engine), *paths]

    def _keep(self, tick: int) -> None:
        if self._checkpoint_writer is not None:
            for part, engine in self._parts():
                self._checkpoint_writer.keep(tick, part, engine)

    def destroy_node(self) -> None:
        """End the engine's other processes, if it has any, with the node."""
        if (close := getattr(self._engine, "close", None)) is not None:
            close()
        super().destroy_node()

    def _publish_standard_messages(
        self, motions: tuple[ToolMotion, ...], wrenches: tuple[ToolWrench, ...], end_ns: int
    ) -> None:
        if self._visualization is not None:
            self._visualization.move(None, motions, end_ns)
        for topic, record in tool_messages(self.run.resolved.scene, motions, wrenches, end_ns):
            self._tool_publishers[topic].publish(standard_bytes(topic, record))


def build(
    run: RunSettings, heartbeat: Heartbeat, context: Context | None = None, engine: Soil | None = None
) -> SoilNode:
    """The node with its engine: the scene's soil, unless another one is given.

    Raises:
        SceneError: the scene has no soil.
        InputError: the checkpoint to continue from does not fit.
    """
    if run.ranks > 1:
        from ...dem.lammps.ranks import refuse_other_count

        refuse_other_count(run.ranks)
    engine = engine or build_soil(run.resolved, run.threads)
    if engine is None:
        raise SceneError(f"{run.resolved.path}: has no 'soil'; no soil node is needed for it")
    motion_source = None if run.resolved.scene.moved_by_participant else build_paths(run.resolved)
    if run.resumed is not None:
        restore_engine(engine, run.resumed, SOIL)
        if motion_source is not None:
            restore_engine(motion_source, run.resumed, PATHS)
    return SoilNode(engine, motion_source, run, heartbeat, context)


def main() -> int:
    """Runs the node as a process."""
    return run_process(SOIL, build)


if __name__ == "__main__":
    raise SystemExit(main())
