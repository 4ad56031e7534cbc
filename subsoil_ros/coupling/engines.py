"""The engines of a scene: who moves the tools, who answers."""

from typing import Protocol

from ..mbd.engine import MechanismEngine
from ..mbd.path import PathEngine
from ..messages import MechanismState, SoilCloud, SoilState, ToolMotion, ToolWrench
from ..scene.loader import ResolvedScene


class Mover(Protocol):
    """Moves the tools: a mechanism, or prescribed paths."""

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """Motions before tick 0, in scene order."""
        ...

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """Motions at the end of `tick`, the wrenches being held through it."""
        ...


class Mechanism(Mover, Protocol):
    """A mover with a state of its own to record."""

    def state(self, run_id: str, tick: int, end_time_ns: int) -> MechanismState:
        """The state at the end of `tick`."""
        ...


class Soil(Protocol):
    """Answers motions with wrenches."""

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of the initial state; no time advances."""
        ...

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of `tick`, the tools moving to `motions` within it."""
        ...

    def state(self, run_id: str, tick: int, end_time_ns: int) -> SoilState:
        """Monitors at the end of `tick`."""
        ...

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """Particles at the end of `tick`."""
        ...


def build_mechanism(resolved: ResolvedScene) -> Mechanism | None:
    """The scene's mechanism, assembled; None if it names none."""
    if resolved.scene.mechanism is None:
        return None
    return MechanismEngine(resolved.scene, resolved.timing)


def build_paths(resolved: ResolvedScene) -> Mover:
    """The mover of a scene without mechanism."""
    return PathEngine(resolved.scene, resolved.timing)


def build_soil(resolved: ResolvedScene, threads: int) -> Soil | None:
    """The scene's soil; None if it names none. Only the engine that is named is imported."""
    if resolved.scene.soil is None:
        return None
    if resolved.scene.reduced_soil is not None:
        from ..resistance.engine import ResistanceEngine

        return ResistanceEngine(resolved)
    from ..dem.engine import SoilEngine

    return SoilEngine(resolved, threads)
