"""Soil: bin, particles, bed and contact law."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import NonNegative, Part, Positive
from .beds import Bed, DenseRandomBed, SavedBed, SurfaceProfile


class Bin(Part):
    """Open box: x in [0, length], y in [-width/2, width/2]; particles only, tools may cross it.

    z = 0 is the mean top of the prepared bed; the floor follows from the bed.
    """

    length_m: Positive
    width_m: Positive
    depth_m: Positive  # of the bed


class Particles(Part):
    """Equal spheres."""

    radius_m: Positive
    density_kg_per_m3: Positive
    law_radius_m: Positive | None = None  # radius the law was found for; it is scaled from there (scaling.py)


class WetValues(Part):
    """One row of table 3 of the paper."""

    stiffness_newton_per_m: Positive  # K_X
    tangential_stiffness_newton_per_m: NonNegative  # K_Y, K_Z
    damping_newton_s_per_m: NonNegative  # C_X
    tangential_damping_newton_s_per_m: NonNegative  # C_Y, C_Z
    adhesion_newton_per_m: NonNegative  # K_B
    static_friction: NonNegative
    sliding_friction: NonNegative
    rolling_friction: NonNegative
    rest_overlap_m: Positive  # delta_c
    reach_m: Positive  # delta_B


class WetLaw(Part):
    """The paper's law of wet particles (eq. 12-21), its adjustment distance Delta being 0.

    `values_are` says how the two rows are read: `body`, combined by eq. 15, 16 and 18 (a pair of
    equal bodies has half of each value), or `pair`, used as they stand.
    """

    kind: Literal["wet"]
    values_are: Literal["body", "pair"] = "body"
    particle: WetValues
    boundary: WetValues
    friction_normal: Literal["total", "repulsive", "absolute"] = "total"
    damped_zones: Literal["repulsive", "all"] = "repulsive"


class LinearValues(Part):
    """A spring and a dashpot, as they stand for the pair."""

    stiffness_newton_per_m: Positive
    tangential_stiffness_newton_per_m: NonNegative
    damping_newton_s_per_m: NonNegative
    tangential_damping_newton_s_per_m: NonNegative
    static_friction: NonNegative
    sliding_friction: NonNegative
    rolling_friction: NonNegative = 0.0


class LinearLaw(Part):
    """Dry spheres with linear springs and dashpots, acting while they overlap."""

    kind: Literal["linear"]
    particle: LinearValues
    boundary: LinearValues


class HertzValues(Part):
    """A material; restitution and friction of the `boundary` row stand for particle and boundary."""

    youngs_modulus_pa: Positive
    poisson_ratio: Annotated[float, Field(gt=-1.0, le=0.5)]
    restitution: Annotated[float, Field(gt=0.0, le=1.0)]
    static_friction: NonNegative
    sliding_friction: NonNegative
    rolling_friction: NonNegative = 0.0


class HertzMindlinLaw(Part):
    """Elastic spheres (Hertz) with Mindlin's tangential stiffness and a dashpot of given restitution."""

    kind: Literal["hertz_mindlin"]
    particle: HertzValues
    boundary: HertzValues


ContactLaw = Annotated[WetLaw | LinearLaw | HertzMindlinLaw, Field(discriminator="kind")]

Auto = Literal["auto"]


class Soil(Part):
    """Everything the soil engine needs."""

    bin: Bin
    particles: Particles
    bed: Bed
    law: ContactLaw
    time_step_s: Annotated[Positive | Auto, Field(union_mode="left_to_right")] = "auto"
    skin_m: Positive = 0.003
    tool_stiffness_factor: Positive = 1.0  # on the boundary's normal stiffness, at tools only
    largest_tool_overlap_m: Positive | None = None  # the run stops beyond it; default: two radii
    surface: SurfaceProfile | None = None  # trims the bed

    @model_validator(mode="after")
    def _bed_of_linear_springs(self) -> "Soil":
        if isinstance(self.bed, DenseRandomBed) and isinstance(self.law, HertzMindlinLaw):
            raise ValueError(
                "bed.kind: 'dense_random' settles under linear springs and cannot be prepared under law "
                "'hertz_mindlin'; use 'grid', or law 'wet' or 'linear'"
            )
        return self

    @model_validator(mode="after")
    def _surface_above_floor(self) -> "Soil":
        if self.surface is None:
            return self
        if isinstance(self.bed, SavedBed):
            raise ValueError("surface: a saved bed has its surface already; leave out 'surface'")
        lowest = 2.0 * self.particles.radius_m - self.bin.depth_m
        if min(self.surface.z_m) < lowest:
            raise ValueError(
                f"surface.z_m: {min(self.surface.z_m):g} m leaves less than a particle on the floor of the "
                f"bin, {self.bin.depth_m:g} m deep; allowed is at least {lowest:g} m"
            )
        return self
