"""Layers of depth: what differs from layer to layer."""

from typing import Annotated, Literal

from pydantic import Field

from .base import Fraction, NonNegative, PoissonRatio, Positive, StrictModel


class CohesiveLinearChange(StrictModel):
    """Values of a row of the cohesive linear law that a layer has of its own."""

    stiffness_newton_per_m: Positive | None = None
    tangential_stiffness_newton_per_m: NonNegative | None = None
    damping_newton_s_per_m: NonNegative | None = None
    tangential_damping_newton_s_per_m: NonNegative | None = None
    cohesive_stiffness_newton_per_m: NonNegative | None = None
    static_friction: NonNegative | None = None
    sliding_friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None
    equilibrium_overlap_m: Positive | None = None
    cohesion_range_m: Positive | None = None


class LinearChange(StrictModel):
    """Values of a row of the linear law that a layer has of its own."""

    stiffness_newton_per_m: Positive | None = None
    tangential_stiffness_newton_per_m: NonNegative | None = None
    damping_newton_s_per_m: NonNegative | None = None
    tangential_damping_newton_s_per_m: NonNegative | None = None
    static_friction: NonNegative | None = None
    sliding_friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None


class HertzChange(StrictModel):
    """Values of a row of the Hertz-Mindlin law that a layer has of its own."""

    youngs_modulus_pa: Positive | None = None
    poisson_ratio: PoissonRatio | None = None
    restitution: Fraction | None = None
    static_friction: NonNegative | None = None
    sliding_friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None


class CohesiveLinearLayerLaw(StrictModel):
    """What a layer changes in the rows of a cohesive linear law."""

    kind: Literal["cohesive_linear"]
    particle: CohesiveLinearChange = CohesiveLinearChange()
    boundary: CohesiveLinearChange = CohesiveLinearChange()


class LinearLayerLaw(StrictModel):
    """What a layer changes in the rows of a linear law."""

    kind: Literal["linear"]
    particle: LinearChange = LinearChange()
    boundary: LinearChange = LinearChange()


class HertzLayerLaw(StrictModel):
    """What a layer changes in the rows of a Hertz-Mindlin law."""

    kind: Literal["hertz_mindlin"]
    particle: HertzChange = HertzChange()
    boundary: HertzChange = HertzChange()


LayerLaw = Annotated[CohesiveLinearLayerLaw | LinearLayerLaw | HertzLayerLaw, Field(discriminator="kind")]


class Layer(StrictModel):
    """A layer of the bed. What it does not give comes from `soil.particles` and `soil.law`."""

    name: str = Field(min_length=1)
    thickness_m: Positive | None = Field(
        None, description="the last layer, and only that one, goes on to the floor."
    )
    density_kg_per_m3: Positive | None = None
    law: LayerLaw | None = None
