"""A controller as a node: publishes a DriverCommand for every control tick, from the mechanism's state."""

from rclpy.context import Context

from ...coupling.control import Controller, build_controller
from ...coupling.protocol import CONTROLLER, COUPLER, MECHANISM, RECORDER, Commander
from ...coupling.run_settings import RunSettings
from ...errors import SceneError
from ...messages import DriverCommand, Grant, MechanismState, NodeState, NodeStatus
from ..process.heartbeat import Heartbeat
from ..process.node_process import run_process
from .lockstep_node import LockstepNode


class ControllerNode(LockstepNode):
    """The controller in the lockstep: the run waits for each of its commands, and for nothing else of it."""

    def __init__(
        self, controller: Controller, run: RunSettings, heartbeat: Heartbeat, context: Context | None = None
    ) -> None:
        """Create the node. Raises SceneError if the scene has no controller."""
        super().__init__(CONTROLLER, run, heartbeat, context)
        if run.resolved.scene.controller is None:
            raise SceneError(f"{run.resolved.path}: has no 'controller'; no controller node is needed for it")
        self._controller = controller
        self._commander = Commander(run.run_id, run.schedule)
        self._commands = self.publisher(DriverCommand, (MECHANISM, COUPLER, RECORDER))
        self.listen(MechanismState, self._on_state, (MECHANISM,))
        self.listen_ticks(Grant, self._on_grants, COUPLER)
        self.listen(NodeStatus, self.follow_coupler_end, ())

    def on_poll(self) -> None:
        """Publish READY once every node is there."""
        if self.heartbeat.state is NodeState.STARTING and self.matched:
            self.say_ready()

    def _on_grants(self, grants: list[Grant]) -> None:
        for grant in grants:
            self._commander.accept_grant(grant)
        if self._commander.abort is not None:
            self.finish_aborted(self._commander.abort)

    def _on_state(self, state: MechanismState) -> None:
        tick = self._commander.accept_state(state)
        if tick is None:
            return
        self._commands.publish(self.bytes_of(self._controller.command(tick, state)))
        self.note_tick(tick, self._commander.is_last(tick))


def build(run: RunSettings, heartbeat: Heartbeat, context: Context | None = None) -> ControllerNode:
    """The node with the scene's control law.

    Raises:
        SceneError: the scene has none.
    """
    controller = build_controller(run.resolved, run.resumed)
    if controller is None:
        raise SceneError(
            f"{run.resolved.path}: has no 'controller', or an external one; this node is not needed for it"
        )
    return ControllerNode(controller, run, heartbeat, context)


def main() -> int:
    """Runs the node as a process."""
    return run_process(CONTROLLER, build)


if __name__ == "__main__":
    raise SystemExit(main())
