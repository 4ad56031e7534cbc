"""The wedge model engine: motions of the tools in, wrenches on the tools out, in closed form."""

import copy
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields

import numpy as np

from ..errors import InputError, PhysicsError
from ..leaps import entry
from ..loading.loader import ResolvedScene
from ..loading.soil_file import RANGE_MARGIN, refuse_rake, soil_of
from ..messages import SpatialMotion, ToolMotion, ToolWrench
from ..scene.tool_faces import CuttingFace, WheelFace, cutting_faces, wheel_face
from ..scene.tool_mesh import load_tool_mesh
from ..scene.wedge_soil import WedgeValues
from .failure_wedge import (
    Failure,
    Plate,
    Strength,
    bearing,
    bearing_pressure,
    block_number,
    block_sizes,
    failure,
    parted,
)
from .wedge_forces import (
    SLOWEST_M_PER_S,
    AccumulatedInSpace,
    AccumulatedLoad,
    across_part,
    grip_newton,
    on_plate,
    rolling_resistance_newton,
    slip_m,
    strength_of,
    wheel_load_newton,
)

ROUND_OFF_RAD = 1e-9
"""Angle by which a plate must lean forward not to count as upright: above the round-off of a pose."""

ROUNDS = 6
"""Iterations of the rupture angle and the direction of sliding, each from the other; they agree to 1e-6."""


@dataclass
class ToolMemory:
    """State of the soil at one tool."""

    x_m: float
    z_m: float
    angle_rad: float
    normal_newton: list[float]  # elastic normal force on each face
    # Of each block; as many as the deepest wedge so far had:
    phase: list[float] = field(default_factory=list)  # of the failure cycle, 0 to 1
    failed_count: list[int] = field(default_factory=list)  # how often it has failed
    strength: list[float] = field(default_factory=list)  # over the mean, until it fails
    length: list[float] = field(default_factory=list)  # over the mean, until it fails
    shear_m: float = 0.0  # of the soil at the end of a wheel's contact


@dataclass
class MemoryInSpace(ToolMemory):
    """State of the soil at a tool in space; angle_rad is 0."""

    y_m: float = 0.0
    quaternion: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 1.0])


@dataclass
class ResistanceState:
    """The whole state of the soil: engines with equal states give equal results from then on."""

    tools: list[ToolMemory] = field(default_factory=list)


@dataclass(frozen=True)
class _Tool:
    """Properties of a tool that do not change in a run."""

    name: str
    groups: tuple[str, ...]
    reference_angle_rad: float
    faces: tuple[CuttingFace, ...] = ()
    wheel: WheelFace | None = None
    in_space: bool = False


