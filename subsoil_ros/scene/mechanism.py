"""A planar machine: bodies, joints and forces, all given in one reference pose in world axes."""

import itertools
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..strict_model import Finite, Name, NonNegative, Point, Positive, StrictModel
from .time_laws import Law

GROUND = "ground"


STICKS = (
    "left out: friction grows with the speed and creeps. Given: Coulomb's law, a spring and damper up to the "
    "limit, then sliding at the limit, without creep; slip_speed is not used."
)


def check_stick(part: StrictModel, stiffness: str, damping: str) -> None:
    """Refuse stick damping without stick stiffness; the arguments are the units in the keys."""
    if (
        getattr(part, f"stick_damping_{damping}") > 0.0
        and getattr(part, f"stick_stiffness_{stiffness}") is None
    ):
        raise ValueError(f"stick_damping_{damping} needs a stick_stiffness_{stiffness}")


class RotationFriction(StrictModel):
    """Moment (preload + coefficient * radius * force in the pin) * tanh(turning speed / slip speed)."""

    preload_newton_m: NonNegative = Field(0.0, description="limit without a force in the pin.")
    coefficient: NonNegative = Field(0.0, description="of the force in the pin; needs radius_m.")
    radius_m: NonNegative = Field(0.0, description="of the pin.")
    slip_speed_rad_per_s: Positive = Field(0.01, description="at which friction reaches 76 % of its limit.")
    stick_stiffness_newton_m_per_rad: Positive | None = Field(None, description=STICKS)
    stick_damping_newton_m_s_per_rad: NonNegative = Field(0.0, description="while it sticks.")

    @model_validator(mode="after")
    def _whole(self) -> "RotationFriction":
        if (self.coefficient > 0.0) != (self.radius_m > 0.0):
            raise ValueError("coefficient and radius_m are needed together")
        check_stick(self, "newton_m_per_rad", "newton_m_s_per_rad")
        return self


class TranslationFriction(StrictModel):
    """Force (preload + coefficient * force across the line) * tanh(sliding speed / slip speed)."""

    preload_newton: NonNegative = Field(0.0, description="limit without a force across the line.")
    coefficient: NonNegative = Field(0.0, description="of the force across the line.")
    slip_speed_m_per_s: Positive = Field(0.01, description="at which friction reaches 76 % of its limit.")
    stick_stiffness_newton_per_m: Positive | None = Field(None, description=STICKS)
    stick_damping_newton_s_per_m: NonNegative = Field(0.0, description="while it sticks.")

    @model_validator(mode="after")
    def _whole(self) -> "TranslationFriction":
        check_stick(self, "newton_per_m", "newton_s_per_m")
        return self


class Body(StrictModel):
    """A rigid body of the plane y = 0, given by its centre of mass in the reference pose."""

    mass_kg: Positive
    inertia_kg_m2: Positive = Field(description="about the centre of mass.")
    position_m: Point = Field(description="(x, z) of the centre of mass in the reference pose, world axes.")
    angle_rad: Finite = Field(0.0, description="in the reference pose.")
    velocity_m_per_s: Point | None = Field(
        None,
        description="at the start; made consistent with the constraints. Left out, it follows from those "
        "given: bodies move along with the drivers of x and z.",
    )
    angular_velocity_rad_per_s: Finite | None = Field(None, description="at the start, likewise.")


class RotationStops(StrictModel):
    """Ends of the rotation of body_b against body_a, zero in the reference pose: one-sided spring-dampers."""

    lower_rad: Finite | None = Field(None, description="left out: no lower stop.")
    upper_rad: Finite | None = Field(None, description="left out: no upper stop.")
    stiffness_newton_m_per_rad: Positive
    damping_newton_m_s_per_rad: NonNegative = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> "RotationStops":
        _check_ends("rad", self.lower_rad, self.upper_rad)
        return self


class TranslationStops(StrictModel):
    """Ends of a translation or of a length: one-sided spring-dampers."""

    lower_m: Finite | None = Field(None, description="left out: no lower stop.")
    upper_m: Finite | None = Field(None, description="left out: no upper stop.")
    stiffness_newton_per_m: Positive
    damping_newton_s_per_m: NonNegative = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> "TranslationStops":
        _check_ends("m", self.lower_m, self.upper_m)
        return self


