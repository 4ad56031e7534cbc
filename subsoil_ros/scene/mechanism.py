"""A planar machine: bodies, joints and forces, all given in one reference pose in world axes."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Finite, NonNegative, Part, Point, Positive
from .laws import Law

GROUND = "ground"


class Body(Part):
    """A rigid body of the plane y = 0, given by its centre of mass in the reference pose."""

    mass_kg: Positive
    inertia_kg_m2: Positive  # about the centre of mass
    position_m: Point
    angle_rad: Finite = 0.0
    # Initial velocities are made consistent with the constraints. What is not given follows from the
    # rest: bodies move along with the drivers of x and z.
    velocity_m_per_s: Point | None = None
    angular_velocity_rad_per_s: Finite | None = None


class Revolute(Part):
    """Two bodies share a point."""

    kind: Literal["revolute"]
    body_a: str
    body_b: str
    point_m: Point  # used for both bodies unless point_b_m is given
    point_b_m: Point | None = None


class Prismatic(Part):
    """body_b slides along a line fixed in body_a and does not turn against it."""

    kind: Literal["prismatic"]
    body_a: str
    body_b: str
    point_m: Point
    axis: Point  # direction of the line in world axes, any length but zero


class Fixed(Part):
    """body_b is welded to body_a."""

    kind: Literal["fixed"]
    body_a: str
    body_b: str
    point_m: Point


class Driver(Part):
    """Prescribes the speed of one coordinate of a body: x, z (m/s) or angle (rad/s) in world axes."""

    kind: Literal["driver"]
    body: str
    coordinate: Literal["x", "z", "angle"]
    speed: Law  # m/s or rad/s; the coordinate starts from its initial value


Joint = Annotated[Revolute | Prismatic | Fixed | Driver, Field(discriminator="kind")]


class SpringDamper(Part):
    """Linear spring and damper between two points; its force is positive in compression."""

    kind: Literal["spring_damper"]
    body_a: str
    point_a_m: Point
    body_b: str
    point_b_m: Point
    stiffness_newton_per_m: NonNegative
    damping_newton_s_per_m: NonNegative = 0.0
    free_length_m: Positive


class CoordinateSpring(Part):
    """Spring and damper on one coordinate of a body against a law of time.

    force = stiffness (law(t) - q) + damping (d law/dt - dq/dt); with `only` it acts one way, as a
    chain that lowers an implement does: "pull_up" lets only positive force through.
    """

    kind: Literal["coordinate_spring"]
    body: str
    coordinate: Literal["x", "z", "angle"]
    target: Law  # m or rad
    stiffness_newton_per_m: NonNegative  # N m/rad for an angle
    damping_newton_s_per_m: NonNegative = 0.0
    only: Literal["both", "pull_up", "push_down"] = "both"


class PointLoad(Part):
    """A prescribed force and moment at a point fixed in the body, along world axes."""

    kind: Literal["point_load"]
    body: str
    point_m: Point
    force_x_newton: Law | None = None
    force_z_newton: Law | None = None
    moment_newton_m: Law | None = None


class WheelContact(Part):
    """A wheel on level ground: unilateral spring-damper and regularised Coulomb friction."""

    kind: Literal["wheel_contact"]
    body: str
    radius_m: Positive
    ground_z_m: Finite = 0.0
    stiffness_newton_per_m: Positive
    damping_newton_s_per_m: NonNegative
    friction: NonNegative
    slip_speed_m_per_s: Positive = 0.02  # chosen: friction reaches 76 % of its limit at this slip


Force = Annotated[SpringDamper | CoordinateSpring | PointLoad | WheelContact, Field(discriminator="kind")]


class InitialState(Part):
    """How the run starts from the reference pose.

    The machine is moved by `translate_x_m`, the named coordinates (`BODY.x_m|z_m|angle_rad`) are
    held at their values while the others are projected onto the constraints, and with
    `static_equilibrium` the remaining freedoms go to rest under gravity, springs and wheel contact.
    """

    translate_x_m: Finite = 0.0
    coordinates: dict[str, Finite] = {}
    static_equilibrium: bool = False


class Mechanism(Part):
    """The machine. Order of bodies, joints and forces is the order of the file."""

    bodies: dict[str, Body] = Field(min_length=1)
    joints: dict[str, Joint] = {}
    forces: dict[str, Force] = {}
    draft_driver: str | None = None  # the joint whose x force is the draft
    initial: InitialState = InitialState()
    integrator_order: Literal[2, 3, 4] = 4  # of Adams-Moulton

    @model_validator(mode="after")
    def _names(self) -> "Mechanism":
        if GROUND in self.bodies:
            raise ValueError(f"bodies: '{GROUND}' is the world itself and cannot be a body")
        known = [*self.bodies, GROUND]
        for section, items in (("joints", self.joints), ("forces", self.forces)):
            for name, item in items.items():
                for key in ("body", "body_a", "body_b"):
                    body = getattr(item, key, None)
                    if body is not None and body not in known:
                        raise ValueError(
                            f"{section}.{name}.{key}: no body '{body}'; bodies are {', '.join(known)}"
                        )
                    if body == GROUND and key == "body":
                        raise ValueError(f"{section}.{name}.body: the ground cannot be loaded or driven")
                if getattr(item, "body_a", 0) == getattr(item, "body_b", 1):
                    raise ValueError(f"{section}.{name}: body_a and body_b are the same body")
                axis = getattr(item, "axis", None)
                if axis == (0.0, 0.0):
                    raise ValueError(f"{section}.{name}.axis: has no direction")
        for key in self.initial.coordinates:
            body, _, coordinate = key.rpartition(".")
            if body not in self.bodies or coordinate not in ("x_m", "z_m", "angle_rad"):
                raise ValueError(f"initial.coordinates: '{key}' is not BODY.x_m, BODY.z_m or BODY.angle_rad")
        driver = self.draft_driver
        if driver is not None and getattr(self.joints.get(driver), "kind", None) != "driver":
            raise ValueError(f"draft_driver: no driver joint '{driver}'")
        return self
