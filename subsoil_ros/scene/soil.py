"""Soil: bin, particles, bed and contact law."""

from typing import Annotated, Literal

from pydantic import Field

from .base import NonNegative, Part, Positive


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


class GridBed(Part):
    """Cubic grid, at rest when the spacing is 2 r - rest overlap; seeded jitter of each centre."""

    kind: Literal["grid"]
    spacing_m: Positive
    jitter_m: NonNegative = 0.0
    seed: int = Field(default=0, ge=0)


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
    bed: GridBed
    law: ContactLaw
    time_step_s: Annotated[Positive | Auto, Field(union_mode="left_to_right")] = "auto"
    skin_m: Positive = 0.003
    tool_stiffness_factor: Positive = 1.0  # on the boundary's normal stiffness, at tools only
    largest_tool_overlap_m: Positive | None = None  # the run stops beyond it; default: two radii
