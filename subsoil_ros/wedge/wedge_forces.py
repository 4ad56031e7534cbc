"""Forces of the soil on the plates of one tool within a tick, in the plane or with yaw, and on a wheel.

Yaw: docs/wedge.md, after S.A. Miedema, The Delft Sand, Clay & Rock Cutting Model (2019), section 3.6, the
snow-plough effect. There the soil follows the blade along its edge as far as the friction of the failure
plane allows. Here the soil beside a plate of limited width prevents that, so iota is the largest possible.

A rigid wheel has its load from pressure and sinkage, resistance from compaction, grip from shear: M.G.
Bekker, Introduction to Terrain-Vehicle Systems (1969); J.Y. Wong, Theory of Ground Vehicles (2001), chapter
2; Z. Janosi, B. Hanamoto, Proc. 1st Int. Conf. Mechanics of Soil-Vehicle Systems (1961).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from ..errors import PhysicsError
from ..loading.soil_file import refuse_yaw
from ..messages import FacetGroupForce, SpatialMotion, ToolMotion, ToolWrench
from ..rotations import LevelAxes, Quaternion, Vector, dot, level_axes, rotation_between
from ..scene.tool_faces import CuttingFace, WheelFace
from ..scene.wedge_soil import WedgeValues, WheelSoil
from .failure_wedge import Strength


def strength_of(values: WedgeValues, gravity: float) -> Strength:
    """Strength of soil with these values; gravity [m/s2]."""
    return Strength(
        values.density_kg_per_m3 * gravity, values.density_kg_per_m3, values.cohesion_pa,
        values.friction_angle_rad, values.adhesion_pa, values.tool_friction_angle_rad, values.surcharge_pa,
        values.speed_factor, values.theory == "perumpral",
    )  # fmt: skip


DRIFT_M_PER_S = 0.01
"""Speed of a plate below which its yaw is not checked: a machine at rest sways that slowly."""

SLOWEST_M_PER_S = 1e-3
"""Speed below which resistance and slip go to zero with it, so that no force pushes a standing wheel."""

Pair = tuple[float, float]
"""Components along x and z."""


@dataclass
class AccumulatedLoad:
    """Sums of the forces in one tick on a tool in the plane of travel."""

    groups: list[list[float]]  # force x, z of each group
    torque: float = 0.0  # about y
    count: int = 0

    def add(self, group: int, force: Pair, arm: Pair, aside: float = 0.0) -> None:
        """Add a force [N] at `arm` [m] from the body's centre of mass."""
        self.groups[group][0] += force[0]
        self.groups[group][1] += force[1]
        self.torque += arm[1] * force[0] - arm[0] * force[1]

    def at(self, face: CuttingFace, moved: tuple[float, float, float]) -> tuple[float, float, float]:
        """Displacement of the middle of a plate's width (x, z, phi), from that of the body."""
        return moved

    def tip_m(self, tip: Pair) -> Pair:
        """World x and z of a point from the body's centre of mass."""
        return tip

    def aside_m(self, place: str, face: CuttingFace, arm: Pair, way: Pair) -> float:
        """Displacement of the plate along its own edge."""
        return 0.0

    def wrench(self, name: str, groups: Sequence[str], moved: tuple[float, float, float]) -> ToolWrench:
        """The sums as a wrench; work is force times displacement in this tick, exactly."""
        fx = sum(force[0] for force in self.groups)
        fz = sum(force[1] for force in self.groups)
        parts = tuple(
            FacetGroupForce(name, force[0], 0.0, force[1])
            for name, force in zip(groups, self.groups, strict=True)
        )
        work = fx * moved[0] + fz * moved[1] - self.torque * moved[2]
        return ToolWrench(name, fx, 0.0, fz, 0.0, self.torque, 0.0, work, self.count, parts)