def _check_ends(unit: str, lower: float | None, upper: float | None) -> None:
    if lower is None and upper is None:
        raise ValueError(f"give lower_{unit}, upper_{unit} or both")
    if lower is not None and upper is not None and upper <= lower:
        raise ValueError(f"upper_{unit} {upper} must be larger than lower_{unit} {lower}")


class Revolute(StrictModel):
    """Two bodies share a point."""

    kind: Literal["revolute"]
    body_a: str = Field(description="a body, or `ground`.")
    body_b: str
    point_m: Point = Field(
        description="(x, z) of the pin in the reference pose; of body_a alone if point_b_m is given."
    )
    point_b_m: Point | None = Field(
        None, description="the pin on body_b in the reference pose; bodies are moved until both points meet."
    )
    friction: RotationFriction | None = None
    stops: RotationStops | None = None


class Prismatic(StrictModel):
    """body_b slides along a line fixed in body_a and does not turn against it."""

    kind: Literal["prismatic"]
    body_a: str = Field(description="a body, or `ground`.")
    body_b: str
    point_m: Point = Field(description="of the line, in the reference pose.")
    axis: Point = Field(description="direction of the line in world axes, any length but zero.")
    friction: TranslationFriction | None = None
    stops: TranslationStops | None = Field(
        None, description="of the translation along the axis, zero in the reference pose."
    )


class PointOnLine(StrictModel):
    """A point of body_b slides along a line fixed in body_a; body_b is free to turn."""

    kind: Literal["point_on_line"]
    body_a: str = Field(description="a body, or `ground`.")
    body_b: str
    point_m: Point = Field(description="of body_b, and of the line in the reference pose.")
    axis: Point = Field(description="direction of the line in world axes, any length but zero.")
    friction: TranslationFriction | None = None
    stops: TranslationStops | None = Field(
        None, description="of the translation along the axis, zero in the reference pose."
    )


class Fixed(StrictModel):
    """body_b is welded to body_a."""

    kind: Literal["fixed"]
    body_a: str = Field(description="a body, or `ground`.")
    body_b: str
    point_m: Point


class Driver(StrictModel):
    """Prescribes the speed of one coordinate of a body: x, z (m/s) or angle (rad/s).

    Absolute: in world axes. With `relative_to`: the angle against that body, or the translation of the
    centre of mass along the x or z axis fixed in that body (those of the world in the reference pose).
    """

    kind: Literal["driver"]
    body: str
    coordinate: Literal["x", "z", "angle"]
    speed: Law = Field(description="m/s or rad/s; the coordinate starts from its initial value.")
    relative_to: str | None = Field(None, description="a body; left out: the world.")


Joint = Annotated[Revolute | Prismatic | PointOnLine | Fixed | Driver, Field(discriminator="kind")]


class ForceTable(StrictModel):
    """A spring's force against its compression: linear between the points and beyond the last two."""

    compressions_m: tuple[Finite, ...] = Field(min_length=2, description="free length less length.")
    forces_newton: tuple[Finite, ...] = Field(min_length=2, description="positive in compression.")

    @model_validator(mode="after")
    def _ordered(self) -> "ForceTable":
        _check_table("compressions_m", self.compressions_m, "forces_newton", self.forces_newton)
        return self


class MomentTable(StrictModel):
    """A torsion spring's moment against the angle back to rest: linear between the points and beyond."""

    angles_rad: tuple[Finite, ...] = Field(min_length=2, description="rest angle less angle.")
    moments_newton_m: tuple[Finite, ...] = Field(min_length=2)

    @model_validator(mode="after")
    def _ordered(self) -> "MomentTable":
        _check_table("angles_rad", self.angles_rad, "moments_newton_m", self.moments_newton_m)
        return self


def _check_table(key: str, places: tuple[float, ...], value_key: str, values: tuple[float, ...]) -> None:
    if len(places) != len(values):
        raise ValueError(f"{key} has {len(places)} entries, {value_key} {len(values)}")
    if any(b <= a for a, b in itertools.pairwise(places)):
        raise ValueError(f"{key} must increase")


