"""External machines and soils: their public interface, and the engines that check them."""

import math
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, RunError
from ..loading.loader import ResolvedScene
from ..messages import FacetGroupForce, SpatialMotion, ToolMotion, ToolWrench
from ..recording.checkpoint import Arrays
from ..rotations import rotation_between
from ..scene.tools import Tool

Answer = TypeVar("Answer", ToolMotion, ToolWrench)

START_TOLERANCE = 1e-6
"""Largest distance [m] and turn [rad] of a tool from the start pose of its scene: more than the rounding of a
pose typed with seven digits, and a thousandth of the smallest particle radius in use."""

ASIDE_M = 1e-3
"""Largest distance of a planar tool from its plane [m], which nothing would use: other simulators hold a
plane by soft constraints, which give by micrometres."""

PAGE = "docs/own_machine.md"

_ANGLES = "subsoil.angles_rad"
"""Name, among the arrays of a machine's state, of the angles of its tools at the last tick."""


class Machine(Protocol):
    """An external machine: moves the tools of a scene with `path.external: true`.

    It may have three more members. `state_arrays()` returns all that later ticks depend on as arrays by name,
    and `restore(arrays)` restores such a state: without them `record.checkpoint_s` must be 0, and no run can
    be resumed. `effective_mass_kg`, a mapping by tool, is the mass that an impact at the tool's edge
    accelerates: without it `check` gives no bound on the communication step.
    """

    def initial_motions(self) -> Sequence[ToolMotion]:
        """Motions before tick 0, in scene order, at the start poses of the scene."""
        ...

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> Sequence[ToolMotion]:
        """Motions at the end of `tick`, the wrenches being held through it.

        A wrench acts at its tool's origin, whose position the motion gives; components in world axes.
        """
        ...


class ExternalSoil(Protocol):
    """An external soil: computes the forces on the tools of a scene with `soil.model: external`.

    It may have `state_arrays` and `restore`, as a Machine.
    """

    def start(self, motions: tuple[ToolMotion, ...]) -> Sequence[ToolWrench]:
        """Wrenches before tick 0, in scene order; no time advances."""
        ...

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> Sequence[ToolWrench]:
        """Wrenches of `tick`, the tools moving to `motions` within it.

        `work_joule` is the work of these forces on the tool in the tick: the interface account compares it
        with that of the wrench which the machine held.
        """
        ...


class _ExternalParticipant:
    """Calls the methods of another program's object, and checks the results."""

    def __init__(
        self, resolved: ResolvedScene, word: str, participant: object, methods: tuple[str, ...]
    ) -> None:
        if participant is None:
            raise _missing(resolved, word)
        self._word, self._participant = word, participant
        self._tools: dict[str, Tool] = resolved.scene.tools
        missing = [name for name in methods if not callable(getattr(participant, name, None))]
        if missing:
            raise InputError(
                f"{word}: {type(participant).__name__} has no method {', '.join(missing)}; it must have "
                f"{', '.join(methods)} ({PAGE})"
            )
        self.keeps_state = all(
            callable(getattr(participant, name, None)) for name in ("state_arrays", "restore")
        )
        if not self.keeps_state and resolved.scene.checkpoint_s > 0.0:
            raise InputError(
                f"{word}: {type(participant).__name__} has no state_arrays and restore, which checkpoints "
                "need; add both, or set record.checkpoint_s: 0"
            )

    def state_arrays(self) -> Arrays:
        """All that later ticks depend on; empty for an object that keeps no state."""
        return dict(self._call("state_arrays", RunError)) if self.keeps_state else {}

    def restore(self, arrays: Arrays) -> None:
        """Restore a state that `state_arrays` returned.

        Raises:
            InputError: the object cannot restore states, or raises an error for this one.
        """
        if not self.keeps_state:
            raise InputError(
                f"{self._word}: {type(self._participant).__name__} has no state_arrays and restore, so its "
                "run cannot be resumed; run the scene from the start"
            )
        self._call("restore", InputError, arrays)

    def _call(self, name: str, kind: type[InputError] | type[RunError], *arguments: object) -> Any:
        """Result of a method. Raises `kind`, with the place in the code, if the method raises any error."""
        method: Callable[..., Any] = getattr(self._participant, name)
        try:
            return method(*arguments)
        except (Exception, SystemExit) as error:  # of another program: any error ends the run
            last = traceback.extract_tb(error.__traceback__)[-1]
            text = " ".join(str(error).split())
            raise kind(
                f"{self._at(name, arguments)} raised {type(error).__name__}: {text} "
                f"({last.filename}, line {last.lineno})"
            ) from error

    def _at(self, name: str, arguments: tuple[object, ...] = ()) -> str:
        tick = f" of tick {arguments[0]}" if name == "advance" else ""
        return f"{self._word}: {name}{tick}"

    def _answers(
        self,
        name: str,
        kind: type[InputError] | type[RunError],
        answer: Callable[[Tool], type[Answer]],
        *arguments: object,
    ) -> tuple[Answer, ...]:
        """Records that a method returns: one a tool, of the right kind, finite. Raises `kind` if not."""
        given, place = self._call(name, kind, *arguments), self._at(name, arguments)
        if not isinstance(given, Sequence) or len(given) != len(self._tools):
            found = f"{len(given)} records" if isinstance(given, Sequence) else f"a {type(given).__name__}"
            raise kind(f"{place} gave {found}; it must give one for each tool: {', '.join(self._tools)}")
        for record, (tool, model) in zip(given, self._tools.items(), strict=True):
            needed = answer(model)
            if type(record) is not needed:
                raise kind(
                    f"{place} gave a {type(record).__name__} for tool '{tool}'; give a {needed.__name__}"
                )
            if record.tool != tool:
                raise kind(f"{place} gave tool '{record.tool}' where '{tool}' is due, in scene order")
            wrong = next(_not_finite(record), None)
            if wrong is not None:
                raise kind(f"{place} gave {wrong} for tool '{tool}'; numbers must be finite")
            unused = _not_used(record, model)
            if unused:
                raise kind(f"{place} gave {unused} for tool '{tool}'")
        return tuple(given)


