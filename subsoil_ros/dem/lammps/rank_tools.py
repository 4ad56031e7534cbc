"""The tools of a scene on one rank: contacts with the particles that the rank owns.

Contacts are found and computed by dem.tools. What is kept of them lies with the particle, in a property that
LAMMPS sends along when the particle moves to another rank: SLOTS contacts of all tools together.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ...contact_laws.base import SHARED_SINKS
from ...errors import PhysicsError
from ...messages import ToolMotion
from ...scene.tool_mesh import ToolMesh
from ..model import SoilModel
from ..neighbours import cell_grid, sort_by_cell
from ..particles import Particles, ToolList
from ..periodic import TOOL_SKIN
from ..tools.contacts import CONTACTS
from ..tools.facets import near_facets
from ..tools.surface import ToolSurface

SLOTS = 4
"""Contacts of a particle with all tools that are kept; a sharp edge gives two, a corner three."""

_FIXED = 10
"""Numbers of every slot: number of the tool from 1 on (0: free), normal, tangential and rolling spring."""


class ToolStart(NamedTuple):
    """What a rank makes a tool of; see ToolSurface."""

    name: str
    mesh: ToolMesh
    reference_angle_rad: float
    motion: ToolMotion


class Local(NamedTuple):
    """Particles of a rank, as LAMMPS holds them; not copied."""

    tag: np.ndarray  # (n,) identity + 1
    position: np.ndarray  # (n, 3) [m], as the next ones
    velocity: np.ndarray
    angular_velocity: np.ndarray
    force: np.ndarray
    torque: np.ndarray
    radius: np.ndarray  # (n,) [m]
    mass: np.ndarray  # (n,) [kg]
    type: np.ndarray  # (n,) from 1 on
    kept: np.ndarray  # (n, history_numbers)


def history_numbers(model: SoilModel) -> int:
    """Numbers that a particle keeps of its contacts with tools."""
    return SLOTS * (_FIXED + len(model.soil.law.kept))


def load_numbers(tool: ToolSurface) -> int:
    """Numbers of a tool's load in one soil step: forces of groups, moment, sums."""
    return 3 * len(tool.mesh.groups) + 3 + tool.sink_count + 2


