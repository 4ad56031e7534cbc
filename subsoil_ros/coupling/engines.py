"""The engines of a scene: the motion source, which moves the tools, and the soil."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, cast, runtime_checkable

from ..loading.loader import ResolvedScene
from ..messages import DriverCommand, MechanismState, SoilCloud, SoilState, ToolMotion, ToolWrench
from ..recording.checkpoint import Arrays
from ..scene.scene import Scene
from .external import ExternalMachineEngine, ExternalSoil, ExternalSoilEngine, Machine
from .protocol import MECHANISM, SOIL

if TYPE_CHECKING:
    from .control import Controller

PATHS = "paths"
"""Name of the motion source of a scene whose tools follow paths; another one is named MECHANISM."""


class Resumable(Protocol):
    """An engine whose state can be read between two ticks, and restored, if it keeps one."""

    @property
    def keeps_state(self) -> bool:
        """Whether it does; without, a run has no checkpoints."""
        ...

    def state_arrays(self) -> Arrays:
        """All that later ticks depend on, by name; not copied, so to be used before the next tick."""
        ...

    def restore(self, arrays: Arrays) -> None:
        """Restore such a state, in place of the start, in an engine just built. It may keep the arrays.

        Raises:
            KeyError, ValueError: the state is of another scene.
        """
        ...


class MotionSource(Resumable, Protocol):
    """Moves the tools: a mechanism, or prescribed paths."""

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """Motions before the first tick, in scene order."""
        ...

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """Motions at the end of `tick`, the wrenches being held through it, or, where the scene predicts
        motions, through the tick before, to which they answered."""
        ...


class Mechanism(MotionSource, Protocol):
    """A motion source with a state of its own to record, and perhaps a driver that a controller commands."""

    def initial_state(self, run_id: str, wrenches: tuple[ToolWrench, ...]) -> MechanismState:
        """The state before the first tick, under the soil's first wrenches; the engine does not change."""
        ...

    def state(self, run_id: str, tick: int, end_time_ns: int) -> MechanismState:
        """The state at the end of `tick`."""
        ...

    def command(self, command: DriverCommand) -> None:
        """Apply a controller's command from the start of the next tick on."""
        ...


class Soil(Resumable, Protocol):
    """Computes the wrenches on the tools from their motions."""

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of the initial state; no time advances."""
        ...

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of `tick`, the tools moving to `motions` within it."""
        ...


@runtime_checkable
class ParticleReadings(Protocol):
    """What a soil of particles has beside the methods of every soil."""

    def ends_with(self, tick: int) -> None:
        """Make `tick`, the next one, the last of a run that ends early."""
        ...

    def state(self, run_id: str, tick: int, end_time_ns: int) -> SoilState:
        """Monitors at the end of `tick`."""
        ...

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """Particles at the end of `tick`."""
        ...


def soil_state(soil: Soil, run_id: str, tick: int, end_time_ns: int) -> SoilState:
    """Monitors at the end of `tick`; zeros for a soil that has none."""
    if isinstance(soil, ParticleReadings):
        return soil.state(run_id, tick, end_time_ns)
    return SoilState(run_id, tick, end_time_ns)


def motion_source_part(scene: Scene) -> str:
    """Name of the motion source, as of its part of a checkpoint."""
    return MECHANISM if scene.moved_by_participant else PATHS


@dataclass(frozen=True)
class Engines:
    """The engines of a run in one process, and its controller; None: the scene has none."""

    scene: Scene
    motion_source: MotionSource
    soil: Soil | None = None
    controller: "Controller | None" = None

    @property
    def mechanism(self) -> Mechanism | None:
        """The motion source of a scene with a mechanism."""
        return cast(Mechanism, self.motion_source) if self.scene.mechanism is not None else None

    @property
    def particles(self) -> ParticleReadings | None:
        """The soil, if it has particles."""
        return self.soil if isinstance(self.soil, ParticleReadings) else None

    @property
    def parts(self) -> dict[str, Resumable]:
        """The engines by the names of their parts of a checkpoint."""
        soil: dict[str, Resumable] = {SOIL: self.soil} if self.soil is not None else {}
        return {motion_source_part(self.scene): self.motion_source, **soil}

    @property
    def keeps_state(self) -> bool:
        """Whether all engines can be resumed, so that checkpoints can be written."""
        return all(engine.keeps_state for engine in self.parts.values())


def build_mechanism(resolved: ResolvedScene) -> Mechanism | None:
    """The scene's mechanism, assembled; None if it has none. Only the engine in use is imported."""
    if resolved.scene.mechanism is None:
        return None
    from ..mbd.mechanism_engine import MechanismEngine

    return MechanismEngine(resolved.scene, resolved.timing)


def build_paths(resolved: ResolvedScene) -> MotionSource:
    """The motion source of a scene without mechanism."""
    from ..mbd.tool_paths import PathEngine

    return PathEngine(resolved.scene, resolved.timing)


def build_motion_source(resolved: ResolvedScene, machine: Machine | None = None) -> MotionSource:
    """The scene's mechanism, the external machine, or the paths of its tools.

    Raises:
        InputError: the scene has an external machine, and none is given or it cannot be used.
    """
    if resolved.scene.external_machine:
        return ExternalMachineEngine(resolved, machine)
    return build_mechanism(resolved) or build_paths(resolved)


def build_soil(resolved: ResolvedScene, threads: int, soil: ExternalSoil | None = None) -> Soil | None:
    """The scene's soil, or the external one; None if it has none. Only the model in use is imported.

    Raises:
        InputError: as build_motion_source.
    """
    if resolved.scene.soil is None:
        return None
    if resolved.scene.external_soil:
        return ExternalSoilEngine(resolved, soil)
    if resolved.scene.wedge_soil is not None:
        from ..wedge.wedge_engine import WedgeEngine

        return WedgeEngine(resolved)
    if resolved.scene.terrain_soil is not None:
        from ..terrain.terrain_engine import TerrainEngine

        return TerrainEngine(resolved)
    from ..dem.build import build_engine

    return build_engine(resolved, threads)
