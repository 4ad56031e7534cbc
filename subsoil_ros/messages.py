"""Records that the parts of a run exchange: one frozen record per message of subsoil_msgs.

The direct run passes these objects on; nodes exchange the bytes of their messages
(recording/message_codec.py), so all modes exchange the same values. A field here has the name and the place
of the field of its .msg file. Floats are float64. World axes
(x forward, y left, z up); planar angles (`angle_rad`) are counter-clockwise seen with x
right and z up, rotations about -y. A wrench acts on the body, about its centre of mass.
"""

import math
from dataclasses import dataclass, field
from enum import IntEnum

from .errors import ProtocolError
from .rotations import Quaternion, Vector, is_unit, planar_quaternion, rotation_between


class Command(IntEnum):
    """Command of a Grant. Values as in Grant.msg."""

    RUN = 0
    END = 1
    ABORT = 2
    CHECKPOINT = 3  # all participants stand at the end of the tick named: write a checkpoint of it


class NodeState(IntEnum):
    """State of a node. Values as in NodeStatus.msg."""

    STARTING = 0
    READY = 1
    RUNNING = 2
    ENDED = 3
    FAULT = 4
    PAUSED = 5  # the coupler only


@dataclass(frozen=True, slots=True)
class Head:
    """The start of most messages."""

    run_id: str
    tick: int
    end_time_ns: int  # simulated time at the end of the tick


@dataclass(frozen=True, slots=True)
class ToolMotion:
    """Pose and twist of a tool's body at its centre of mass, at the end of a tick; in the plane of travel.

    Where motions are predicted (`Scene.predicts_motion`), the twist is that at the start of the tick.

    Readers of planar motion use the angle, readers of motion in space the quaternion.
    """

    tool: str
    x_m: float
    y_m: float  # lateral offset of the tool, constant
    z_m: float
    angle_rad: float  # not wrapped: a wheel turns past pi
    velocity_x_m_per_s: float
    velocity_z_m_per_s: float
    angular_velocity_rad_per_s: float

    @property
    def position_m(self) -> Vector:
        """Centre of mass, world axes."""
        return (self.x_m, self.y_m, self.z_m)

    @property
    def quaternion(self) -> Quaternion:
        """Orientation (x, y, z, w)."""
        return planar_quaternion(self.angle_rad)

    @property
    def velocity_m_per_s(self) -> Vector:
        """Velocity of the centre of mass, world axes."""
        return (self.velocity_x_m_per_s, 0.0, self.velocity_z_m_per_s)

    @property
    def spin_rad_per_s(self) -> Vector:
        """Angular velocity, world axes."""
        return (0.0, -self.angular_velocity_rad_per_s, 0.0)


@dataclass(frozen=True, slots=True)
class SpatialMotion(ToolMotion):
    """Motion of a tool in six degrees of freedom.

    `angle_rad` is NaN, in messages too: it distinguishes this kind from planar motion, and code that takes it
    for a planar angle gets NaN. `angular_velocity_rad_per_s` is minus the angular velocity about y.
    """

    velocity_y_m_per_s: float
    quaternion_x: float
    quaternion_y: float
    quaternion_z: float
    quaternion_w: float
    angular_velocity_x_rad_per_s: float
    angular_velocity_z_rad_per_s: float

    def __post_init__(self) -> None:
        if not is_unit(self.quaternion):
            raise ProtocolError(
                f"tool_motions: tool {self.tool}: the orientation {self.quaternion} (x, y, z, w) is no unit "
                "quaternion, which a motion in space (angle_rad: NaN) needs"
            )

    @classmethod
    def of(
        cls, tool: str, position_m: Vector, quaternion: Quaternion, velocity: Vector, spin: Vector
    ) -> "SpatialMotion":
        """From position [m], orientation (x, y, z, w), velocity [m/s] and angular velocity [rad/s].

        Raises:
            ProtocolError: the quaternion is not of length 1.
        """
        x, y, z = map(float, position_m)
        vx, vy, vz = map(float, velocity)
        wx, wy, wz = map(float, spin)
        qx, qy, qz, qw = map(float, quaternion)
        return cls(tool, x, y, z, math.nan, vx, vz, -wy, vy, qx, qy, qz, qw, wx, wz)

    @property
    def quaternion(self) -> Quaternion:
        """Orientation (x, y, z, w)."""
        return (self.quaternion_x, self.quaternion_y, self.quaternion_z, self.quaternion_w)

    @property
    def velocity_m_per_s(self) -> Vector:
        """Velocity of the centre of mass, world axes."""
        return (self.velocity_x_m_per_s, self.velocity_y_m_per_s, self.velocity_z_m_per_s)

    @property
    def spin_rad_per_s(self) -> Vector:
        """Angular velocity, world axes."""
        return (
            self.angular_velocity_x_rad_per_s,
            self.angular_velocity_y_rad_per_s,
            self.angular_velocity_z_rad_per_s,
        )

    @property
    def angular_velocity_y_rad_per_s(self) -> float:
        """Angular velocity about y, world axes."""
        return -self.angular_velocity_rad_per_s