class RankTools:
    """Tools at work on one rank."""

    def __init__(self, model: SoilModel, starts: tuple[ToolStart, ...]) -> None:
        law, self._model = model.soil.law, model
        self.tools = tuple(ToolSurface(*start, len(law.kept), len(law.sinks)) for start in starts)
        self._near = [_Candidates() for _ in self.tools]
        self._known: tuple[int, int] | None = None  # rebuilds and particles when candidates were searched

    @property
    def numbers(self) -> int:
        """Numbers of the loads of all tools."""
        return sum(load_numbers(tool) for tool in self.tools)

    def largest(self) -> np.ndarray:
        """(numbers,) bool: which of them is a largest value, not a sum."""
        found = []
        for tool in self.tools:
            of_tool = np.zeros(load_numbers(tool), np.bool_)
            of_tool[3 * len(tool.mesh.groups) + 3 + SHARED_SINKS + 1] = True
            found.append(of_tool)
        return np.concatenate(found) if found else np.zeros(0, np.bool_)

    def forget(self) -> None:
        """Search candidates anew in the next step."""
        self._known = None

    def act(
        self, local: Local, rebuilds: int, motions: tuple[ToolMotion, ...], step_s: float, added: np.ndarray
    ) -> np.ndarray:
        """Add the forces of a step at whose end the tools stand at `motions` to `added` (n, 3), and the
        torques to those of the particles.

        Returns (numbers,) the loads on the tools.

        Raises:
            PhysicsError: a particle touches tools in more than SLOTS places.
        """
        loads = []
        new = self._known != (rebuilds, len(local.tag))
        self._known = (rebuilds, len(local.tag))
        # between two searches a particle may pass a whole skin: LAMMPS's lists are built at other times
        allowed = (TOOL_SKIN - 1.0) * self._model.soil.skin_m
        for number, (tool, near, motion) in enumerate(zip(self.tools, self._near, motions, strict=True), 1):
            if new or near.step_s != step_s or tool.moved_m(motion) > allowed:
                self._search(number, tool, near, motion, local, step_s)
            p, rows = near.particles, near.local
            p.position[:], p.velocity[:] = local.position[rows], local.velocity[rows]
            p.angular_velocity[:] = local.angular_velocity[rows]
            p.force[:] = p.torque[:] = 0.0
            by_group, moment, sums = tool.forces(motion)
            added[rows] += p.force
            local.torque[rows] += p.torque
            if _keep(local.kept, rows, number, tool.near, SLOTS) > 0:
                raise PhysicsError(
                    f"a particle has more than {SLOTS} contacts with tools, one of them {tool.name}; "
                    "soil.engine 'lammps' keeps no more: make soil.particles smaller, or use engine 'own'"
                )
            loads += [by_group.ravel(), moment, sums]
        return np.concatenate(loads) if loads else np.zeros(0)

    def _search(
        self,
        number: int,
        tool: ToolSurface,
        near: "_Candidates",
        motion: ToolMotion,
        local: Local,
        step_s: float,
    ) -> None:
        """Find the particles near a tool at `motion`."""
        model, reach, at = self._model, self._model.tool_reach_m, tool.kernel_motion(motion)
        vertices = tool.world_m(motion)
        low, high = vertices.min(axis=0) - reach, vertices.max(axis=0) + reach
        about = np.flatnonzero(((local.position > low) & (local.position < high)).all(axis=1))
        facet_start, facet = np.zeros(1, np.int64), np.empty(0, np.int32)
        if len(about) > 0:
            grid = cell_grid(local.position[about], model.reach_m, low, high, np.inf)
            order, cell_start = sort_by_cell(local.position[about], grid)
            about = about[order]
            particle, facet_start, facet = near_facets(
                local.position[about], cell_start, grid, at, tool.facets.corner, reach
            )
            about = about[particle]
        near.local, near.step_s = about, step_s
        for key in local.kept.T[:: local.kept.shape[1] // SLOTS]:
            ended = key == number
            ended[about] = False
            key[ended] = 0.0
        near.particles = p = self._particles(local, near.local)
        empty = tool.near
        shape = (p.count, CONTACTS)
        tool.near = ToolList(
            np.arange(p.count), facet_start, facet, np.zeros(shape, np.bool_),
            *(np.zeros((*shape, rows.shape[2])) for rows in (empty.normal, empty.shear, empty.rolling)),
        )  # fmt: skip
        _take(local.kept, near.local, number, tool.near, SLOTS)
        tool.searched_at(motion)
        tool.bind(p, model.at_tools(p, step_s))

    def _particles(self, local: Local, rows: np.ndarray) -> Particles:
        model = self._model
        p = Particles.at_rest(local.position[rows], local.tag[rows].astype(np.int32), np.float64)
        if model.soil.particles.sizes is not None or model.soil.layers is not None:
            materials = (local.type[rows].astype(np.int64) - 1) % model.layers
            p.make_unequal(local.radius[rows].copy(), materials, model.density_kg_per_m3)
        return p


class _Candidates:
    """Particles near one tool."""

    def __init__(self) -> None:
        self.local = np.empty(0, np.int64)  # rows of Local
        self.step_s = np.nan  # for which the tool is bound
        self.particles: Any = None


@njit(cache=True, error_model="numpy")
def _take(kept, local, number, near, slots):
    """Fill the contacts of a tool's candidates from what the particles keep of tool `number`."""
    own = near.rolling.shape[2]
    width = 7 + own
    for row in range(local.shape[0]):
        found = 0
        for slot in range(slots):
            at = slot * width
            if kept[local[row], at] != number:
                continue
            near.active[row, found] = True
            for a in range(3):
                near.normal[row, found, a] = kept[local[row], at + 1 + a]
                near.shear[row, found, a] = kept[local[row], at + 4 + a]
            for a in range(own):
                near.rolling[row, found, a] = kept[local[row], at + 7 + a]
            found += 1


@njit(cache=True, error_model="numpy")
def _keep(kept, local, number, near, slots):
    """Put the contacts of a tool's candidates to their particles. Returns how many found no room."""
    own = near.rolling.shape[2]
    width = 7 + own
    left_out = 0
    for row in range(local.shape[0]):
        slot = 0
        for s in range(slots):
            if kept[local[row], s * width] == number:
                kept[local[row], s * width] = 0.0
        for s in range(near.active.shape[1]):
            if not near.active[row, s]:
                continue
            while slot < slots and kept[local[row], slot * width] != 0.0:
                slot += 1
            if slot == slots:
                left_out += 1
                continue
            at = slot * width
            kept[local[row], at] = number
            for a in range(3):
                kept[local[row], at + 1 + a] = near.normal[row, s, a]
                kept[local[row], at + 4 + a] = near.shear[row, s, a]
            for a in range(own):
                kept[local[row], at + 7 + a] = near.rolling[row, s, a]
    return left_out
