"""Tools: triangle meshes that touch the soil, carried by a body or along a prescribed path."""

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Literal

from pydantic import Field, model_validator

from ..rotations import Quaternion, planar_quaternion, quaternion_of, rotation_between, turned
from ..strict_model import Finite, Name, NonNegative, Positive, StrictModel
from .time_laws import Law

Coordinates = tuple[Finite, Finite, Finite]
"""x, y and z in world axes, or in those of a tool."""

MeshUnit = Literal["m", "cm", "mm", "inch"]
LARGEST_SETBACK = 0.9
"""Of the smallest radius: a particle touches a tool while its centre is outside, however the tool comes."""

METRES: Mapping[MeshUnit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}

Upward = Literal["y", "z"]


class CadKeys(StrictModel):
    """What the loader does to a file before the scene is made: none of it is left in the scene."""

    unit: MeshUnit | None = Field(None, exclude=True, description="of a file that names none: STL, OBJ.")
    up: Upward = Field("z", exclude=True, description="axis of the file that points upwards.")
    rotation_deg: Coordinates = Field(
        (0.0, 0.0, 0.0), exclude=True, description="of the file about x, then y, then z; forward is +x."
    )


class MeshPart(CadKeys):
    """One watertight mesh, its facets forming one group.

    A mesh vertex v [file units] stands at `position_m + scale * v` in the reference pose of the
    mechanism (world axes), or in the path's frame for a tool without a body.
    """

    mesh: str = Field(description="STL, OBJ, 3MF or STEP file, relative to the scene file.")
    scale: Positive = Field(1.0, description="metres per file unit.")
    position_m: tuple[Finite, Finite, Finite] = Field((0.0, 0.0, 0.0), description="of the mesh's origin.")


class Blade(StrictModel):
    """A flat plate whose front leans back by the rake. Its cutting edge is level, at the origin of the tool's
    axes. By default it is a flat bar, ground so that its underside does not slide on the soil."""

    rake_deg: Positive = Field(le=90.0, description="front against the horizontal; 90: upright.")
    width_m: Positive
    thickness_m: Positive = 0.02
    clearance_deg: Finite = Field(10.0, ge=0.0, description="underside against the horizontal.")
    height_m: Positive | None = Field(None, description="left out: twice depth_m.")

    @model_validator(mode="after")
    def _pointed(self) -> "Blade":
        if self.clearance_deg >= self.rake_deg:
            raise ValueError(
                f"clearance_deg: given {self.clearance_deg:g}, must be below rake_deg {self.rake_deg:g}"
            )
        return self


LARGEST_TURN_RAD = math.pi - 1e-6
"""Largest rotation from one pose to the next: less than a half turn, which has no direction."""


class FreeTurn(StrictModel):
    """A tool that rolls freely: only the soil's torque turns it about the axis. It is balanced about it."""

    inertia_kg_m2: Positive = Field(description="moment of inertia about the axis.")
    start_speed_rad_per_s: Finite = Field(0.0, description="about the axis.")


class Turn(StrictModel):
    """How a tool stands in space, and what turns it about an axis fixed in it, through the path's origin."""

    start_rotation_rad: Coordinates = Field(
        (0.0, 0.0, 0.0), description="rotation vector at the start: axis in the world times angle."
    )
    axis: Coordinates | None = Field(None, description="in the tool's own axes, of any length.")
    speed_rad_per_s: Law | None = Field(None, description="about the axis; or free.")
    free: FreeTurn | None = Field(None, description="the soil's torque turns the tool about the axis.")

    @property
    def unit_axis(self) -> Coordinates:
        """Axis of length 1 in the world; it stays there."""
        x, y, z = self.axis or (0.0, 1.0, 0.0)
        length = math.hypot(x, y, z)
        return turned(quaternion_of(self.start_rotation_rad), (x / length, y / length, z / length))

    @model_validator(mode="after")
    def _turned_by_one(self) -> "Turn":
        if self.speed_rad_per_s is not None and self.free is not None:
            raise ValueError("given both 'speed_rad_per_s' and 'free'; give what turns the tool, one of them")
        turns = self.speed_rad_per_s is not None or self.free is not None
        if turns != (self.axis is not None):
            raise ValueError("'axis' goes with 'speed_rad_per_s' or 'free'; give both, or neither")
        if self.axis is not None and math.hypot(*self.axis) == 0.0:
            raise ValueError(
                "axis: given (0, 0, 0), which has no direction; give one, for instance [0, 1, 0]"
            )
        return self