@dataclass
class AccumulatedInSpace(AccumulatedLoad):
    """Sums in the axes of a tool in space: x level and across its edge, y along it, z up."""

    axes: LevelAxes = field(kw_only=True)
    way: Vector = field(kw_only=True)  # of the centre of mass in this tick
    turn: Vector = field(kw_only=True)  # rotation vector of this tick
    interval_s: float = field(kw_only=True)
    torques: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    middle_m: float = 0.0  # y of the plate that acts

    @classmethod
    def of(
        cls, groups: int, before: tuple[Vector, Quaternion], motion: SpatialMotion, interval_s: float
    ) -> tuple["AccumulatedInSpace", ToolMotion, tuple[float, float, float]]:
        """Return the sums, and the motion in the plane across the edge: pose and displacement (x, z, phi)."""
        axes, (x, y, z), then = level_axes(motion.quaternion), motion.position_m, before[0]
        way = axes.of((x - then[0], y - then[1], z - then[2]))
        turn = axes.of(rotation_between(before[1], motion.quaternion))
        planar = ToolMotion(motion.tool, motion.x_m, motion.y_m, motion.z_m, axes.pitch_rad, 0.0, 0.0, 0.0)
        accumulated = cls(
            [[0.0, 0.0, 0.0] for _ in range(groups)], axes=axes, way=way, turn=turn, interval_s=interval_s
        )
        return accumulated, planar, (way[0], way[2], -turn[1])

    def add(self, group: int, force: Pair, arm: Pair, aside: float = 0.0) -> None:
        """Add a force [N] with its part along the edge."""
        x, y, z = arm[0], self.middle_m, arm[1]
        whole = (force[0], aside, force[1])
        for place, part in enumerate(whole):
            self.groups[group][place] += part
        self.torques[0] += y * force[1] - z * aside
        self.torques[1] += z * force[0] - x * force[1]
        self.torques[2] += x * aside - y * force[0]

    def at(self, face: CuttingFace, moved: tuple[float, float, float]) -> tuple[float, float, float]:
        """Displacement of the middle of a plate's width (x, z, phi), from that of the body."""
        self.middle_m = y = face.middle_m
        return moved[0] - self.turn[2] * y, moved[1] + self.turn[0] * y, moved[2]

    def tip_m(self, tip: Pair) -> Pair:
        """World x and z of a point in the middle of a plate's width, from the body's centre of mass."""
        x, _, z = self.axes.world((tip[0], self.middle_m, tip[1]))
        return x, z

    def aside_m(self, place: str, face: CuttingFace, arm: Pair, way: Pair) -> float:
        """Displacement of the plate along its own edge.

        Raises:
            PhysicsError: the yaw is larger than the theory covers.
        """
        aside = self.way[1] + self.turn[2] * arm[0] - self.turn[0] * arm[1]
        fast = math.hypot(aside, way[0]) > DRIFT_M_PER_S * self.interval_s
        yaw = math.atan2(aside, abs(way[0])) if fast else 0.0
        refuse_yaw(yaw, self.axes.roll_rad, face, place, PhysicsError)
        return aside

    def wrench(self, name: str, groups: Sequence[str], moved: tuple[float, float, float]) -> ToolWrench:
        """The sums as a wrench in world axes."""
        whole = (
            sum(v[0] for v in self.groups),
            sum(v[1] for v in self.groups),
            sum(v[2] for v in self.groups),
        )
        torque = (self.torques[0], self.torques[1], self.torques[2])
        work = dot(whole, self.way) + dot(torque, self.turn)
        parts = tuple(
            FacetGroupForce(group, *self.axes.world((x, y, z)))
            for group, (x, y, z) in zip(groups, self.groups, strict=True)
        )
        return ToolWrench(name, *self.axes.world(whole), *self.axes.world(torque), work, self.count, parts)


def slip_m(rake: float, beta: float, way: Pair) -> float:
    """Sliding of a plate under its wedge, up the face; where it presses: way.t - way.n cot(alpha + beta)."""
    n, t = (math.sin(rake), math.cos(rake)), (math.cos(rake), -math.sin(rake))
    into, along = way[0] * n[0] + way[1] * n[1], way[0] * t[0] + way[1] * t[1]
    return along - into / math.tan(rake + beta) if into > 0.0 else along


def across_part(slip: float, aside: float) -> float:
    """cos(iota): part of the friction at a plate that acts across its edge."""
    whole = math.hypot(slip, aside)
    return abs(slip) / whole if whole > 0.0 else 1.0


def on_plate(
    rake: float, normal: float, strong: float, way: Pair, slip: float, aside: float, slow_m: float
) -> tuple[Pair, float]:
    """Force of the soil on a plate (x, z), and along its edge: normal, and `strong` against the sliding.

    Sliding is `slip` up the face and `aside` along the edge. The soil is passive: a force that would do work
    on the tool is left out.
    """
    n, t = (math.sin(rake), math.cos(rake)), (math.cos(rake), -math.sin(rake))
    into, along = way[0] * n[0] + way[1] * n[1], way[0] * t[0] + way[1] * t[1]
    size = (math.hypot(slip, aside) if aside else abs(slip)) + slow_m
    shear, edge = strong * slip / size, strong * aside / size
    if into > 0.0 and normal * into + shear * along + edge * aside < 0.0:
        shear = edge = 0.0
    return (-normal * n[0] - shear * t[0], -normal * n[1] - shear * t[1]), -edge


def wheel_load_newton(wheel: WheelFace, soil: WheelSoil, sinkage_m: float) -> float:
    """W = b k sqrt(D) z^(n + 1/2) (3 - n) / 3, with k = k_c / b + k_phi (Bekker; Wong eq. 2.78).

    It follows from the pressure p = k z^n on the front of the rim, whose arc is taken as a parabola.
    """
    n = soil.exponent
    k = soil.cohesive_modulus / wheel.width_m + soil.frictional_modulus
    return wheel.width_m * k * math.sqrt(2.0 * wheel.radius_m) * sinkage_m ** (n + 0.5) * (3.0 - n) / 3.0


def rolling_resistance_newton(wheel: WheelFace, soil: WheelSoil, sinkage_m: float) -> float:
    """R = (1 - recovered) b k z^(n + 1) / (n + 1): compaction per length (Bekker; Wong eq. 2.76)."""
    n = soil.exponent
    k = soil.cohesive_modulus / wheel.width_m + soil.frictional_modulus
    return (1.0 - soil.recovered_fraction) * wheel.width_m * k * sinkage_m ** (n + 1.0) / (n + 1.0)


def grip_newton(
    wheel: WheelFace, values: WedgeValues, load_newton: float, sinkage_m: float, slip: float
) -> float:
    """Shear force at the tread, (b L c + W tan phi) (1 - (1 - e^-x) / x), x = slip L / K (Wong eq. 2.86).

    L = sqrt(D z) is the length in contact. `slip` is without sign.
    """
    assert values.wheels is not None
    length = math.sqrt(2.0 * wheel.radius_m * sinkage_m)
    x = slip * length / values.wheels.shear_deformation_m
    mobilised = 0.5 * x if x < 1e-6 else 1.0 - (1.0 - math.exp(-x)) / x
    strength = wheel.width_m * length * values.cohesion_pa
    return (strength + load_newton * math.tan(values.friction_angle_rad)) * mobilised
