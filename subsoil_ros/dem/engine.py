"""The soil engine: motions of the tools in, wrenches on the tools out."""

from collections.abc import Mapping

import numpy as np

from ..errors import InputError, PhysicsError, SceneError
from ..leaps import entry
from ..limits.stable_steps import DENSE_COORDINATION, SAFETY, step_limits
from ..loading.loader import ResolvedScene
from ..messages import ToolMotion, ToolWrench
from .bed import Bed, finite_rows, refuse_outside
from .cpu_steps import CpuSteps
from .domain import BedOrigin, Domain, Origin
from .kernel_calls import refuse_threads, use_threads
from .model import SoilModel, soil_model
from .particles import Particles
from .periodic import refuse_narrow_period
from .readings import SoilReadings
from .snapshot import below, motion_from
from .state import SoilState
from .step_checks import StepChecks
from .steps import Steps
from .tools.motion import motion_within, refuse_other_kind
from .tools.surface import surfaces
from .window import Window


class SoilEngine(SoilReadings):
    """Discrete elements in a bin, touched by tools. Readings: dem.readings.

    Args:
        bed: particles and their box; dem.build prepares the one that a scene describes.
        threads: the results do not depend on it.
        book: whether every energy sink is booked (slower), as where the scene balances the energy.
        window: of a scene with soil.window, whose field begins with `bed`.

    Raises:
        InputError: too many threads, no soil, or not the device that the scene asks for.
    """

    keeps_state = True

    def __init__(
        self,
        resolved: ResolvedScene,
        bed: Bed,
        threads: int = 1,
        *,
        book: bool = False,
        window: Window | None = None,
    ) -> None:
        refuse_threads(threads)
        self._resolved, self._threads, self.window = resolved, threads, window
        self._may_leap = resolved.scene.may_leap
        self._model = soil_model(resolved, bed, book=book)
        refuse_narrow_period(bed, self._model.soil)
        self._prepared = bed
        particles = self._model.particles(bed.positions_m, bed.radii_m, bed.materials, bed.held)
        self._load(particles, BedOrigin(bed, bed.positions_m))
        if window is not None:
            self._lay_out(window, *window.field.first_window)

    def refuse_step_too_large(self) -> None:
        """Refuse a bed with more contacts than DENSE_COORDINATION that needs a smaller step.

        Raises:
            SceneError: the scene's step is above the limit, and it does not allow that.
        """
        if self.coordination <= DENSE_COORDINATION:
            return
        limit, step_s = step_limits(self._model.soil, self.coordination)[0], self._model.step_s
        if step_s > limit.limit_s and "unstable_time_step" not in self._resolved.scene.allow:
            raise SceneError(
                f"soil.time_step_s: {step_s:.3g} s is above the stable limit {limit.limit_s:.3g} s of "
                f"the prepared bed ({limit.cause}); use at most {SAFETY * limit.limit_s:.2g} s"
            )

    def _load(self, particles: Particles, origin: Origin, rebuild_count: int = 0) -> None:
        """Start from particles that touch nothing yet, in the box of the prepared bed."""
        model, window = self._model, self.window
        domain = Domain(self._prepared, origin.places_m, model.radius_m)
        state = SoilState.of(model, particles, domain, origin)
        state.rebuild_count = rebuild_count
        self._steps = _steps_of(model, state, self._threads)
        ends_m = () if window is None else window.field.ends_m
        self._checks = StepChecks(model, state, self, self._resolved.timing.tick_count - 1, ends_m)
        if window is not None:
            window.enter(state)
        self._rebuild(())

    def _rebuild(self, motions: tuple[ToolMotion, ...]) -> None:
        if self.window is None:
            self._steps.rebuild(motions)
            return
        host = self._steps.to_host()
        host.rebuild(motions)
        self.window.give_histories(self._model, host.state)
        self._steps.from_host()

    def _lay_out(self, window: Window, rear: int, front: int) -> None:
        """Start with strips rear <= m < front of a field."""
        laid = window.lay_out(rear, front)
        particles = self._model.particles(
            laid.position_m, laid.radius_m, laid.material, window.held(laid), laid.identity
        )
        self._load(particles, window.field, self._state.rebuild_count)

    def place(
        self,
        position_m: np.ndarray,
        velocity_m_per_s: np.ndarray | None = None,
        angular_velocity_rad_per_s: np.ndarray | None = None,
        radii_m: np.ndarray | None = None,
    ) -> None:
        """Put these particles into the bin instead of the prepared bed: (n, 3) arrays, world axes.

        radii_m (n,) is for soils with sizes. Layers go by depth. Call it before `start`, which then must not
        remove any particle.

        Raises:
            InputError: no particle, one outside the bin, or rows that are missing or not finite.
        """
        if self.window is not None:
            raise InputError("place: a field is laid out from its block; leave soil.window out")
        position, state = np.array(position_m, dtype=np.float64).reshape(-1, 3), self._state
        refuse_outside(self.bed, state.domain.planes, position)
        particles = self._model.particles(position, radii_m, None)
        for name, given in (("velocity", velocity_m_per_s), ("angular_velocity", angular_velocity_rad_per_s)):
            if given is not None:
                rows = finite_rows(name, given, len(position))
                getattr(particles, name)[:] = rows
        self._load(particles, BedOrigin(self.bed, position), state.rebuild_count)

    def damp(self, kept: float) -> None:
        """Global damping: every linear and angular velocity times `kept`. For the preparation of beds."""
        self._steps.damp(kept)

    def resize(self, scale: float | np.ndarray) -> None:
        """Scale an endless bed by `scale`, or (3,) along x, y and z, about the origin. Particles and the ends
        of their contacts' springs move with it. For the preparation and testing of beds, in steps that are
        small against a skin."""
        host = self._steps.to_host()
        host.stretch(scale)
        if host is not self._steps:
            self._steps.from_host()

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of the initial state. Particles that the tools overlap are removed; no time advances.

        A particle is removed if its centre is inside a tool or so near that the contact would press. In a
        field, soil is laid out about the tools.

        Raises:
            InputError: the tools overlap all particles, or begin beyond the field.
        """
        use_threads(self._threads)
        window = self.window
        if window is not None:
            strips = window.strips_about(self._model, surfaces(self._resolved, self.bed, motions))
            if strips is not None:
                self._lay_out(window, *strips)
        model, state = self._model, self._state
        tools = surfaces(self._resolved, self.bed, motions)
        p = self._steps.particles()
        clearance_m, kept = model.clearance_m(p), np.ones(p.count, np.bool_)
        for surface in tools:
            kept[surface.overlapped(p, clearance_m)] = False
        if not kept.any():
            raise InputError("tools: they overlap every particle of the bed; check their scale and position")
        state.tools = tools
        p.reorder(np.flatnonzero(kept))
        state.forget_contacts(model)
        if window is not None:
            window.with_history = 0
        self._steps.from_host()
        self._rebuild(motions)
        for tool in tools:
            tool.begin_tick()
        self._steps.first_forces(motions)
        if state.monitor is not None and state.monitor.balances:
            state.monitor.begin(self.energy())
        return self._wrenches()

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of `tick`, the tools moving from where they stand to `motions`.

        Raises:
            ProtocolError: a planar tool was given a spatial motion, or the reverse.
            PhysicsError: a state that is not a number, a tool sunk too deep into a particle, a bound of
                soil.monitors passed, or a tool back where a window took the soil away.
        """
        use_threads(self._threads)
        tools, timing = self._state.tools, self._resolved.timing
        duration_s, steps = timing.communication_step_s, timing.soil_steps
        for tool, end in zip(tools, motions, strict=True):
            refuse_other_kind(f"tick {tick}", tool.last, end, duration_s)
        if self.window is not None:
            self._follow(self.window, tick, motions)
        starts = self._starts(f"tick {tick}", motions)
        for tool in tools:
            tool.begin_tick()
        way = [
            tuple(motion_within(a, b, duration_s, s / steps) for a, b in zip(starts, motions, strict=True))
            for s in range(1, steps + 1)
        ]
        self._steps.advance(tick, way, self._checks)
        return self._wrenches()

    def _starts(self, where: str, motions: tuple[ToolMotion, ...]) -> tuple[ToolMotion, ...]:
        """Where the tools are at the start of a tick; those that leap enter the soil there."""
        tools = self._state.tools
        if self._may_leap:
            interval_s = self._resolved.timing.communication_step_s
            entries = [
                entry(tool.last, motion, interval_s)
                if self._resolved.scene.tools[tool.name].may_leap
                else None
                for tool, motion in zip(tools, motions, strict=True)
            ]
            if any(entries):
                self._enter(where, entries)
        return tuple(tool.last for tool in tools)

    def _enter(self, where: str, entries: list[ToolMotion | None]) -> None:
        """Put the tools that have an entry there, and remove the particles that they then overlap.

        Forces change only on particles that touched these tools or a particle removed; for half a step these
        lack the forces of other tools.

        Raises:
            PhysicsError: the tools overlap all particles.
        """
        model, host = self._model, self._steps.to_host()
        before = self.energy().total_joule if model.booked else 0.0
        state = host.state
        p, pairs = state.particles, state.pairs
        clearance_m, kept, changed = (
            model.clearance_m(p),
            np.ones(p.count, np.bool_),
            np.zeros(p.count, np.bool_),
        )
        for tool, start in zip(state.tools, entries, strict=True):
            if start is not None:
                changed[tool.near.particle] = True
                tool.enter(start)
                kept[tool.overlapped(p, clearance_m)] = False
        if not kept.any():
            raise PhysicsError(f"{where}: after a leap the tools overlap every particle; look at their poses")
        first, second = np.repeat(np.arange(p.count), np.diff(pairs.row_start)), pairs.neighbour
        changed[second[~kept[first]]] = True
        changed[first[~kept[second]]] = True
        identities = p.identity[changed]
        came_from = np.flatnonzero(kept)
        p.reorder(came_from)
        host.rebuild(tuple(tool.last for tool in state.tools), came_from)
        host.forces_on(np.isin(p.identity, identities))
        self._steps.from_host()
        state.leaps += len(entries) - entries.count(None)
        state.removed += int((~kept).sum())
        if model.booked:
            state.carried_joule += self.energy().total_joule - before

    def _follow(self, window: Window, tick: int, motions: tuple[ToolMotion, ...]) -> None:
        """Move the window to where it covers the way of the tools through the tick."""
        strips = window.strips_ahead(self._model, self._state, self._checks.where(tick, 1), motions)
        if strips is not None:
            self.shift(*strips)

    def shift(self, rear: int, front: int) -> None:
        """Move the window of a field to strips rear <= m < front, none of them behind those there are."""
        assert self.window is not None
        before = self.energy().total_joule if self._model.booked else 0.0
        self.window.shift(self._model, self._steps.to_host(), rear, front)
        self._steps.from_host()
        if self._model.booked:
            self._state.carried_joule += self.energy().total_joule - before

    def ends_with(self, tick: int) -> None:
        """Let the run end early with `tick`, which is advanced next: the soil is checked at its end."""
        self._checks.last_tick = tick

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Arrays, by name, that later ticks depend on, and from which their results count; not copied.

        Engines on all devices can go on from them.
        """
        state = self.whole_state()
        arrays = state.arrays() | {"bed": state.origin.digest()}
        if self.window is not None:
            arrays |= self.window.arrays()
        if self._comes_and_goes:
            arrays["carried_joule"] = np.array(state.carried_joule)
        if self._may_leap:
            arrays["leaps"] = np.array((state.leaps, state.removed))
        return arrays

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Continue from arrays of `state_arrays`, most of which are not copied; replaces `start`.

        Raises:
            KeyError, ValueError: the arrays are not of this scene and bed.
        """
        state = self._state
        if not np.array_equal(arrays["bed"], state.origin.digest()):
            raise ValueError("the bed prepared here is not the one that the state began with")
        if self.window is not None:
            self.window.restore(arrays)
            self.window.enter(state)
        if self._comes_and_goes:
            state.carried_joule = float(arrays["carried_joule"])
        if self._may_leap:
            state.leaps, state.removed = arrays["leaps"].tolist()
        lasts = {name: below(f"tool.{name}", arrays)["last"] for name in self._resolved.scene.tools}
        motions = tuple(motion_from(name, last) for name, last in lasts.items())
        state.tools = surfaces(self._resolved, self.bed, motions)
        state.restore(self._model, arrays)
        self._steps.from_host()

    def close(self) -> None:
        """End the other processes of the steps, if there are any; nothing may be called after it."""
        if (close := getattr(self._steps, "close", None)) is not None:
            close()

    def _wrenches(self) -> tuple[ToolWrench, ...]:
        return tuple(tool.wrench() for tool in self._state.tools)


def _steps_of(model: SoilModel, state: SoilState, threads: int) -> Steps:
    """Steps in the engine and on the device that the scene names."""
    if model.soil.engine == "lammps":
        from .lammps.lammps_steps import LammpsSteps

        return LammpsSteps(model, state, threads)
    if model.soil.device == "cpu":
        return CpuSteps(model, state, threads)
    from .gpu.gpu_steps import GpuSteps

    return GpuSteps(model, state, threads)
