"""The one wiring of engines, controller, bag and loop for a run without ROS."""

from ..analysis.known_mean import build_stop_rule
from ..coupling.control import Controller, build_controller
from ..coupling.direct import RecordSink, run_direct
from ..coupling.engines import Engines, MotionSource, Soil, build_motion_source, build_soil
from ..coupling.observer import RunObserver
from ..coupling.run_settings import RunSettings
from ..errors import InputError
from ..loading.loader import ResolvedScene
from ..recording.bag_writer import open_bag
from ..recording.checkpoint import Checkpoint


def needed_controller(resolved: ResolvedScene, resumed: Checkpoint | None = None) -> Controller | None:
    """The scene's controller; None if it names none.

    Raises:
        InputError: the controller is an external node, which needs a mode with nodes.
    """
    controller = build_controller(resolved, resumed)
    if resolved.scene.controller is not None and controller is None:
        raise InputError(
            f"{resolved.path}: controller.law: 'external' is a node of its own, and a direct run has no "
            "nodes; use `subsoil run --mode nodes` or composed, another law, or no controller"
        )
    return controller


def simulate(
    settings: RunSettings,
    *,
    motion_source: MotionSource | None = None,
    soil: Soil | None = None,
    controller: Controller | None = None,
    sink: RecordSink | None = None,
    observer: RunObserver | None = None,
) -> None:
    """Run a scene in this process, from tick 0 or a checkpoint to its last tick.

    Args:
        settings: the bag is closed whatever happens.
        motion_source, soil, controller: replace those of the scene.
        sink: takes the records where there is no bag.
        observer: receives each tick and each check, and may end the run.

    Raises:
        InputError: as open_bag, or the scene needs an external controller.
        InterruptedRunError: the observer ended the run.
        RunError: an engine or the interface account failed. Every finished tick is recorded.
    """
    resolved, resumed = settings.resolved, settings.resumed
    controller = controller or needed_controller(resolved, resumed)
    writer = open_bag(settings.bag, resolved, settings.live_port) if settings.bag is not None else None
    try:
        engines = Engines(
            resolved.scene,
            motion_source or build_motion_source(resolved),
            soil or build_soil(resolved, settings.threads),
            controller,
        )
        checkpoint_writer = None
        if settings.checkpoints is not None and engines.keeps_state:
            checkpoint_writer = settings.checkpoint_writer(*(() if writer is None else (writer.sync,)))
        run_direct(
            settings,
            engines,
            writer or sink,
            observer,
            stop_rule=build_stop_rule(resolved, resumed),
            checkpoint_writer=checkpoint_writer,
        )
    finally:
        if writer is not None:
            writer.close()