class WedgeEngine:
    """Wedges, sides and wheels; one step per tick. docs/wedge.md has the equations and their sources."""

    def __init__(self, resolved: ResolvedScene) -> None:
        soil = resolved.scene.wedge_soil
        if soil is None:
            raise InputError(f"{resolved.path}: soil.model is not 'wedge'; it needs another engine")
        self._resolved = resolved
        self._interval_s = resolved.timing.communication_step_s
        self._length_m, self._seed = soil.bin.length_m, soil.seed
        found = soil_of(soil)
        beyond = "beyond_fitted_range" in resolved.scene.allow
        self._values, self._range = found.values, None if beyond else found.fitted_range
        self._gravity = resolved.scene.gravity_m_per_s2
        self._tools = tuple(self._tool(name) for name in resolved.scene.tools)
        self.memory = ResistanceState()
        self._last: tuple[ToolMotion, ...] = ()  # motions of the tick before, from which tools may leap
        self.keeps_state = not resolved.scene.may_leap
        # loads the kernel, which at the first cut would stop a run in real time for 0.2 s
        failure(Plate(1.0, 1.0, 0.1, 0.1), strength_of(self._values, self._gravity), 0.0)

    def _tool(self, name: str) -> _Tool:
        scene = self._resolved.scene
        tool, place = scene.tools[name], f"tools.{name}"
        mesh = load_tool_mesh(self._resolved.directory, scene, name)
        bodies = scene.mechanism.bodies if scene.mechanism else {}
        phi = bodies[tool.body].angle_rad if tool.body else 0.0
        if tool.is_spatial:
            return _Tool(name, mesh.groups, phi, faces=cutting_faces(mesh.about_body(), place), in_space=True)
        if tool.is_tillage:
            return _Tool(name, mesh.groups, phi, faces=cutting_faces(mesh, place))
        return _Tool(name, mesh.groups, phi, wheel=wheel_face(mesh, place))

    @property
    def values(self) -> WedgeValues:
        """Values of the soil."""
        return self._values

    def with_values(self, values: WedgeValues) -> "WedgeEngine":
        """The same engine at rest in a soil of other values; cheap, for fits."""
        other = copy.copy(self)
        other._values = values
        other.memory = ResistanceState()
        return other

    def with_seed(self, seed: int) -> "WedgeEngine":
        """The same engine with other wedges."""
        other = copy.copy(self)
        other._seed = seed
        return other

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches of the initial state: of wheels that stand in the soil; wedges form with travel."""
        self.memory = ResistanceState(
            [_memory(tool, motion) for tool, motion in zip(self._tools, motions, strict=True)]
        )
        self._last = motions
        return self._answer("start", motions)

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        """Wrenches at the end of `tick`, the tools moving from where they stand to `motions`.

        Raises:
            PhysicsError: a share left the rakes of the theory, or the range its soil was fitted in.
        """
        if self._resolved.scene.may_leap:
            for k, (before, motion) in enumerate(zip(self._last, motions, strict=True)):
                start = entry(before, motion, self._interval_s)
                if start is not None and self._resolved.scene.tools[motion.tool].may_leap:
                    self.memory.tools[k] = _memory(self._tools[k], start)
            self._last = motions
        return self._answer(f"tick {tick}", motions)

    def state_arrays(self) -> dict[str, np.ndarray]:
        """All that later ticks depend on, by name: the memory of each tool."""
        return {
            f"tool.{tool.name}.{name}": np.array(value)
            for tool, memory in zip(self._tools, self.memory.tools, strict=True)
            for name, value in asdict(memory).items()
        }

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Restore a state that `state_arrays` returned, in place of `start`.

        Raises:
            KeyError, ValueError: the state is of another scene.
        """
        self.memory = ResistanceState(
            [
                kind(**{f.name: arrays[f"tool.{tool.name}.{f.name}"].tolist() for f in fields(kind)})
                for tool in self._tools
                for kind in (MemoryInSpace if tool.in_space else ToolMemory,)
            ]
        )
        for tool, memory in zip(self._tools, self.memory.tools, strict=True):
            if len(memory.normal_newton) != len(tool.faces):
                raise ValueError(f"tool {tool.name}: {len(memory.normal_newton)} faces")

    def _answer(self, where: str, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        wrenches = []
        for index, (tool, motion) in enumerate(zip(self._tools, motions, strict=True)):
            memory = self.memory.tools[index]
            accumulated: AccumulatedLoad
            if isinstance(memory, MemoryInSpace) and isinstance(motion, SpatialMotion):
                a, b, c, d = memory.quaternion
                before = (memory.x_m, memory.y_m, memory.z_m), (a, b, c, d)
                memory.x_m, memory.y_m, memory.z_m = motion.position_m
                memory.quaternion = list(motion.quaternion)
                accumulated, motion, moved = AccumulatedInSpace.of(
                    len(tool.groups), before, motion, self._interval_s
                )
            else:
                moved = (
                    motion.x_m - memory.x_m,
                    motion.z_m - memory.z_m,
                    motion.angle_rad - memory.angle_rad,
                )
                memory.x_m, memory.z_m, memory.angle_rad = motion.x_m, motion.z_m, motion.angle_rad
                accumulated = AccumulatedLoad([[0.0, 0.0] for _ in tool.groups])
            if tool.wheel is not None:
                self._roll(tool.wheel, memory, motion, moved, accumulated)
            sizes = self._block_sizes(index, motion) if tool.faces else []
            for number, face in enumerate(tool.faces):
                self._cut(where, index, number, face, motion, moved, accumulated, sizes)
            wrenches.append(accumulated.wrench(tool.name, tool.groups, moved))
        return tuple(wrenches)

    def _cut(
        self, where: str, index: int, number: int, face: CuttingFace, motion: ToolMotion,
        moved: tuple[float, float, float], accumulated: AccumulatedLoad, sizes: list[float],
    ) -> None:  # fmt: skip
        """Add wedge and sides of one face at `motion`, after the displacement `moved` (x, z, phi)."""
        tool, memory = self._tools[index], self.memory.tools[index]
        turn = motion.angle_rad - tool.reference_angle_rad
        cosine, sine = math.cos(turn), math.sin(turn)
        tip, top = ((cosine * x - sine * z, sine * x + cosine * z) for x, z in (face.tip_m, face.top_m))
        moved = accumulated.at(face, moved)
        ahead, below = accumulated.tip_m(tip)
        depth, tip_x = -(motion.z_m + below), motion.x_m + ahead
        if depth <= 0.0 or not 0.0 < tip_x < self._length_m:
            memory.normal_newton[number] = 0.0
            return
        rake = face.rake_rad - turn
        tall = top[1] - tip[1]
        height = min(tall, depth)
        strength = strength_of(self._values, self._gravity)
        if face.is_share:
            refuse_rake(
                rake, strength.friction, strength.tool_friction, f"{where}: tools.{tool.name}", PhysicsError
            )
        else:
            rake = min(rake, 0.5 * math.pi)  # a shank that leans back is taken as upright
        if rake < 0.5 * math.pi - ROUND_OFF_RAD:
            height = min(height, tip_x * math.tan(rake))  # the part inside the bin
        speed = max(moved[0] - moved[2] * tip[1], 0.0) / self._interval_s
        if self._range is not None and face.is_share:
            self._refuse_beyond(where, tool.name, depth, speed)
        plate = Plate(face.width_m, rake, depth, height)
        failed = self._fails(face, plate, strength, speed)
        up = (failed.by_weight / 3.0 + 0.5 * (1.0 - failed.by_weight)) * height / tall
        arm = (tip[0] + up * (top[0] - tip[0]), tip[1] + up * (top[1] - tip[1]))
        way = (moved[0] - moved[2] * arm[1], moved[1] + moved[2] * arm[0])
        aside = accumulated.aside_m(f"{where}: tools.{tool.name}", face, arm, way)
        delta = strength.tool_friction  # as it acts across the edge
        if aside != 0.0:
            for _ in range(ROUNDS):
                across = across_part(slip_m(rake, failed.beta, way), aside)
                delta = math.atan(across * math.tan(strength.tool_friction))
                weaker = strength._replace(tool_friction=delta, adhesion=across * strength.adhesion)
                failed = self._fails(face, plate, weaker, speed)
        normal = self._press(index, number, face, rake, failed, delta, way, sizes)
        mobilised = normal / (failed.force * math.cos(delta)) if failed.force > 0.0 else 0.0
        if face.is_share and self._values.tip_m > 0.0 and failed.force > 0.0:
            self._bear_tip(face, strength, depth, mobilised, tip, moved, accumulated)
        part = 1.0 if face.is_share else self._values.shank_fraction
        adhesion = part * strength.adhesion * height * face.width_m / math.sin(rake)
        strong = normal * math.tan(strength.tool_friction) + adhesion * min(mobilised, 1.0)
        slip, slow = slip_m(rake, failed.beta, way), SLOWEST_M_PER_S * self._interval_s
        on_face, edge = on_plate(rake, normal, strong, way, slip, aside, slow)
        accumulated.add(face.group, on_face, arm, edge)
        accumulated.count += normal > 0.0
        middle = depth - 0.5 * height
        pressure = (1.0 - math.sin(strength.friction)) * (strength.unit_weight * middle + strength.surcharge)
        side = strength.adhesion + pressure * math.tan(strength.tool_friction)
        side *= 2.0 * part * face.side_m2 * height / tall
        half = 0.5 * height / tall
        centre = (tip[0] + half * (top[0] - tip[0]), tip[1] + half * (top[1] - tip[1]))
        slid = (moved[0] - moved[2] * centre[1], moved[1] + moved[2] * centre[0])
        scale = -side / (math.hypot(*slid) + SLOWEST_M_PER_S * self._interval_s)
        accumulated.add(face.group, (scale * slid[0], scale * slid[1]), centre)

    def _fails(self, face: CuttingFace, plate: Plate, strength: Strength, speed: float) -> Failure:
        """`failure` of a share, or of a shank in the soil that the share has broken."""
        part = 1.0 if face.is_share else self._values.shank_fraction
        if not face.is_share and strength.plane_sides:
            return parted(plate, strength, part)
        failed: Failure = failure(plate, strength, speed)
        return failed._replace(force=failed.force * part)

    def _bear_tip(
        self, face: CuttingFace, strength: Strength, depth: float, mobilised: float,
        tip: tuple[float, float], moved: tuple[float, float, float], accumulated: AccumulatedLoad,
    ) -> None:  # fmt: skip
        """Add the force on a blunt tip: the soil's bearing pressure on its height, as much up as back."""
        pressure, _ = bearing_pressure(strength, depth)
        into = moved[0] - moved[2] * tip[1] - (moved[1] + moved[2] * tip[0])
        if into > 0.0:
            force = mobilised * pressure * face.width_m * self._values.tip_m
            force *= into / (into + SLOWEST_M_PER_S * self._interval_s)
            accumulated.add(face.group, (-force, force), tip)

    def _press(
        self, index: int, number: int, face: CuttingFace, rake: float, failed: Failure, delta: float,
        way: tuple[float, float], sizes: list[float],
    ) -> float:  # fmt: skip
        """Normal force [N] on a plate after the displacement `way` (x, z): a spring up to the wedge's limit.

        The limit is the inertia of P and what the blocks bear of the rest (bearing). Only travel beyond the
        spring's brings blocks nearer to failure, and its speed raises what they bear in proportion (rate). A
        damper makes up for the force that is held over a tick (coupling, k H / 2).
        """
        memory, values = self.memory.tools[index], self._values
        whole = failed.force * math.cos(delta)
        gradual = values.failure == "gradual"
        part = 0.0
        for size, strength, phase in zip(sizes, memory.strength, memory.phase, strict=False):
            part += size * strength * bearing(phase, values.drop, gradual)
        breaks = whole * (1.0 - failed.by_inertia) * part
        bears = breaks + whole * failed.by_inertia
        stiffness = values.bed_modulus_newton_per_m3 * face.area_m2
        into = way[0] * math.sin(rake) + way[1] * math.cos(rake)
        trial = memory.normal_newton[number] + stiffness * into
        slow = values.rate_s_per_m * breaks / self._interval_s  # [N/m], rise of the limit
        beyond = max(trial - bears, 0.0) / (stiffness + slow)
        bears += slow * beyond
        memory.normal_newton[number] = min(max(trial, 0.0), bears)
        normal = min(max(memory.normal_newton[number] + stiffness * into, 0.0), bears)
        if face.is_share and beyond > 0.0 and into > 0.0 and failed.length > 0.0:
            slid = min(beyond, into) / math.sin(rake)
            period = values.period_m or values.period_factor * failed.length
            for block, length in enumerate(memory.length):
                memory.phase[block] += slid / (period * length)
                while memory.phase[block] >= 1.0:
                    memory.phase[block] -= 1.0
                    memory.failed_count[block] += 1
                    self._draw(index, block)
        return normal

    def _block_sizes(self, index: int, motion: ToolMotion) -> list[float]:
        """Part of a tool's wedge that each block is; blocks that it did not have yet are added."""
        tool, memory = self._tools[index], self.memory.tools[index]
        turn, (x, z) = motion.angle_rad - tool.reference_angle_rad, tool.faces[0].tip_m
        depth = -(motion.z_m + math.sin(turn) * x + math.cos(turn) * z)
        sizes = block_sizes(block_number(depth, self._values.block_depth_m))
        for block in range(len(memory.phase), len(sizes)):
            somewhere = np.random.default_rng([self._seed, index, 0, block, 1])
            least = 0.5 if self._values.failure == "gradual" else 0.0
            memory.phase.append(float(somewhere.random()) if block > 0 else least)
            memory.failed_count.append(0)
            memory.strength.append(1.0)
            memory.length.append(1.0)
            self._draw(index, block)
        return sizes

    def _draw(self, index: int, block: int) -> None:
        """Strength and length of a block until it fails: lognormal of mean 1, by seed, tool, count, block."""
        memory, values = self.memory.tools[index], self._values
        length = values.variation if values.length_variation is None else values.length_variation
        if values.variation == 0.0 and length == 0.0:
            return
        random = np.random.default_rng(
            [self._seed, index, memory.failed_count[block], *[block] * (block > 0)]
        )
        sigma = np.array([math.sqrt(math.log1p(part * part)) for part in (values.variation, length)])
        drawn = np.exp(sigma * random.standard_normal(2) - 0.5 * sigma**2).tolist()
        memory.strength[block], memory.length[block] = drawn

    def _roll(
        self, wheel: WheelFace, memory: ToolMemory, motion: ToolMotion, moved: tuple[float, float, float],
        accumulated: AccumulatedLoad,
    ) -> None:  # fmt: skip
        """Add load, resistance and grip of one wheel."""
        sinkage = wheel.radius_m - motion.z_m
        soil = self._values.wheels
        if soil is None or sinkage <= 0.0 or not 0.0 < motion.x_m < self._length_m:
            memory.shear_m = 0.0
            return
        interval = self._interval_s
        sinkage = min(sinkage, wheel.radius_m)
        load = wheel_load_newton(wheel, soil, sinkage)
        steep = load * (soil.exponent + 0.5) / sinkage  # dW / dz
        damping = soil.damping_newton_s_per_m + steep * interval
        upward = max(load - damping * moved[1] / interval, 0.0)
        backward = rolling_resistance_newton(wheel, soil, sinkage) * moved[0]
        backward /= abs(moved[0]) + SLOWEST_M_PER_S * interval
        # shear of the soil where it leaves the contact; rolling on brings fresh soil
        contact = math.sqrt(2.0 * wheel.radius_m * sinkage)
        slid = moved[0] + moved[2] * wheel.radius_m
        memory.shear_m = (memory.shear_m + slid) / (1.0 + abs(moved[0]) / contact)
        top = self._values
        grip = math.copysign(
            grip_newton(wheel, top, upward, sinkage, abs(memory.shear_m) / contact), memory.shear_m
        )
        steep = grip_newton(wheel, top, upward, sinkage, 1e-3) / (1e-3 * contact)
        grip += steep * slid
        most = grip_newton(wheel, top, upward, sinkage, 1e3)
        grip = min(max(grip, -most), most)
        accumulated.add(0, (-backward, upward), (0.0, 0.0))
        accumulated.add(0, (-grip, 0.0), (0.0, -wheel.radius_m))
        accumulated.count += 1

    def _refuse_beyond(self, where: str, tool: str, depth_m: float, speed_m_per_s: float) -> None:
        assert self._range is not None
        for word, unit, value, (_, largest) in (
            ("deep", "m", depth_m, self._range.depth_m),
            ("fast", "m/s", speed_m_per_s, self._range.speed_m_per_s),
        ):
            if value > RANGE_MARGIN * largest:
                raise PhysicsError(
                    f"{where}: tools.{tool} is {value:.3g} {unit} {word}, the soil file was fitted up to "
                    f"{largest:.3g} {unit} and is taken up to {RANGE_MARGIN:g} times that; fit it further, "
                    "or add allow: [beyond_fitted_range]"
                )


def _memory(tool: _Tool, motion: ToolMotion) -> ToolMemory:
    """State of the soil at a tool that begins to move from `motion`."""
    x, y, z = motion.position_m
    normal = [0.0] * len(tool.faces)
    if tool.in_space:
        return MemoryInSpace(x, z, 0.0, normal, y_m=y, quaternion=list(motion.quaternion))
    return ToolMemory(x, z, motion.angle_rad, normal)
