"""Base of every part of a scene: frozen, closed, SI units in the key names."""

import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

SMALLEST, LARGEST = 1e-30, 1e30
"""Magnitudes of a scene's numbers other than 0: squares of products of four of them are still float64."""


def _within_reach(value: float) -> float:
    """Return the value; raise ValueError where results computed from it could leave the range of float64."""
    if value != 0.0 and not SMALLEST <= abs(value) <= LARGEST:
        raise ValueError(
            f"given {value:g}; it must be 0 or a magnitude from {SMALLEST:g} to {LARGEST:g}; what is "
            "computed from others cannot be represented"
        )
    return value


WithinReach = AfterValidator(_within_reach)
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False), WithinReach]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False), WithinReach]
Finite = Annotated[float, Field(allow_inf_nan=False), WithinReach]
Fraction = Annotated[float, Field(gt=0.0, le=1.0), WithinReach]
PoissonRatio = Annotated[float, Field(gt=-1.0, le=0.5), WithinReach]


def _name(value: str) -> str:
    """Return the value; raise ValueError where it cannot be part of a topic, a column and a file name."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,63}", value):
        raise ValueError(
            f"given the name '{value}'; it must be a letter and then letters, digits and underscores, "
            "64 at most"
        )
    if value == "world":
        raise ValueError("given the name 'world', which is the frame of the world in /tf; choose another")
    return value


Name = Annotated[str, AfterValidator(_name)]
"""Key of a part that a scene names, such as a tool."""

Point = tuple[Finite, Finite]  # (x, z) in world axes, metres, in the reference pose


class StrictModel(BaseModel):
    """A frozen, closed piece of a scene: an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)