class Poses(StrictModel):
    """Poses that a tool passes through, joined by cubic splines of position and rotation with continuous
    accelerations."""

    times_s: tuple[Finite, ...] = Field(min_length=2, description="from 0 to duration_s at least.")
    positions_m: tuple[Coordinates, ...] = Field(description="(x, y, z); leave out the tool's lateral_m.")
    rotations_rad: tuple[Coordinates, ...] = Field(
        description="rotation vectors: axis in the world times angle, less than half a turn apart."
    )

    @model_validator(mode="after")
    def _complete(self) -> "Poses":
        for name in ("positions_m", "rotations_rad"):
            if len(getattr(self, name)) != len(self.times_s):
                count = len(getattr(self, name))
                raise ValueError(
                    f"{name}: has {count} entries, times_s has {len(self.times_s)}; give as many"
                )
        if self.times_s[0] != 0.0 or any(b <= a for a, b in pairwise(self.times_s)):
            raise ValueError("times_s: must begin with 0 and increase")
        for k, (a, b) in enumerate(pairwise(map(quaternion_of, self.rotations_rad))):
            if math.hypot(*rotation_between(a, b)) > LARGEST_TURN_RAD:
                raise ValueError(
                    f"rotations_rad: half a turn from entry {k} to {k + 1}, so that its direction is not "
                    "known; give one between"
                )
        return self


_START = ("start_x_m", "start_z_m", "start_angle_rad")


class Path(StrictModel):
    """A prescribed path for a tool without a mechanism: start pose and speeds as time functions.

    Without speed_y_m_per_s, turn and poses the tool stays in the plane of travel.
    """

    start_x_m: Finite = 0.0
    start_z_m: Finite = 0.0
    start_angle_rad: Finite = Field(0.0, description="in the plane of travel.")
    speed_x_m_per_s: Law | None = Field(None, description="in the direction of travel.")
    speed_y_m_per_s: Law | None = Field(None, description="to the left; the path is then in space.")
    speed_z_m_per_s: Law | None = Field(None, description="upwards.")
    angular_speed_rad_per_s: Law | None = Field(None, description="in the plane of travel.")
    turn: Turn | None = Field(
        None, description="in space; replaces start_angle_rad and angular_speed_rad_per_s."
    )
    poses: Poses | None = Field(None, description="in space; in place of all other keys.")
    external: bool = Field(
        False,
        description="an external machine moves the tools of the scene from their start poses.",
    )
    may_leap: bool = Field(
        False,
        description="with external: after a motion that its velocities do not explain, the tool enters the "
        "soil anew; particles that it overlaps are removed. coupling.residual_bound then does not apply.",
    )

    @property
    def is_spatial(self) -> bool:
        """Whether the tool leaves the plane of travel."""
        return self.speed_y_m_per_s is not None or self.turn is not None or self.poses is not None

    def start_m(self, lateral_m: float) -> tuple[float, float, float]:
        """Position at the start, of a tool with this lateral offset."""
        if self.poses is not None:
            return self.poses.positions_m[0]
        return self.start_x_m, lateral_m, self.start_z_m

    @property
    def start_quaternion(self) -> Quaternion:
        """Orientation at the start."""
        if self.poses is not None:
            return quaternion_of(self.poses.rotations_rad[0])
        if self.turn is not None:
            return quaternion_of(self.turn.start_rotation_rad)
        return planar_quaternion(self.start_angle_rad)

    @model_validator(mode="after")
    def _one_way(self) -> "Path":
        given = self.model_fields_set
        planar = sorted(given & {"start_angle_rad", "angular_speed_rad_per_s"})
        if self.turn is not None and planar:
            raise ValueError(
                f"given 'turn' and {', '.join(planar)}; with 'turn' give turn.start_rotation_rad and "
                "turn.speed_rad_per_s"
            )
        moved = [key for key in sorted(given) if key not in (*_START, "external", "may_leap", "turn")]
        if self.turn is not None and self.turn.axis is not None:
            moved.append("turn.axis")
        if self.external and moved:
            raise ValueError(
                f"external: given with {', '.join(moved)}; an external machine moves the tool: give the "
                f"start pose alone, by {', '.join(_START)} or turn.start_rotation_rad"
            )
        if self.may_leap and not self.external:
            raise ValueError("may_leap: given without 'external: true'; only an external machine leaps")
        if self.poses is not None and given != {"poses"}:
            raise ValueError(
                f"given 'poses' and {', '.join(sorted(given - {'poses'}))}; 'poses' takes no other keys"
            )
        return self


