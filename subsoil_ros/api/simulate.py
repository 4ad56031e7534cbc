"""The one wiring of engines, controller, bag and loop for a run without ROS."""

from collections.abc import Callable
from pathlib import Path

from ..analysis.known_mean import build_stop_rule
from ..coupling.checkpoints import CheckpointWriter
from ..coupling.control import Controller, build_controller
from ..coupling.direct import RecordSink, run_direct
from ..coupling.engines import MotionSource, Soil, build_motion_source, build_soil
from ..coupling.stopping import OnCheck
from ..errors import InputError
from ..loading.loader import ResolvedScene
from ..recording.bag_writer import open_bag
from ..recording.checkpoint import Checkpoint
from .opened_run import OpenedRun

OnTick = Callable[[int], None]


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
    resolved: ResolvedScene,
    bag: Path | None = None,
    *,
    run_id: str = "run",
    threads: int = 1,
    on_tick: OnTick = lambda tick: None,
    stop_signal: Callable[[], int] = lambda: 0,
    checkpoints: Path | None = None,
    resumed: Checkpoint | None = None,
    live_port: int = 0,
    motion_source: MotionSource | None = None,
    soil: Soil | None = None,
    sink: RecordSink | None = None,
    controller: Controller | None = None,
    on_check: OnCheck = lambda result: None,
) -> None:
    """Run a scene in this process, from tick 0 or a checkpoint to its last tick.

    Args:
        bag: folder of the bag, which must not exist; it is closed whatever happens. None: no bag.
        threads: of the soil engine; the results do not depend on it.
        on_tick: called with each tick that is done.
        stop_signal: called before each tick; if it returns the number of a signal, the run ends there.
        checkpoints: folder of the checkpoints; None: none are written.
        resumed: the checkpoint to resume from.
        live_port: port of the live view of the bag while it is written; 0: none.
        motion_source, soil, controller: replace those of the scene.
        sink: takes the records where there is no bag.
        on_check: called with the current mean of stop_when, at each check and at the end.

    Raises:
        InputError: as open_bag, or the scene needs an external controller.
        InterruptedRunError: stop_signal ended the run.
        RunError: an engine or the interface account failed. Every finished tick is recorded.
    """
    controller = controller or needed_controller(resolved, resumed)
    writer = open_bag(bag, resolved, live_port) if bag is not None else None
    try:
        motion_source = motion_source or build_motion_source(resolved)
        soil = soil or build_soil(resolved, threads)
        checkpoint_writer = None
        keeps = all(getattr(engine, "keeps_state", True) for engine in (motion_source, soil))
        if checkpoints is not None and keeps:
            sync = (writer.sync,) if writer is not None else ()
            checkpoint_writer = CheckpointWriter(checkpoints, resolved, run_id, *sync)
        run_direct(
            resolved,
            run_id,
            motion_source,
            soil,
            writer or sink,
            on_tick,
            stop_signal,
            checkpoint_writer,
            resumed,
            controller,
            build_stop_rule(resolved, resumed),
            on_check,
        )
    finally:
        if writer is not None:
            writer.close()


def simulate_opened(
    opened: OpenedRun,
    threads: int,
    on_tick: OnTick,
    stop_signal: Callable[[], int],
    live_port: int = 0,
    on_check: OnCheck = lambda result: None,
) -> None:
    """Run an opened run into its folder, as `simulate`."""
    simulate(
        opened.resolved,
        opened.bag if opened.resolved.scene.record.bag else None,
        run_id=opened.run_id,
        threads=threads,
        on_tick=on_tick,
        stop_signal=stop_signal,
        checkpoints=opened.checkpoints,
        resumed=opened.resumed,
        live_port=live_port,
        motion_source=opened.motion_source,
        soil=opened.soil,
        on_check=on_check,
    )