def motion_of(
    tool: str,
    position_m: Vector,
    quaternion: Quaternion,
    velocity_m_per_s: Vector,
    spin_rad_per_s: Vector,
    angle_rad: float,
) -> ToolMotion:
    """Return the motion of these values; it is one in space if angle_rad is NaN.

    Raises:
        ProtocolError: it is one in space, and the quaternion is not of length 1.
    """
    if math.isnan(angle_rad):
        return SpatialMotion.of(tool, position_m, quaternion, velocity_m_per_s, spin_rad_per_s)
    x_m, y_m, z_m = position_m
    return ToolMotion(
        tool, x_m, y_m, z_m, angle_rad, velocity_m_per_s[0], velocity_m_per_s[2], -spin_rad_per_s[1]
    )


@dataclass(frozen=True, slots=True)
class ToolMotions(Head):
    """All tools, in scene order, at the end of a tick (INITIAL_TICK: before the run)."""

    tools: tuple[ToolMotion, ...]


def work_joule(force: Vector, torque: Vector, before: ToolMotion, after: ToolMotion) -> float:
    """Work of a force [N] and a torque [N m] about the centre of mass while a tool moves between two poses.

    In the plane, of what acts in the plane.
    """
    work = force[0] * (after.x_m - before.x_m) + force[2] * (after.z_m - before.z_m)
    if isinstance(after, SpatialMotion):
        turn = rotation_between(before.quaternion, after.quaternion)
        work += force[1] * (after.y_m - before.y_m)
        return work + torque[0] * turn[0] + torque[1] * turn[1] + torque[2] * turn[2]
    return work - torque[1] * (after.angle_rad - before.angle_rad)


@dataclass(frozen=True, slots=True)
class FacetGroupForce:
    """Force of the soil on one facet group of a tool (share, blade, ...), mean over the tick."""

    group: str
    force_x_newton: float
    force_y_newton: float
    force_z_newton: float


@dataclass(frozen=True, slots=True)
class ToolWrench:
    """Soil on tool: force, torque about the body's centre of mass, mean or end of the tick."""

    tool: str
    force_x_newton: float
    force_y_newton: float
    force_z_newton: float
    torque_x_newton_m: float
    torque_y_newton_m: float
    torque_z_newton_m: float
    work_joule: float  # done by the soil on the tool in this tick, summed soil step by soil step
    contact_count: int
    groups: tuple[FacetGroupForce, ...] = ()


@dataclass(frozen=True, slots=True)
class ToolWrenches(Head):
    """The soil's answer to ToolMotions of the same tick."""

    tools: tuple[ToolWrench, ...]


@dataclass(frozen=True, slots=True)
class LostParticle:
    """A particle that left the domain, and the position where this was first detected, world axes."""

    identity: int
    x_m: float
    y_m: float
    z_m: float
    tick: int


@dataclass(frozen=True, slots=True)
class SoilState(Head):
    """Monitors of the soil at the end of a tick (every record.series_ticks ticks); 0 without particles."""

    particle_count: int = 0
    contact_count: int = 0
    lost_particle_count: int = 0  # left the domain since the start
    broken_bond_count: int = 0  # since the start
    rebuild_count: int = 0  # neighbour lists built since the start
    kinetic_energy_joule: float = 0.0  # translation and rotation
    rms_speed_m_per_s: float = 0.0
    rms_angular_velocity_rad_per_s: float = 0.0
    max_overlap_m: float = 0.0
    max_tool_overlap_m: float = 0.0
    lost_particles: tuple[LostParticle, ...] = ()  # the first three


@dataclass(frozen=True, slots=True)
class BodyState:
    """A body's centre of mass: position, velocity, acceleration."""

    name: str
    x_m: float
    z_m: float
    angle_rad: float
    velocity_x_m_per_s: float
    velocity_z_m_per_s: float
    angular_velocity_rad_per_s: float
    acceleration_x_m_per_s2: float
    acceleration_z_m_per_s2: float
    angular_acceleration_rad_per_s2: float


@dataclass(frozen=True, slots=True)
class JointReaction:
    """Force and moment of a joint on its second body (body_b), at the joint point, world axes.

    For a driver it is the driver's force (or moment) on the driven body.
    """

    name: str
    force_x_newton: float
    force_z_newton: float
    moment_newton_m: float  # about the joint point, in the sense of angle_rad
    unique: bool = True  # False: redundant constraints, the minimum-norm share is given


