"""A window of soil that moves with the tools through a field (scene.window).

At the beginning of a tick, the positions of the tools then and at its end determine which strips exist
(dem.beds.field). Strips ahead are laid out as they settled, with the histories of their contacts; soil
behind the window is removed. The outermost layer at an open end is held: ahead where it was laid out, behind
where it came to lie. Soil that is no longer at an end is freed. At both ends of the field walls replace the
held layer.

No record grows with the distance travelled: the identity of a particle gives the place where it was laid out.
"""

import dataclasses
import logging
from collections.abc import Mapping

import numpy as np

from ..errors import InputError, PhysicsError
from ..loading.loader import ResolvedScene
from ..messages import SoilCloud, ToolMotion, ToolWrench
from .bed import Bed
from .beds.field import Field, Strips, kept_block
from .blocks import history_places
from .engine import SoilEngine
from .monitors import Domain
from .snapshot import bed_digest
from .state import Particles
from .tools.surface import ToolSurface, surfaces
from .walls import near_walls, wall_planes

_logger = logging.getLogger(__name__)


class FieldEngine(SoilEngine):
    """SoilEngine of a scene with soil.window; it always starts from the bed at the beginning of the field."""

    def __init__(
        self, resolved: ResolvedScene, threads: int = 1, *, book: bool = False, bed: Bed | None = None
    ) -> None:
        soil = resolved.scene.particle_soil
        assert soil is not None
        self._field = Field(kept_block(resolved, SoilEngine, threads), soil)
        rear, front = self._field.first_window
        self._first_box = self._field.box(rear, front)
        self._rear, self._front, self._first = rear, front, rear  # strips, and that of the start
        self._warned = False
        self._with_history = self._field.first_identity(front)
        """Particles before this identity have the histories of their contacts."""
        super().__init__(resolved, threads, book=book, bed=self._field.bed(rear, front))
        self._lay_out(rear, front)
        self._refuse_step_too_large()

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """See SoilEngine; soil is laid out about the tools.

        Raises:
            InputError: the tools begin beyond the field.
        """
        span = self._span_m(surfaces(self._resolved, self.bed, motions))
        if span is not None:
            end = self._field.count * self._field.strip_m
            if span[0] >= end:
                raise InputError(
                    f"tools: begin at x = {span[0]:.4g} m, beyond the field, which ends at {end:.4g} m; make "
                    "soil.bin.length_m larger, or let them begin before"
                )
            self._lay_out(*self._field.strips_about(*span))
        return super().start(motions)

    def _prepare_tick(self, tick: int, motions: tuple[ToolMotion, ...]) -> None:
        """Move the window to where it covers the way of the tools through the tick."""
        span = self._span_m(self._tools, motions)
        if span is not None:
            rear, front = self._field.strips_about(*span)
            rear, front = max(rear, self._rear), max(front, self._front)
            self._refuse_return(tick, span[0])
            if (rear, front) != (self._rear, self._front):
                self._shift(rear, front)

    def _remedy_of_overlap(self, tool: ToolSurface) -> str:
        """See SoilEngine; at an end of the field soil is caught between the tool and the wall."""
        low, high = tool.span_m(self._soil.bin.depth_m)
        for end in (0.0, self._field.count * self._field.strip_m):
            if low - 2.0 * self._radius < end < high + 2.0 * self._radius:
                return (
                    f"it presses soil against the wall at the end of the field, x = {end:.4g} m: make "
                    "soil.bin.length_m larger, or let the run end before"
                )
        return super()._remedy_of_overlap(tool)

    def place(self, *_: object, **__: object) -> None:
        """Raise InputError: the particles of a field follow from its block."""
        raise InputError("place: a field is laid out from its block; leave soil.window out")

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """See SoilReadings; with identities."""
        identities = np.sort(self._particles.identity).astype(np.uint32)
        return dataclasses.replace(super().cloud(tick, end_time_ns), identities=identities)

    def state_arrays(self) -> dict[str, np.ndarray]:
        """See SoilEngine."""
        return super().state_arrays() | {
            "window": np.array((self._rear, self._front, self._first)),
            "carried_joule": np.array(self._carried_joule),
        }

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """See SoilEngine."""
        self._rear, self._front, self._first = arrays["window"].tolist()
        self._put_walls()
        self._count_particles()
        super().restore(arrays)
        self._carried_joule = float(arrays["carried_joule"])
        self._with_history = self._field.first_identity(self._front)

    def _bed_digest(self) -> np.ndarray:
        return bed_digest(self._first_box, np.concatenate([part.ravel() for part in self._field.arrays]))

    def _domain_about(self, position: np.ndarray) -> Domain:
        return Domain(self._planes, self._first_box, self._field.arrays[0], self._radius)

    def _laid_out_m(self, identity: np.ndarray) -> np.ndarray:
        return self._field.laid_out_m(identity)

    def _near_walls(self, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Particles near walls, and these walls; without held particles, which stand where the walls do."""
        particle, wall = near_walls(self._particles.position, self._planes, reach)
        free = ~self._particles.held[particle]
        return particle[free], wall[free]

    def _forget_contacts(self) -> None:
        super()._forget_contacts()
        self._with_history = 0

    def _rebuild(self, motions: tuple[ToolMotion, ...], came_from: np.ndarray | None = None) -> None:
        super()._rebuild(motions, came_from)
        end = self._field.first_identity(self._front)
        if self._with_history == end:
            return
        p, pairs = self._particles, self._pairs
        first = np.repeat(p.identity, np.diff(pairs.row_start))
        second = p.identity[pairs.neighbour]
        new = np.flatnonzero(np.maximum(first, second) >= self._with_history)
        places = history_places(new, len(self._parity))
        pairs.history[places] = self._field.histories(first[new], second[new])
        self._with_history = end

    def _span_m(
        self, tools: tuple[ToolSurface, ...], motions: tuple[ToolMotion, ...] = ()
    ) -> tuple[float, float] | None:
        """Lowest and highest x [m] of the tools where they are and, if given, at `motions`, below
        z = soil.bin.depth_m; None if all are above."""
        depth = self._soil.bin.depth_m
        spans = [tool.span_m(depth) for tool in tools]
        spans += [tool.span_m(depth, motion) for tool, motion in zip(tools, motions, strict=False)]
        low = min((span[0] for span in spans), default=np.inf)
        high = max((span[1] for span in spans), default=-np.inf)
        return (low, high) if low <= high else None

    def _refuse_return(self, tick: int, low_m: float) -> None:
        end = self._rear * self._field.strip_m + self._field.layer_m + 2.0 * self._radius
        if self._rear > 0 and low_m < end:
            raise PhysicsError(
                f"{self._where(tick, 1)}: a tool is back at x = {low_m:.4g} m, where the soil behind it was "
                f"taken away; allowed is x > {end:.4g} m: make soil.window.behind_m larger, or leave "
                "soil.window out"
            )

    def _lay_out(self, rear: int, front: int) -> None:
        """Start with strips rear <= m < front."""
        self._rear, self._front, self._first = rear, front, rear
        self._put_walls()
        laid = self._field.strips(rear, front)
        held = self._field.held(laid.identity, laid.position_m[:, 0], rear, front)
        self._load(laid.position_m, laid.radius_m, laid.material, held, laid.identity)
        self._count_particles()

    def _put_walls(self) -> None:
        box = self._field.box(self._rear, self._front)
        self.bed = dataclasses.replace(self.bed, lower_m=box.lower_m, upper_m=box.upper_m)
        self._planes = wall_planes(box.lower_m, box.upper_m, box.sides)
        belongs = self._planes.copy()
        if self._rear > 0:
            belongs[0, 3] = np.inf  # what was thrown behind the window leaves with its next shift
        self._domain.move_to(belongs)

    def _count_particles(self) -> None:
        if self._monitor is not None:
            first, last = map(self._field.first_identity, (self._first, self._front))
            self._monitor.count = last - first

    def _shift(self, rear: int, front: int) -> None:
        """Move the window to strips rear <= m < front. Forces change on particles laid out or freed only."""
        books = self._features.book.ndim == 2
        before = self.energy().total_joule if books else 0.0
        p, field = self._particles, self._field
        stay = np.flatnonzero(p.position[:, 0] >= rear * field.strip_m)
        self._warn_of_motion_ahead(p)
        new = self._at_rest(field.strips(max(self._front, rear), front))
        came_from = np.concatenate((stay, p.count + np.arange(new.count)))
        held_before = p.identity[p.held]
        pairs = self._pairs
        none = np.full(new.count, pairs.row_start[-1])
        pairs.row_start = np.concatenate((pairs.row_start, none))
        self._moving = p = p.joined(new)
        p.reorder(came_from)
        self._rear, self._front = rear, front
        p.held = field.held(p.identity, p.position[:, 0], rear, front)
        p.velocity[p.held] = 0.0
        p.spin[p.held] = 0.0
        self._put_walls()
        self._count_particles()
        known = self._with_history
        self._rebuild(tuple(tool.last for tool in self._tools), came_from)
        p = self._particles
        freed = ~p.held & np.isin(p.identity, held_before)
        self._give_forces(freed | (p.identity >= known))
        if books:
            self._carried_joule += self.energy().total_joule - before

    def _warn_of_motion_ahead(self, p: Particles) -> None:
        """Warn if soil that the tools move comes near the layer that is held ahead.

        A particle counts as moved if it is more than a radius from where it was laid out, as in the
        disturbance, and as near within a diameter of the layer: contact forces reach less far.
        """
        if self._front == self._field.count or self._warned:
            return
        end = self._front * self._field.strip_m - self._field.layer_m - 2.0 * self._radius
        near = np.flatnonzero(~p.held & (p.position[:, 0] > end))
        way = p.position[near] - self._field.laid_out_m(p.identity[near])
        if (np.abs(way[:, [0, 2]]).max(initial=0.0)) > self._smallest:
            self._warned = True
            _logger.warning(
                "warning: soil moves at the front of the window, where it is held at x = %.3f m, and the "
                "draft may rise by that; make soil.window.ahead_m longer",
                end,
            )

    def _at_rest(self, laid: Strips) -> Particles:
        held = np.ones(len(laid.identity), np.bool_)
        found = Particles.at_rest(laid.position_m, laid.identity, self._kind, held)
        if self._particles.unequal:
            found.make_unequal(laid.radius_m, laid.material, self._density)
        return found

    def _give_forces(self, fresh: np.ndarray) -> None:
        """Compute the forces on the particles of `fresh` (n,) bool in their present state; all other forces,
        and all springs, keep their values."""
        p = self._particles
        changed = [self._pairs.history, self._walls.history, self._pair_book, self._wall_book]
        if self._bonds is not None:
            changed += [self._bonds.state, self._bonds.book]
        kept = [(array, array.copy()) for array in changed]
        force, torque = p.force.copy(), p.torque.copy()
        p.force[:] = 0.0
        p.force[:, 2] = -self._masses()[0] * self._gravity
        p.torque[:] = 0.0
        self._bind(step=0.0).drift_and_contacts(0, True)
        self._calls = None
        p.force[~fresh], p.torque[~fresh] = force[~fresh], torque[~fresh]
        for array, before in kept:
            array[:] = before