class SpringDamper(StrictModel):
    """Spring and damper between two points; its force is positive in compression.

    force = stiffness (free_length - length) + preload - damping * rate; `table` takes the place of
    stiffness. A locked one is a constraint, with one freedom less; its force is what the rod carries, and is
    reported under the same name, and as a joint too.
    """

    kind: Literal["spring_damper"]
    body_a: str
    point_a_m: Point
    body_b: str
    point_b_m: Point
    stiffness_newton_per_m: NonNegative | None = None
    damping_newton_s_per_m: NonNegative = 0.0
    free_length_m: NonNegative = Field(description="without force, but for preload_newton.")
    preload_newton: Finite = Field(0.0, description="at the free length.")
    acts_in: Literal["both", "tension", "compression"] = Field(
        "both", description="tension: a rope; compression: a bumper."
    )
    table: ForceTable | None = Field(None, description="in place of the stiffness.")
    stops: TranslationStops | None = Field(None, description="of the length.")
    locked: bool = Field(False, description="a rigid rod of the length in the reference pose.")

    @model_validator(mode="after")
    def _one_law(self) -> "SpringDamper":
        _check_spring("stiffness_newton_per_m", self.stiffness_newton_per_m, self.acts_in, self.table)
        return self


class TorsionSpring(StrictModel):
    """Spring and damper on the angle of body_b against body_a, which is zero in the reference pose.

    moment on body_b = stiffness (rest_angle - angle) + preload - damping * rate; the rest as for
    spring_damper.
    """

    kind: Literal["torsion_spring"]
    body_a: str
    body_b: str
    stiffness_newton_m_per_rad: NonNegative | None = None
    damping_newton_m_s_per_rad: NonNegative = 0.0
    rest_angle_rad: Finite = 0.0
    preload_newton_m: Finite = Field(0.0, description="at the rest angle.")
    acts_in: Literal["both", "positive", "negative"] = Field(
        "both", description="sign of the moment on body_b."
    )
    table: MomentTable | None = Field(None, description="in place of the stiffness.")
    stops: RotationStops | None = Field(None, description="of the angle.")
    locked: bool = Field(False, description="body_b keeps its angle against body_a.")

    @model_validator(mode="after")
    def _one_law(self) -> "TorsionSpring":
        _check_spring("stiffness_newton_m_per_rad", self.stiffness_newton_m_per_rad, self.acts_in, self.table)
        return self


def _check_spring(key: str, stiffness: float | None, acts_in: str, table: StrictModel | None) -> None:
    if (stiffness is None) == (table is None):
        raise ValueError(f"needs one of {key} (0 for a damper alone) and table")
    if table is not None and acts_in != "both":
        raise ValueError(f"acts_in: '{acts_in}' does not go with a table; let the table be zero on that side")
    if acts_in != "both" and stiffness == 0.0:
        raise ValueError(f"acts_in: '{acts_in}' needs a stiffness above 0")


class CoordinateSpring(StrictModel):
    """Spring and damper on one coordinate of a body against a time function.

    force = stiffness (law(t) - q) + damping (d law/dt - dq/dt); q being the coordinate.
    """

    kind: Literal["coordinate_spring"]
    body: str
    coordinate: Literal["x", "z", "angle"]
    target: Law = Field(description="m, or rad of an angle.")
    stiffness_newton_per_m: NonNegative | None = Field(None, description="of x or z; needed there.")
    stiffness_newton_m_per_rad: NonNegative | None = Field(None, description="of an angle; needed there.")
    damping_newton_s_per_m: NonNegative | None = Field(None, description="of x or z; 0 if not given.")
    damping_newton_m_s_per_rad: NonNegative | None = Field(None, description="of an angle; 0 if not given.")
    acts_in: Literal["both", "pull_up", "push_down"] = Field(
        "both", description="pull_up: only positive force, as a chain that lowers an implement."
    )

    @property
    def stiffness(self) -> float:
        """N/m, or N m/rad of an angle."""
        return (self.stiffness_newton_per_m or 0.0) + (self.stiffness_newton_m_per_rad or 0.0)

    @property
    def damping(self) -> float:
        """N s/m, or N m s/rad of an angle."""
        return (self.damping_newton_s_per_m or 0.0) + (self.damping_newton_m_s_per_rad or 0.0)

    @model_validator(mode="after")
    def _units(self) -> "CoordinateSpring":
        ours, theirs = ("newton_s_per_m", "newton_per_m"), ("newton_m_s_per_rad", "newton_m_per_rad")
        if self.coordinate == "angle":
            ours, theirs = theirs, ours
        for kind, needed, other in zip(("damping", "stiffness"), ours, theirs, strict=True):
            if getattr(self, f"{kind}_{other}") is not None:
                raise ValueError(
                    f"{kind}_{other}: does not go with coordinate '{self.coordinate}'; give {kind}_{needed}"
                )
        if getattr(self, f"stiffness_{ours[1]}") is None:
            raise ValueError(f"stiffness_{ours[1]}: is missing; coordinate '{self.coordinate}' needs it")
        return self


