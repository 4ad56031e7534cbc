"""A window of soil that moves with the tools through a field (scene.window).

At the beginning of a tick, the positions of the tools then and at its end determine which strips exist
(dem.field). Strips ahead are laid out as they settled, with the histories of their contacts; soil
behind the window is removed. The outermost layer at an open end is held: ahead where it was laid out, behind
where it came to lie. Soil that is no longer at an end is freed. At both ends of the field walls replace the
held layer.

No record grows with the distance travelled: the identity of a particle gives the place where it was laid out.
"""

import logging
from collections.abc import Mapping

import numpy as np

from ..errors import InputError, PhysicsError
from ..messages import ToolMotion
from .blocks import history_places
from .cpu_steps import CpuSteps
from .field import Field, Strips
from .model import SoilModel
from .particles import Particles
from .state import SoilState
from .tools.surface import ToolSurface

_logger = logging.getLogger(__name__)


class Window:
    """The strips rear <= m < front of a field that exist; it changes the soil's state between ticks."""

    def __init__(self, field: Field) -> None:
        self.field = field
        self._rear, self._front = field.first_window
        self._first = self._rear  # of the strips at the start
        self._warned = False
        self.with_history = 0
        """Particles before this identity have the histories of their contacts."""

    def strips_about(self, model: SoilModel, tools: tuple[ToolSurface, ...]) -> tuple[int, int] | None:
        """Strips that tools need at the start; None if all are above the soil.

        Raises:
            InputError: the tools begin beyond the field.
        """
        span = _span_m(model, tools)
        if span is None:
            return None
        end = self.field.ends_m[1]
        if span[0] >= end:
            raise InputError(
                f"tools: begin at x = {span[0]:.4g} m, beyond the field, which ends at {end:.4g} m; make "
                "soil.bin.length_m larger, or let them begin before"
            )
        return self.field.strips_about(*span)

    def strips_ahead(
        self, model: SoilModel, state: SoilState, where: str, motions: tuple[ToolMotion, ...]
    ) -> tuple[int, int] | None:
        """Strips that the way of the tools to `motions` needs; None if these exist.

        Raises:
            PhysicsError: a tool is back where the soil was removed.
        """
        span = _span_m(model, state.tools, motions)
        if span is None:
            return None
        end = self._rear * self.field.strip_m + self.field.layer_m + 2.0 * model.radius_m
        if self._rear > 0 and span[0] < end:
            raise PhysicsError(
                f"{where}: a tool is back at x = {span[0]:.4g} m, where the soil behind it was "
                f"taken away; allowed is x > {end:.4g} m: make soil.window.behind_m larger, or leave "
                "soil.window out"
            )
        rear, front = self.field.strips_about(*span)
        rear, front = max(rear, self._rear), max(front, self._front)
        return None if (rear, front) == (self._rear, self._front) else (rear, front)

    def lay_out(self, rear: int, front: int) -> Strips:
        """Start with these strips."""
        self._rear, self._front, self._first = rear, front, rear
        return self.field.strips(rear, front)

    def held(self, laid: Strips) -> np.ndarray:
        """(n,) bool: particles, where they were laid out, that are held."""
        return self.field.held(laid.identity, laid.position_m[:, 0], self._rear, self._front)

    def enter(self, state: SoilState) -> None:
        """Put the walls of a state about the strips, and count the particles there were."""
        box = self.field.box(self._rear, self._front)
        # what was thrown behind the window leaves with its next shift
        state.domain.move_to(box, open_behind=self._rear > 0)
        if state.monitor is not None:
            first, last = map(self.field.first_identity, (self._first, self._front))
            state.monitor.count = last - first

    def give_histories(self, model: SoilModel, state: SoilState) -> None:
        """Give the contacts of particles that were just laid out their histories."""
        known, self.with_history = self.with_history, self.field.first_identity(self._front)
        if known == self.with_history:
            return
        p, pairs = state.particles, state.pairs
        first = np.repeat(p.identity, np.diff(pairs.row_start))
        second = p.identity[pairs.neighbour]
        new = np.flatnonzero(np.maximum(first, second) >= known)
        pairs.history[history_places(new, len(model.parity))] = self.field.histories(first[new], second[new])

    def shift(self, model: SoilModel, host: CpuSteps, rear: int, front: int) -> None:
        """Move to strips rear <= m < front. Forces change on particles laid out or freed only."""
        state, field = host.state, self.field
        p = state.particles
        stay = np.flatnonzero(p.position[:, 0] >= rear * field.strip_m)
        self._warn_of_motion_ahead(model, p)
        laid = field.strips(max(self._front, rear), front)
        all_held = np.ones(len(laid.identity), np.bool_)
        new = model.particles(laid.position_m, laid.radius_m, laid.material, all_held, laid.identity)
        came_from = np.concatenate((stay, p.count + np.arange(new.count)))
        held_before = p.identity[p.held]
        pairs = state.pairs
        none = np.full(new.count, pairs.row_start[-1])
        state.pairs = pairs._replace(row_start=np.concatenate((pairs.row_start, none)))
        state.particles = p = p.joined(new)
        p.reorder(came_from)
        self._rear, self._front = rear, front
        p.held = field.held(p.identity, p.position[:, 0], rear, front)
        p.velocity[p.held] = 0.0
        p.angular_velocity[p.held] = 0.0
        self.enter(state)
        known = self.with_history
        host.rebuild(tuple(tool.last for tool in state.tools), came_from)
        self.give_histories(model, state)
        host.forces_on(~p.held & np.isin(p.identity, held_before) | (p.identity >= known))

    def _warn_of_motion_ahead(self, model: SoilModel, p: Particles) -> None:
        """Warn if soil that the tools move comes near the layer that is held ahead.

        A particle counts as moved if it is more than a radius from where it was laid out, as in the
        disturbance, and as near within a diameter of the layer: contact forces reach less far.
        """
        if self._front == self.field.count or self._warned:
            return
        end = self._front * self.field.strip_m - self.field.layer_m - 2.0 * model.radius_m
        near = np.flatnonzero(~p.held & (p.position[:, 0] > end))
        way = p.position[near] - self.field.laid_out_m(p.identity[near])
        if (np.abs(way[:, [0, 2]]).max(initial=0.0)) > model.smallest_m:
            self._warned = True
            _logger.warning(
                "warning: soil moves at the front of the window, where it is held at x = %.3f m, and the "
                "draft may rise by that; make soil.window.ahead_m longer",
                end,
            )

    def arrays(self) -> dict[str, np.ndarray]:
        """Its part of a checkpoint."""
        return {"window": np.array((self._rear, self._front, self._first))}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Continue from `arrays`."""
        self._rear, self._front, self._first = arrays["window"].tolist()
        self.with_history = self.field.first_identity(self._front)


def _span_m(
    model: SoilModel, tools: tuple[ToolSurface, ...], motions: tuple[ToolMotion, ...] = ()
) -> tuple[float, float] | None:
    """Lowest and highest x [m] of the tools where they are and, if given, at `motions`, below
    z = soil.bin.depth_m; None if all are above."""
    depth = model.soil.bin.depth_m
    spans = [tool.span_m(depth) for tool in tools]
    spans += [tool.span_m(depth, motion) for tool, motion in zip(tools, motions, strict=False)]
    low = min((span[0] for span in spans), default=np.inf)
    high = max((span[1] for span in spans), default=-np.inf)
    return (low, high) if low <= high else None