class Tool(CadKeys):
    """Meshes that act on the soil; forces are recorded for each of its groups (share, blade, ...).

    In short, by `mesh`, `depth_m` and `speed_m_per_s`, from which path and groups are derived.
    """

    mesh: str | None = Field(
        None, exclude=True, description="in short, for groups: one file, whose group is called as the tool."
    )
    blade: Blade | None = Field(None, exclude=True, description="in place of mesh: a flat blade.")
    depth_m: Positive | None = Field(
        None, exclude=True, description="in short, for path: of the lowest point below the surface."
    )
    speed_m_per_s: Finite | None = Field(
        None, exclude=True, description="in short, for path: forward, constant."
    )

    body: str | None = Field(None, description="of the mechanism, which carries the tool.")
    path: Path | None = Field(None, description="of the tool, if there is no mechanism.")
    lateral_m: Finite = Field(0.0, description="y of the tool's body, or of its path.")
    groups: dict[Name, MeshPart] = {}
    setback_m: NonNegative = Field(
        0.0,
        description="particles reach this far into the surface before they touch it: large ones then act "
        "on a tool as ones smaller by this do (validation/limit.md). Presets leave one that is given.",
    )
    density_kg_per_m3: Positive | None = Field(
        None,
        description="of the solid; `subsoil check` prints mass and inertia of the meshes from it.",
    )
    role: Literal["tillage", "wheel"] = Field(
        "tillage", description="wheel: carries the machine, and counts apart in the split of the draft."
    )

    @property
    def is_tillage(self) -> bool:
        """Whether it works the soil; a wheel only rolls on it."""
        return self.role == "tillage"

    @property
    def is_spatial(self) -> bool:
        """Whether its path leaves the plane of travel."""
        return self.path is not None and self.path.is_spatial

    @property
    def may_leap(self) -> bool:
        """Whether it enters the soil anew after a leap."""
        return self.path is not None and self.path.may_leap

    @property
    def inertia_kg_m2(self) -> float | None:
        """Moment of inertia about the axis of its path if the soil turns it freely; else None."""
        turn = self.path.turn if self.path is not None else None
        return turn.free.inertia_kg_m2 if turn is not None and turn.free is not None else None

    @model_validator(mode="after")
    def _carried(self) -> "Tool":
        if (self.body is None) == (self.path is None):
            raise ValueError(
                "give either 'body' (carried by the mechanism) or 'path', not both; or, in short, 'depth_m' "
                "and 'speed_m_per_s' for a path"
            )
        if not self.groups:
            raise ValueError("give 'mesh', a file, or 'groups' of several, or 'blade'")
        return self