class ExternalMachineEngine(_ExternalParticipant):
    """The motion source of a scene whose machine is another program.

    Raises:
        InputError: the object lacks a method, or keeps no state although the scene has checkpoints.
    """

    def __init__(self, resolved: ResolvedScene, machine: Machine | None) -> None:
        super().__init__(resolved, "machine", machine, ("initial_motions", "advance"))
        self._angles_rad: list[float] = []  # of the last motions, in scene order; empty before the first

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """Motions before tick 0.

        Raises:
            InputError: they are not one of each tool, or not at the start poses of the scene.
        """
        motions = self._answers("initial_motions", InputError, _motion_kind)
        for motion, (name, tool) in zip(motions, self._tools.items(), strict=True):
            assert tool.path is not None
            start = tool.path.start_m(tool.lateral_m)
            off = math.dist(motion.position_m, start)
            turn = math.hypot(*rotation_between(motion.quaternion, tool.path.start_quaternion))
            if max(off, turn) > START_TOLERANCE:
                raise InputError(
                    f"machine: initial_motions puts tool '{name}' {off:.3g} m and {turn:.3g} rad from its "
                    f"start in the scene, {start} m; allowed are {START_TOLERANCE:g} of both: change "
                    f"tools.{name}, or where the machine begins"
                )
        if not self._angles_rad:
            self._angles_rad = [motion.angle_rad for motion in motions]
        return motions

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """Motions at the end of `tick`.

        Raises:
            RunError: the machine raised an error, or gave anything else.
        """
        return self._unwrapped(self._answers("advance", RunError, _motion_kind, tick, wrenches))

    def state_arrays(self) -> dict[str, NDArray[Any]]:
        """The machine's state, with the angles of the last motions."""
        arrays = super().state_arrays()
        return {**arrays, _ANGLES: np.array(self._angles_rad)} if self.keeps_state else dict(arrays)

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore a state that `state_arrays` returned."""
        own = {name: array for name, array in arrays.items() if name != _ANGLES}
        super().restore(own)
        self._angles_rad = arrays[_ANGLES].tolist() if _ANGLES in arrays else []

    def _unwrapped(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolMotion, ...]:
        """Motions with each planar angle on the turn that is nearest to the last one: a machine may give it
        between -pi and pi."""
        before = self._angles_rad or [motion.angle_rad for motion in motions]
        found = tuple(
            motion
            if isinstance(motion, SpatialMotion)
            else replace(motion, angle_rad=last + math.remainder(motion.angle_rad - last, math.tau))
            if abs(motion.angle_rad - last) > math.pi
            else motion
            for motion, last in zip(motions, before, strict=True)
        )
        self._angles_rad = [motion.angle_rad for motion in found]
        return found


class ExternalSoilEngine(_ExternalParticipant):
    """The soil of a scene whose soil is another program. Raises InputError as ExternalMachineEngine."""

    def __init__(self, resolved: ResolvedScene, soil: ExternalSoil | None) -> None:
        super().__init__(resolved, "soil", soil, ("start", "advance"))

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches before tick 0. Raises InputError unless they are one of each tool."""
        return self._answers("start", InputError, _wrench_kind, motions)

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of `tick`. Raises RunError if the soil raised an error, or gave anything else."""
        return self._answers("advance", RunError, _wrench_kind, tick, motions)


def refuse_unlike(
    resolved: ResolvedScene, machine: Machine | None, soil: ExternalSoil | None, *, alone: bool = True
) -> None:
    """Check that the machine or soil given is one that the scene has as external.

    alone: no other program joins the run, so every external participant must be given.

    Raises:
        InputError: a participant is missing, or is given to a scene that has its own.
    """
    scene = resolved.scene
    for word, external, given in (
        ("machine", scene.external_machine, machine),
        ("soil", scene.external_soil, soil),
    ):
        if alone and external and given is None:
            raise _missing(resolved, word)
        if given is not None and not external:
            raise InputError(
                f"{word}: given, but {resolved.path} has its own; write {_KEYS[word]} in it ({PAGE})"
            )


_KEYS = {"machine": "tools.*.path.external: true", "soil": "soil.model: external"}


def _missing(resolved: ResolvedScene, word: str) -> InputError:
    return InputError(
        f"{resolved.path}: {_KEYS[word]}: the {word} comes from outside; give run(scene, {word}=...) in "
        f"Python, or run the scene with --mode nodes and join it by serve(scene, {word}=...) ({PAGE})"
    )


def effective_masses_kg(resolved: ResolvedScene, machine: Machine | None) -> Mapping[str, float] | None:
    """The effective mass [kg] of each tool, as the machine gives it; None if it has no such member.

    Raises:
        InputError: not one positive number for each tool.
    """
    given = getattr(machine, "effective_mass_kg", None)
    if given is None:
        return None
    tools = resolved.scene.tools
    if (
        not isinstance(given, Mapping)
        or set(given) != set(tools)
        or not all(isinstance(mass, float | int) and 0.0 < mass < math.inf for mass in given.values())
    ):
        raise InputError(
            f"machine: effective_mass_kg is {given!r}; it must be one positive number [kg] for each tool: "
            f"{', '.join(tools)}"
        )
    return {name: float(given[name]) for name in tools}


def _motion_kind(tool: Tool) -> type[ToolMotion]:
    return SpatialMotion if tool.is_spatial else ToolMotion


def _wrench_kind(tool: Tool) -> type[ToolWrench]:
    return ToolWrench


def _not_used(record: ToolMotion | ToolWrench, tool: Tool) -> str:
    """What of a record nothing would use, in words; empty if all is used."""
    if isinstance(record, ToolWrench):
        unknown = [group.group for group in record.groups if group.group not in tool.groups]
        return f"groups {unknown}; its groups are {list(tool.groups)}" if unknown else ""
    if not isinstance(record, SpatialMotion) and abs(record.y_m - tool.lateral_m) > ASIDE_M:
        return (
            f"y_m {record.y_m:g}, but it moves in the plane y = {tool.lateral_m:g} m (its lateral_m); "
            "give the tool path.turn and a SpatialMotion for a motion in space"
        )
    return ""


def _not_finite(record: ToolMotion | ToolWrench | FacetGroupForce) -> Iterator[str]:
    """Yield, in words, each field of a record that must be a finite number and is not."""
    for item in fields(record):
        value = getattr(record, item.name)
        if item.name == "groups":
            for group in value:
                yield from _not_finite(group) if isinstance(group, FacetGroupForce) else (f"{group!r}",)
        elif item.name == "angle_rad" and isinstance(record, SpatialMotion):
            continue
        elif item.name not in ("tool", "group") and not (
            isinstance(value, float | int) and math.isfinite(value)
        ):
            yield f"{item.name} {value!r}"
