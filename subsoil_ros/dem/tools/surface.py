"""One tool in the soil: its surface, its motion through a tick, its candidates and its load."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ...contact_laws.base import SHARED_SINKS
from ...errors import PhysicsError
from ...loading.loader import ResolvedScene
from ...messages import FacetGroupForce, SpatialMotion, ToolMotion, ToolWrench, work_joule
from ...rotations import placed_m, rotation_between
from ...scene.soil import Soil
from ...scene.tool_mesh import ToolMesh, load_tool_mesh
from ..bed import Bed
from ..kernel_calls import KernelCalls
from ..mixture import ContactModel
from ..neighbours import CellGrid, carry_rows
from ..particles import Particles, ToolList
from ..periodic import refuse_tool_at_held_side, refuse_tool_at_seam
from ..snapshot import from_named, motion_array, motion_from, named
from .contacts import CONTACTS
from .facets import Facets, facets_of, inside_or_near, near_facets
from .forces import parts_of_loads, tool_forces, tool_scan
from .motion import Motion, kernel_motion


@dataclass
class ToolLoad:
    """Sums over the soil steps of one tick."""

    group_force: np.ndarray  # (groups, 3) [N], sum over steps
    moment: np.ndarray  # (3,) [N m], sum over steps
    work_joule: float = 0.0
    contacts: int = 0  # at the last step
    steps: int = 0


@dataclass
class ToolSurface:
    """Surface and contact state of one tool.

    mesh: as ToolMesh has it; of a tool that moves in space, about the body's own y.
    """

    name: str
    mesh: ToolMesh
    reference_angle_rad: float
    last: ToolMotion  # at the end of the last soil step
    kept: int = 0  # numbers that the law keeps of a contact beside its springs
    sink_count: int = SHARED_SINKS
    facets: Facets = field(init=False)
    near: ToolList = field(init=False)
    max_overlap_m: float = field(default=0.0, init=False)
    sinks_joule: np.ndarray = field(init=False)
    load: ToolLoad = field(init=False)

    def __post_init__(self) -> None:
        self.facets = facets_of(self.mesh)
        self.sinks_joule = np.zeros(self.sink_count)
        self._edges = np.unique(
            np.sort(self.mesh.facets[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2), axis=0
        )
        self.spatial = isinstance(self.last, SpatialMotion)
        about = self.mesh.vertices_m if self.spatial else self.mesh.vertices_m[:, [0, 2]]
        self._radius_m = float(np.linalg.norm(about, axis=1).max())
        self._searched = self.last
        self._parts = parts_of_loads(len(self.mesh.groups), self.sink_count)
        self._kernels = KernelCalls()
        self.enter(self.last)
        self.begin_tick()

    def enter(self, motion: ToolMotion) -> None:
        """Be at `motion`, in contact with nothing."""
        none = np.empty(0, np.int64)
        normal, shear, rolling = (np.zeros((0, CONTACTS, count)) for count in (3, 3, 3 + self.kept))
        empty = (np.zeros((0, CONTACTS), np.bool_), normal, shear, rolling)
        self.near = ToolList(none, np.zeros(1, np.int64), np.empty(0, np.int32), *empty)
        self.last = motion

    def begin_tick(self) -> None:
        """Clear the load of the tick before."""
        self.load = ToolLoad(np.zeros((len(self.mesh.groups), 3)), np.zeros(3))

    def kernel_motion(self, motion: ToolMotion) -> Motion:
        """`motion` as the kernels take it."""
        return kernel_motion(motion, self.reference_angle_rad)

    def world_m(self, motion: ToolMotion) -> np.ndarray:
        """Vertices (v, 3) in the world."""
        if not self.spatial:
            x, z, cosine, sine = self.kernel_motion(motion)[:4]
            own_x, own_y, own_z = self.mesh.vertices_m.T
            return np.stack(
                (x + cosine * own_x - sine * own_z, own_y, z + sine * own_x + cosine * own_z), axis=1
            )
        return placed_m(self.mesh.vertices_m, motion.position_m, motion.quaternion)

    def search(
        self, motion: ToolMotion, particles: Particles, order: np.ndarray, cell_start: np.ndarray,
        grid: CellGrid, reach: float,
    ) -> None:  # fmt: skip
        """Find the candidates within `reach` [m] of the tool at `motion`, particles being in new `order`."""
        particle, facet_start, facet = near_facets(
            particles.rows.place, cell_start, grid, self.kernel_motion(motion), self.facets.corner, reach
        )
        old = self.near
        histories = carry_rows(
            order, old.particle, particle, (old.active, old.normal, old.shear, old.rolling)
        )
        self.near = ToolList(particle, facet_start, facet, *histories)
        self.searched_at(motion)

    def searched_at(self, motion: ToolMotion) -> None:
        """Note `motion` as that at which candidates were searched."""
        self._searched = motion

    def moved_m(self, motion: ToolMotion) -> float:
        """Bound on how far any point of the surface moved since the search [m]."""
        then = self._searched
        if self.spatial:
            shift = math.dist(motion.position_m, then.position_m)
            turn = math.hypot(*rotation_between(then.quaternion, motion.quaternion))
            return shift + 2.0 * self._radius_m * math.sin(0.5 * turn)  # a chord
        shift = math.hypot(motion.x_m - then.x_m, motion.z_m - then.z_m)
        return shift + self._radius_m * abs(motion.angle_rad - then.angle_rad)

    def speed_m_per_s(self, motion: ToolMotion) -> float:
        """Bound on the speed of any point of the surface [m/s]."""
        if self.spatial:
            turning = math.hypot(*motion.spin_rad_per_s)
            return math.hypot(*motion.velocity_m_per_s) + self._radius_m * turning
        speed = math.hypot(motion.velocity_x_m_per_s, motion.velocity_z_m_per_s)
        return speed + self._radius_m * abs(motion.angular_velocity_rad_per_s)

    def overlapped(self, particles: Particles, clearance_m: np.ndarray) -> np.ndarray:
        """Particles (numbers) inside the surface or closer to it than their `clearance_m` (n,) less
        the setback."""
        clearance_m = np.maximum(clearance_m - self.mesh.setback_m, 0.0)
        pose, vertices, position = self.kernel_motion(self.last), self.mesh.vertices_m, particles.position
        if self.spatial:
            vertices, local = self.world_m(self.last), position
        else:
            dx, dz = position[:, 0] - pose[0], position[:, 2] - pose[1]
            local = np.stack(
                (pose[2] * dx + pose[3] * dz, position[:, 1], pose[2] * dz - pose[3] * dx), axis=1
            )
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        near = clearance_m[:, None]
        candidates = np.flatnonzero(((local > low - near) & (local < high + near)).all(axis=1))
        hit = inside_or_near(position, candidates, pose, self.facets.corner, clearance_m)
        return candidates[hit]

    def span_m(self, below_m: float, motion: ToolMotion | None = None) -> tuple[float, float]:
        """Lowest and highest x of its surface at `motion`, by default where it is, below this height [m]; inf
        and -inf where it is above."""
        motion = motion or self.last
        if self.spatial:
            at, height = self.world_m(motion)[self._edges][:, :, [0, 2]].T  # (2, edges)
            height = height - below_m
        else:
            x, z, cosine, sine = self.kernel_motion(motion)[:4]
            local_x, local_z = self.mesh.vertices_m[self._edges][:, :, [0, 2]].T  # (2, edges)
            at = x + cosine * local_x - sine * local_z
            height = z + sine * local_x + cosine * local_z - below_m
        crossing = (height[0] > 0.0) != (height[1] > 0.0)
        part = height[0, crossing] / (height[0, crossing] - height[1, crossing])
        ends = np.append(at[height <= 0.0], at[0, crossing] + part * np.diff(at, axis=0)[0, crossing])
        return float(ends.min(initial=np.inf)), float(ends.max(initial=-np.inf))

    def bind(self, particles: Particles, model: ContactModel) -> None:
        """Bind the arrays of `forces`, until particles are sorted, or candidates searched, anew."""
        self._tool_forces: Callable[[Motion], tuple[np.ndarray, np.ndarray, np.ndarray]] = self._kernels.bind(
            tool_forces, self.near, self.facets, particles.kinematics, *model, particles.loads, self._parts,
            varying=(self.kernel_motion(self.last),),
        )  # fmt: skip

    def forces(self, motion: ToolMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Adds the forces on the particles of one soil step at whose end the tool stands at `motion`.

        Returns the load on the tool: see tools.forces.tool_forces.
        """
        return self._tool_forces(self.kernel_motion(motion))

    def add_load(
        self, by_group: np.ndarray, torque: np.ndarray, sums: np.ndarray, motion: ToolMotion
    ) -> None:
        """Sums up what `forces` returned for a step that ends at `motion`."""
        fx, fy, fz = by_group.sum(axis=0).tolist()
        self.load.group_force += by_group
        self.load.moment += torque
        self.load.work_joule += work_joule((fx, fy, fz), torque.tolist(), self.last, motion)
        self.load.contacts = int(sums[SHARED_SINKS])
        self.load.steps += 1
        self.max_overlap_m = max(self.max_overlap_m, float(sums[SHARED_SINKS + 1]))
        self.sinks_joule += np.delete(sums, (SHARED_SINKS, SHARED_SINKS + 1))
        self.last = motion

    def refuse_at_sides(self, motion: ToolMotion, bed: Bed, soil: Soil) -> None:
        """Raises SceneError where the tool, at `motion`, is at periodic or held sides of the soil."""
        vertices = self.world_m(motion) if self.spatial else self.mesh.vertices_m
        refuse_tool_at_seam(self.name, vertices, bed, soil)
        refuse_tool_at_held_side(self.name, vertices, soil)

    def stored_joule(self, particles: Particles, model: ContactModel) -> float:
        """Energy in this tool's contacts [J]."""
        motion = self.kernel_motion(self.last)
        return tool_scan(self.near, self.facets, motion, particles.rows.place, model)

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint between two ticks; not copied."""
        return {
            **named("near", self.near),
            "last": motion_array(self.last),
            "searched": motion_array(self._searched),
            "max_overlap_m": np.array(self.max_overlap_m),
            "sinks_joule": self.sinks_joule,
        }

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Continue from arrays of `state_arrays`."""
        self.near = from_named(ToolList, "near", arrays)
        self.last = motion_from(self.name, arrays["last"])
        self._searched = motion_from(self.name, arrays["searched"])
        self.max_overlap_m = float(arrays["max_overlap_m"])
        self.sinks_joule = arrays["sinks_joule"]

    def wrench(self) -> ToolWrench:
        """Load on the tool since begin_tick: force and moment as means over the steps, work as a sum."""
        share = 1.0 / max(self.load.steps, 1)
        by_group = self.load.group_force * share
        fx, fy, fz = by_group.sum(axis=0).tolist()
        tx, ty, tz = (self.load.moment * share).tolist()
        groups = [FacetGroupForce(name, *by_group[g].tolist()) for g, name in enumerate(self.mesh.groups)]
        return ToolWrench(
            self.name, fx, fy, fz, tx, ty, tz, self.load.work_joule, self.load.contacts, tuple(groups)
        )  # fmt: skip


