"""Base of every part of a scene: frozen, closed, SI units in the key names."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Fraction = Annotated[float, Field(gt=0.0, le=1.0)]
PoissonRatio = Annotated[float, Field(gt=-1.0, le=0.5)]
Point = tuple[Finite, Finite]  # (x, z) in world axes, metres, in the reference pose


class StrictModel(BaseModel):
    """A frozen, closed piece of a scene: an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)