class PointLoad(StrictModel):
    """A prescribed force and moment at a point fixed in the body, along world axes."""

    kind: Literal["point_load"]
    body: str
    point_m: Point = Field(description="in the reference pose, world axes.")
    force_x_newton: Law | None = None
    force_z_newton: Law | None = None
    moment_newton_m: Law | None = None


class WheelContact(StrictModel):
    """A wheel on level ground: unilateral spring-damper and Coulomb friction, regularised or sticking."""

    kind: Literal["wheel_contact"]
    body: str
    radius_m: Positive
    ground_z_m: Finite = Field(0.0, description="height of the ground.")
    stiffness_newton_per_m: Positive
    damping_newton_s_per_m: NonNegative
    friction: NonNegative = Field(description="coefficient of Coulomb friction.")
    slip_speed_m_per_s: Positive = Field(0.02, description="at which friction reaches 76 % of its limit.")
    stick_stiffness_newton_per_m: Positive | None = Field(
        None, description="of the rim along the ground; left out: friction creeps (see friction of joints)."
    )
    stick_damping_newton_s_per_m: NonNegative = Field(0.0, description="while it sticks.")

    @model_validator(mode="after")
    def _sticks(self) -> "WheelContact":
        check_stick(self, "newton_per_m", "newton_s_per_m")
        return self


Force = Annotated[
    SpringDamper | TorsionSpring | CoordinateSpring | PointLoad | WheelContact, Field(discriminator="kind")
]


class InitialState(StrictModel):
    """How the run starts from the reference pose.

    The machine is moved by `translate_x_m`. The named coordinates are held at their values while the
    others are projected onto the constraints. With `static_equilibrium` the remaining freedoms go to
    rest under gravity, springs and wheel contact.
    """

    translate_x_m: Finite = Field(0.0, description="of the whole machine.")
    coordinates: dict[str, Finite] = Field({}, description="by BODY.x_m, BODY.z_m or BODY.angle_rad.")
    static_equilibrium: bool = Field(False, description="then to rest.")


class Mechanism(StrictModel):
    """The machine. Order of bodies, joints and forces is the order of the file."""

    bodies: dict[Name, Body] = Field(min_length=1)
    joints: dict[Name, Joint] = {}
    forces: dict[Name, Force] = {}
    draft_driver: str | None = Field(None, description="the joint whose x force is the draft.")
    initial: InitialState = InitialState()
    integrator: Literal["adams_moulton", "runge_kutta_4", "generalized_alpha"] = "adams_moulton"
    integrator_order: Literal[2, 3, 4] = Field(4, description="of Adams-Moulton.")
    tolerance: Positive | None = Field(
        1e-6,
        description="relative error of velocities and positions in one step; where it is larger, a step of "
        "adams_moulton or runge_kutta_4 is taken in parts; null: fixed steps.",
    )

    @model_validator(mode="after")
    def _names(self) -> "Mechanism":
        if GROUND in self.bodies:
            raise ValueError(f"bodies: '{GROUND}' is the world itself and cannot be a body")
        known = [*self.bodies, GROUND]
        for section, items in (("joints", self.joints), ("forces", self.forces)):
            for name, item in items.items():
                for key in ("body", "body_a", "body_b", "relative_to"):
                    body = getattr(item, key, None)
                    if body is not None and body not in known:
                        raise ValueError(
                            f"{section}.{name}.{key}: no body '{body}'; bodies are {', '.join(known)}"
                        )
                    if body == GROUND and key == "body":
                        raise ValueError(f"{section}.{name}.body: the ground cannot be loaded or driven")
                if getattr(item, "body_a", 0) == getattr(item, "body_b", 1):
                    raise ValueError(f"{section}.{name}: body_a and body_b are the same body")
                if getattr(item, "relative_to", None) == getattr(item, "body", 1):
                    raise ValueError(f"{section}.{name}.relative_to: is the driven body itself")
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