@dataclass(frozen=True, slots=True)
class ForceState:
    """Coordinate, rate and load of a force element; the units depend on its kind.

    In m, m/s and N: spring_damper (length, rate, axial force, compression positive), wheel_contact
    (penetration, rate, normal force), coordinate_spring on x or z, and JOINT.friction and JOINT.stops of a
    prismatic joint or a point on a line (distance, rate, force on body_b along the axis). In rad, rad/s and
    N m: torsion_spring (angle, rate, moment on body_b), coordinate_spring on an angle, and JOINT.friction and
    JOINT.stops of a revolute joint.
    """

    name: str
    coordinate: float  # m or rad
    rate: float  # m/s or rad/s
    load: float  # N or N m


@dataclass(frozen=True, slots=True)
class MechanismState(Head):
    """The whole mechanism at the end of a tick."""

    draft_newton: float  # force of the draft driver along +x
    kinetic_energy_joule: float
    gravity_energy_joule: float  # zero at z = 0
    spring_energy_joule: float
    dissipated_joule: float  # by dampers, wheel contacts, friction, since the start
    driver_work_joule: float  # by all drivers on the machine, since the start
    external_work_joule: float  # by the soil's wrenches and prescribed loads, since the start
    position_residual_m: float  # largest violation of a position constraint
    velocity_residual_m_per_s: float
    energy_residual_joule: float  # energy gained by integration errors since the start
    part_count: int  # parts of steps since the start, taken to meet mechanism.tolerance
    bodies: tuple[BodyState, ...] = ()
    joints: tuple[JointReaction, ...] = ()
    forces: tuple[ForceState, ...] = ()


@dataclass(frozen=True, slots=True)
class CouplingReport(Head):
    """Interface account of a tick, by the coupler."""

    mechanism_work_joule: float  # of the wrench that moved it; this tick, or where predicted the one before
    soil_work_joule: float  # as the soil summed it, in the same tick
    residual_joule: float  # cumulative mechanism - soil
    absolute_work_joule: float  # cumulative sum of |soil work|
    residual_ratio: float  # |residual| / absolute work; 0 while no work was done
    wall_time_s: float  # since tick 0, without pauses; differs between runs


@dataclass(frozen=True, slots=True)
class Grant:
    """The coupler's permission to advance up to and including `tick`, or the end of the run."""

    run_id: str
    tick: int
    command: Command = Command.RUN
    reason: str = ""


@dataclass(frozen=True, slots=True)
class DriverCommand:
    """A controller's command: the speed a driver is to reach, from the start of `tick` on."""

    run_id: str
    tick: int
    driver: str
    speed: float  # m/s, or rad/s for an angle


@dataclass(frozen=True, slots=True)
class TickAck:
    """The recorder has taken every lockstep message up to and including `tick`."""

    run_id: str
    tick: int


@dataclass(frozen=True, slots=True)
class NodeStatus:
    """Identity, run and state of a node; sent at the start and as heartbeat."""

    run_id: str
    node: str
    state: NodeState
    scene_hash: str  # resolved scene with mesh and bed bytes
    package_version: str
    message_hashes: tuple[str, ...]  # "Grant RIHS01_..." of every message of subsoil_msgs
    capabilities: tuple[str, ...]  # optional parts of the protocol that the node supports
    process_id: int
    tick: int  # last tick this node has finished
    message: str = ""  # the fault, in one line
    initial_motions: tuple[ToolMotion, ...] = ()  # from the source of motion
    initial_wrenches: tuple[ToolWrench, ...] = ()  # from the soil: its answer to initial_motions
    exit_status: int = 0  # of a node in FAULT: 2 bad input, 3 a failed run


@dataclass(frozen=True, slots=True)
class SoilCloud:
    """Particles for visualization: positions [m] (n, 3) and speeds [m/s] (n,), float32 arrays.

    identities (n,) uint32, unique for ever, where particles come and go (soil.window); else None.
    broken_parts (n,) float32: part of each particle's bonds that broke (soil.bonds); else None.
    radii_m (n,) float32, where particles have several sizes; else None.
    materials (n,) uint32: number of the layer, with layers; else None.
    """

    tick: int
    end_time_ns: int
    positions_m: object = field(repr=False)
    speeds_m_per_s: object = field(repr=False)
    identities: object = field(default=None, repr=False)
    broken_parts: object = field(default=None, repr=False)
    radii_m: object = field(default=None, repr=False)
    materials: object = field(default=None, repr=False)


RunRecord = (
    Grant
    | DriverCommand
    | ToolMotions
    | ToolWrenches
    | MechanismState
    | SoilState
    | CouplingReport
    | SoilCloud
    | TickAck
    | NodeStatus
)
"""A record that a message carries."""
