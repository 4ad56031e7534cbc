"""How the bed is made."""

from typing import Annotated, Literal

from pydantic import Field

from .base import NonNegative, Part, Positive

Seed = Annotated[int, Field(ge=0)]


class GridBed(Part):
    """Cubic grid, at rest when the spacing is `rest`, 2 r - rest overlap; seeded jitter of each centre."""

    kind: Literal["grid"]
    spacing_m: Annotated[Positive | Literal["rest"], Field(union_mode="left_to_right")]
    jitter_m: NonNegative = 0.0
    seed: Seed = 0


class DenseRandomBed(Part):
    """Random close packing, bonded and relaxed to rest."""

    kind: Literal["dense_random"]
    seed: Seed = 0


class SavedBed(Part):
    """A bed prepared before, under the same law and for the same bin."""

    kind: Literal["saved"]
    file: str = Field(min_length=1)  # relative to the scene file


Bed = Annotated[GridBed | DenseRandomBed | SavedBed, Field(discriminator="kind")]