def surfaces(resolved: ResolvedScene, bed: Bed, motions: tuple[ToolMotion, ...]) -> tuple[ToolSurface, ...]:
    """The tools of a scene at `motions`.

    Raises:
        SceneError: a mesh cannot be used, or a tool would reach across the seam of a periodic bed.
    """
    scene, soil = resolved.scene, resolved.scene.particle_soil
    assert soil is not None
    bodies = scene.mechanism.bodies if scene.mechanism else {}
    sinks, found = len(soil.law.sinks), []
    for (name, tool), motion in zip(scene.tools.items(), motions, strict=True):
        mesh = load_tool_mesh(resolved.directory, scene, name).without_voids()
        reference = bodies[tool.body].angle_rad if tool.body else 0.0
        if isinstance(motion, SpatialMotion):
            mesh = mesh.about_body()
        surface = ToolSurface(name, mesh, reference, motion, len(soil.law.kept), sinks)
        surface.refuse_at_sides(motion, bed, soil)
        found.append(surface)
    return tuple(found)


def refuse_leap(where: str, tool: ToolSurface, motion: ToolMotion, step_s: float, allowed_m: float) -> None:
    """Refuse a surface that moves by more than a radius, less its setback, in a step: it could pass a centre
    undetected.

    Raises:
        PhysicsError: always.
    """
    speed, spin = tool.speed_m_per_s(motion), math.hypot(*motion.spin_rad_per_s)
    less = " less tools.*.setback_m" if tool.mesh.setback_m else ""
    angle = "" if tool.spatial else f", at an angle of {motion.angle_rad:.4g} rad"
    raise PhysicsError(
        f"{where}: tool {tool.name} moves at up to {speed:.3g} m/s, {speed * step_s:.3g} m in one soil step "
        f"(turning at {spin:.3g} rad/s{angle}); "
        f"allowed is the radius of the smallest particle{less}, {allowed_m:g} m: make the tool slower, or "
        "use a smaller soil.time_step_s"
    )
