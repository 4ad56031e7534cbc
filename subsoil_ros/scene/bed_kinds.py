"""How the bed is made."""

import itertools
from typing import Annotated, Literal, TypeGuard

from pydantic import Field, model_validator

from ..strict_model import Finite, NonNegative, Positive, StrictModel

Seed = Annotated[int, Field(ge=0)]


class GridBed(StrictModel):
    """Cubic grid. A random shift of each centre follows from the seed."""

    kind: Literal["grid"]
    spacing_m: Annotated[Positive | Literal["rest"], Field(union_mode="left_to_right")] = Field(
        description="between centres; rest: that of the law without load, 2 r - rest overlap."
    )
    jitter_m: NonNegative = Field(0.0, description="of each centre.")
    seed: Seed = 0


class DenseRandomBed(StrictModel):
    """Random close packing, bonded and relaxed to rest."""

    kind: Literal["dense_random"]
    seed: Seed = 0


class TiledBed(StrictModel):
    """Random spheres at a solid fraction, in a tile that repeats itself and is laid out to the bin.

    The tile is prepared once for all bins and laws; laid out, it comes to rest under the law of the scene.
    """

    kind: Literal["tiled"]
    seed: Seed = 0
    solid_fraction: float = Field(
        0.60, ge=0.55, le=0.64, description="volume of the spheres over that of the bed."
    )
    tile_m: Positive | None = Field(
        None, description="edge of the tile, a cube; default: 40 mean radii, no wider than the bin."
    )
    floor: Literal["held", "plane"] = Field(
        "held", description="held: soil below the depth that does not move; plane: a wall."
    )


class SavedBed(StrictModel):
    """A bed prepared before, under the same law and for the same bin."""

    kind: Literal["saved"]
    file: str = Field(min_length=1, description="relative to the scene file.")


class SurfaceProfile(StrictModel):
    """Height of the surface over x, the same for every y: linear between the points, constant outside.

    z = 0 is the surface of the bed before it is trimmed, so no height is above 0.
    """

    x_m: tuple[Finite, ...] = Field(min_length=1)
    z_m: tuple[Annotated[float, Field(le=0.0, allow_inf_nan=False)], ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _table(self) -> "SurfaceProfile":
        if len(self.x_m) != len(self.z_m):
            raise ValueError(f"z_m: has {len(self.z_m)} heights for the {len(self.x_m)} places of x_m")
        if any(b <= a for a, b in itertools.pairwise(self.x_m)):
            raise ValueError("x_m: must grow from one point to the next")
        return self


Bed = Annotated[GridBed | DenseRandomBed | TiledBed | SavedBed, Field(discriminator="kind")]


def is_random(bed: Bed) -> TypeGuard[GridBed | DenseRandomBed | TiledBed]:
    """Whether the bed depends on a seed."""
    return isinstance(bed, (DenseRandomBed, TiledBed)) or (isinstance(bed, GridBed) and bed.jitter_m > 0.0)
