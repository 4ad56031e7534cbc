"""The terrain engine: motions of the tools in, wrenches on the tools out, over a height field."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..leaps import entry
from ..loading.loader import ResolvedScene
from ..messages import (
    FacetGroupForce,
    SoilCloud,
    SoilState,
    SpatialMotion,
    ToolMotion,
    ToolWrench,
    motion_of,
    work_joule,
)
from ..rotations import Quaternion, matrix_of, planar_quaternion, product, quaternion_of, rotation_between
from ..scene.tool_mesh import load_tool_mesh
from ..wedge.failure_wedge import Strength
from .cavity import Cavity, cut, drift, regrid, settle
from .dig_forces import Felt, Surface, carry, find_contact, press_mouth, press_plates
from .terrain_field import BANK_CELLS, Array, Ground, Pose, slide, touch, turned
from .tool_shape import PITCHES_RAD, ToolShape, View, tool_shape, views

STEP_CELLS = 1.0
"""Largest way of any point of a tool between two cuts, in cells."""

STILL_M = 1e-5
"""Amount below which soil that slides is at rest."""


STEP_RAD = float(PITCHES_RAD[1] - PITCHES_RAD[0])
KEPT_PART = 0.7
"""A view is kept up to this part of the step to the next: more than half, against changes to and fro."""

_NOTHING = Cavity(np.eye(3), np.zeros(2), np.full((1, 1), np.nan), np.zeros((2, 1, 1)), np.zeros((1, 1)))


@dataclass
class _Tool:
    """A tool and its part of the state."""

    name: str
    groups: tuple[str, ...]
    shape: ToolShape
    views: tuple[View, ...]
    floor_group: int  # facet group of most of its upward surface, which carries
    view: int  # number of the view in use
    cavity: Cavity
    reach_m: float  # of its farthest point from its origin
    turn_back: Quaternion  # to the reference pose, in which the mesh is given
    press_m: Array
    drift_m_per_s: Array
    box: np.ndarray  # of the columns that it touches
    motion: ToolMotion | None = None


class TerrainEngine:
    """A terrain and the tools in it. docs/terrain.md has the model and its limits."""

    keeps_state = True

    def __init__(self, resolved: ResolvedScene) -> None:
        soil = resolved.scene.terrain_soil
        if soil is None:
            raise InputError(f"{resolved.path}: soil.model is not 'terrain'; it needs another engine")
        scene, values, cell = resolved.scene, soil.values, soil.cell_m
        self._scene, self._interval_s = scene, resolved.timing.communication_step_s
        self._values = values
        phi, gamma = values.friction_angle_rad, values.density_kg_per_m3 * scene.gravity_m_per_s2
        self._strength = Strength(
            gamma, values.density_kg_per_m3, 0.5 * (values.cohesion_pa + values.loose_cohesion_pa),
            0.5 * (phi + values.loose_friction_angle_rad), values.adhesion_pa,
            values.tool_friction_angle_rad, 0.0, values.speed_factor, False,
        )  # fmt: skip
        shape = soil.shape
        self._ground = Ground(
            np.zeros(shape), np.zeros(shape), np.full(shape, np.inf), np.zeros(1),
            (0.0, -0.5 * shape[1] * cell), cell, -soil.bin.depth_m,
            values.loose_friction_angle_rad, phi,
            1.0 + values.loosening, values.cohesion_pa / gamma, values.loose_cohesion_pa / gamma,
        )  # fmt: skip
        self._moving = np.zeros(4, dtype=np.int64)  # box of the columns that slid last
        self._tools = [self._tool(resolved, name) for name in scene.tools]
        if scene.tools:
            self._load_kernels()

    def _load_kernels(self) -> None:
        """Dig once in another ground: loaded at the first cut, kernels would stop a robot's soil."""
        first = self._tools[0]
        tool = replace(
            first, press_m=first.press_m.copy(), drift_m_per_s=np.zeros(3), box=np.zeros(4, dtype=np.int64)
        )
        kept, cell, points = self._ground, self._ground.cell_m, tool.shape.points_m
        shape = tuple(int(size / cell) + 4 for size in np.ptp(points[:, :2], axis=0).tolist())
        self._ground = kept._replace(
            firm_m=np.zeros(shape), loose_m=np.zeros(shape), under_m=np.full(shape, np.inf),
            spilled_m=np.zeros(1), corner_m=(0.0, 0.0),
        )  # fmt: skip
        x, y, z = (np.array([2.0 * cell, 2.0 * cell, -cell]) - points.min(axis=0)).tolist()
        level, still = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
        tool.motion = SpatialMotion.of(tool.name, (x, y, z), level, still, still)
        self._moved(tool, SpatialMotion.of(tool.name, (x + 0.1 * cell, y, z), level, still, still))
        self._ground, self._moving[:] = kept, 0

    def _tool(self, resolved: ResolvedScene, name: str) -> _Tool:
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name).about_body()
        shape = tool_shape(mesh, self._ground.cell_m)
        seen = views(mesh, self._ground.cell_m)
        body = resolved.scene.tools[name].body
        bodies = resolved.scene.mechanism.bodies if resolved.scene.mechanism else {}
        back = planar_quaternion(-bodies[body].angle_rad if body else 0.0)
        reach = float(np.linalg.norm(shape.points_m, axis=1).max())
        press = np.zeros(len(shape.plate_group) + 1)
        return _Tool(
            name,
            mesh.groups,
            shape,
            seen,
            _floor_group(shape),
            -1,
            _NOTHING,
            reach,
            back,
            press,
            np.zeros(3),
            np.zeros(4, dtype=np.int64),
        )

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of the initial state; soil in a cavity is carried, soil that a tool overlaps removed."""
        for tool, motion in zip(self._tools, motions, strict=True):
            tool.motion = motion
        return tuple(
            self._moved(tool, motion, at_start=True)
            for tool, motion in zip(self._tools, motions, strict=True)
        )

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches at the end of `tick`, the tools moving from where they stand to `motions`."""
        return tuple(self._moved(tool, motion) for tool, motion in zip(self._tools, motions, strict=True))

    def state(self, run_id: str, tick: int, end_time_ns: int) -> SoilState:
        """A terrain has no monitors."""
        return SoilState(run_id, tick, end_time_ns)

    def ends_with(self, tick: int) -> None:
        """Nothing is left to do when a run ends early."""

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        """Spheres as wide as a cell under the surface of the ground, and under that of what tools carry."""
        ground, half = self._ground, 0.5 * self._ground.cell_m
        top = ground.firm_m + ground.loose_m
        x, y = (
            corner + ground.cell_m * (np.arange(size) + 0.5)
            for corner, size in zip(ground.corner_m, top.shape, strict=True)
        )
        points = [np.stack([*np.meshgrid(x, y, indexing="ij"), top], axis=-1).reshape(-1, 3)]
        for tool in self._tools:
            assert tool.motion is not None
            a, b = np.nonzero(tool.cavity.carried_m > half)
            rotation = self._rotation(tool, tool.motion.quaternion)
            up = tool.cavity.floor_m[a, b] + tool.cavity.carried_m[a, b]
            level = tool.cavity.corner_m + ground.cell_m * (np.column_stack([a, b]) + 0.5)
            own = np.column_stack([level, up]) @ tool.cavity.axes
            points.append(own @ rotation.T + tool.motion.position_m)
        positions = np.concatenate(points) - (0.0, 0.0, half)
        return SoilCloud(
            tick, end_time_ns, positions.astype(np.float32), np.zeros(len(positions), np.float32)
        )

    def state_arrays(self) -> dict[str, np.ndarray]:
        """All that later ticks depend on, by name."""
        ground = self._ground
        arrays: dict[str, np.ndarray] = {
            "firm_m": ground.firm_m, "loose_m": ground.loose_m, "spilled_m": ground.spilled_m,
            "moving": self._moving,
        }  # fmt: skip
        for tool in self._tools:
            assert tool.motion is not None
            arrays |= {
                f"tool.{tool.name}.motion": _array_of(tool.motion),
                f"tool.{tool.name}.view": np.array(tool.view),
                f"tool.{tool.name}.carried_m": tool.cavity.carried_m,
                f"tool.{tool.name}.press_m": tool.press_m,
                f"tool.{tool.name}.drift_m_per_s": tool.drift_m_per_s,
                f"tool.{tool.name}.box": tool.box,
            }
        return arrays

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Restore a state that `state_arrays` returned, in place of `start`.

        Raises:
            KeyError, ValueError: the state is of another scene.
        """
        for name, array in (
            ("firm_m", self._ground.firm_m), ("loose_m", self._ground.loose_m),
            ("spilled_m", self._ground.spilled_m), ("moving", self._moving),
        ):  # fmt: skip
            _fill(array, arrays[name])
        for tool in self._tools:
            tool.motion = _motion_of(tool.name, arrays[f"tool.{tool.name}.motion"])
            tool.view = int(arrays[f"tool.{tool.name}.view"])
            if tool.view >= len(tool.views):
                raise ValueError(f"tool {tool.name}: {len(tool.views)} views")
            if tool.view >= 0:
                seen = tool.views[tool.view]
                tool.cavity = Cavity(*seen, np.zeros_like(seen.floor_m))
            for name, array in (
                ("carried_m", tool.cavity.carried_m), ("press_m", tool.press_m),
                ("drift_m_per_s", tool.drift_m_per_s), ("box", tool.box),
            ):  # fmt: skip
                _fill(array, arrays[f"tool.{tool.name}.{name}"])

    def _moved(self, tool: _Tool, motion: ToolMotion, *, at_start: bool = False) -> ToolWrench:
        assert tool.motion is not None
        before, ground = tool.motion, self._ground
        if self._scene.tools[tool.name].may_leap:
            leapt = entry(before, motion, self._interval_s)
            if leapt is not None:
                before = leapt
                tool.press_m[:] = tool.drift_m_per_s[:] = 0.0
        turn = rotation_between(before.quaternion, motion.quaternion)
        way = math.dist(before.position_m, motion.position_m) + tool.reach_m * math.hypot(*turn)
        steps = max(1, math.ceil(way / (STEP_CELLS * ground.cell_m)))
        for step in range(1, steps + 1):
            pose = self._pose(tool, before, motion, turn, step / steps)
            arms = turned(tool.shape.points_m, pose.rotation)
            around, close = touch(ground, arms, pose.origin_m, tool.box)
            self._look(tool, pose)
            cut(ground, tool.cavity, pose, tool.box, at_start)
            drift(tool.cavity, ground.cell_m, self._interval_s / steps * (tool.drift_m_per_s @ pose.rotation))
            settle(ground, tool.cavity, pose, tool.box)
            self._slide(tool)
        tool.motion = motion
        felt = Felt(
            np.zeros((len(tool.groups), 3)),
            np.zeros(3),
            tool.press_m,
            tool.drift_m_per_s,
            np.full(len(tool.shape.points_m), -1.0),
        )
        if close and not math.isnan(around):
            surface = Surface(arms, turned(tool.shape.normals, pose.rotation), tool.shape.areas_m2)
            find_contact(ground, tool.cavity, pose, surface, tool.box, around, felt)
            soft = self._values.bed_modulus_newton_per_m3
            press_plates(tool.shape, surface, pose, self._strength, soft, self._interval_s, felt)
            press_mouth(
                ground,
                tool.cavity,
                tool.floor_group,
                pose,
                around,
                self._strength,
                soft,
                self._interval_s,
                felt,
            )
        else:
            tool.press_m[:] = tool.drift_m_per_s[:] = 0.0
        carry(ground, tool.cavity, tool.floor_group, pose, self._strength.unit_weight / ground.swell, felt)
        ground.under_m[tool.box[0] : tool.box[2], tool.box[1] : tool.box[3]] = np.inf
        return self._wrench(tool, felt, before, motion)

    def _pose(
        self,
        tool: _Tool,
        before: ToolMotion,
        after: ToolMotion,
        turn: tuple[float, float, float],
        part: float,
    ) -> Pose:
        """The pose a part of the way on, with the velocity of this tick."""
        x, y, z = (a + part * (b - a) for a, b in zip(before.position_m, after.position_m, strict=True))
        some = quaternion_of((part * turn[0], part * turn[1], part * turn[2]))
        rotation = self._rotation(tool, product(some, before.quaternion))
        rates = [(b - a) / self._interval_s for a, b in zip(before.position_m, after.position_m, strict=True)]
        return Pose(rotation, np.array([x, y, z]), np.array(rates), np.array(turn) / self._interval_s)

    def _rotation(self, tool: _Tool, quaternion: Quaternion) -> Array:
        """From the axes of a tool's mesh to the world's."""
        return np.reshape(matrix_of(product(quaternion, tool.turn_back)), (3, 3))

    def _look(self, tool: _Tool, pose: Pose) -> None:
        """Choose the view of a tool from above; carry its soil over from the one before."""
        if not tool.views:
            return
        x, _, z = pose.rotation[2].tolist()  # the world's up in the tool's axes
        tilt = math.atan2(x, z)
        if tool.view >= 0 and abs(tilt - PITCHES_RAD[tool.view]) < KEPT_PART * STEP_RAD:
            return
        number = int(np.argmin(np.abs(PITCHES_RAD - tilt)))
        if number == tool.view:
            return
        seen, old = tool.views[number], tool.cavity
        tool.view, tool.cavity = number, Cavity(*seen, np.zeros_like(seen.floor_m))
        regrid(self._ground, old, tool.cavity, pose, tool.box)

    def _slide(self, tool: _Tool) -> None:
        """Let the ground slide near the tool and where it slid last."""
        box, old = tool.box, self._moving
        reach = max(BANK_CELLS) if self._ground.cohesion_height_m > 0.0 else 2
        near = np.array([box[0] - reach, box[1] - reach, box[2] + reach, box[3] + reach])
        if old[2] > old[0]:
            near[:2] = np.minimum(near[:2], old[:2] - reach)
            near[2:] = np.maximum(near[2:], old[2:] + reach)
        if slide(self._ground, near, self._moving) < STILL_M:
            self._moving[:] = 0

    def _wrench(self, tool: _Tool, felt: Felt, before: ToolMotion, after: ToolMotion) -> ToolWrench:
        fx, fy, fz = felt.group_newton.sum(axis=0).tolist()
        tx, ty, tz = felt.torque_newton_m.tolist()
        work = work_joule((fx, fy, fz), (tx, ty, tz), before, after)
        parts = tuple(
            FacetGroupForce(group, *force)
            for group, force in zip(tool.groups, felt.group_newton.tolist(), strict=True)
        )
        count = int((felt.depth_m > 0.0).sum())
        return ToolWrench(tool.name, fx, fy, fz, tx, ty, tz, work, count, parts)


def _fill(array: np.ndarray, values: np.ndarray) -> None:
    """Copy values of the same shape."""
    if array.shape != values.shape:
        raise ValueError(f"shape {values.shape}, not {array.shape}")
    array[...] = values


def _floor_group(shape: ToolShape) -> int:
    """The facet group with the largest area that looks up."""
    counts = np.diff(shape.plate_first)
    group = np.repeat(shape.plate_group, counts)
    upward = np.maximum(shape.normals[:, 2], 0.0) * shape.areas_m2
    return int(np.argmax(np.bincount(group, weights=upward)))


def _array_of(motion: ToolMotion) -> Array:
    """Position, orientation, velocities and planar angle, NaN in space."""
    return np.array(
        [
            *motion.position_m, *motion.quaternion, *motion.velocity_m_per_s, *motion.spin_rad_per_s,
            motion.angle_rad,
        ]
    )  # fmt: skip


def _motion_of(name: str, array: Array) -> ToolMotion:
    """The motion of such an array."""
    x, y, z, a, b, c, d, vx, vy, vz, wx, wy, wz, angle = array.tolist()
    return motion_of(name, (x, y, z), (a, b, c, d), (vx, vy, vz), (wx, wy, wz), angle)
