"""Functions of time named in a scene: constant, ramp, sine, half-sine, polynomial, table, and sums."""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from ..strict_model import Finite, NonNegative, Positive, StrictModel

LARGEST_DEGREE = 7
"""Of a polynomial law: enough for rest-to-rest moves with continuous jerk."""


class ConstantLaw(StrictModel):
    """The same value at all times."""

    kind: Literal["constant"]
    value: Finite


class RampLaw(StrictModel):
    """start_value until start_s, then linear to end_value at end_s, then end_value."""

    kind: Literal["ramp"]
    start_value: Finite = 0.0
    end_value: Finite
    start_s: NonNegative = 0.0
    end_s: Positive

    @model_validator(mode="after")
    def _ordered(self) -> "RampLaw":
        if self.end_s <= self.start_s:
            raise ValueError(f"end_s {self.end_s} must be later than start_s {self.start_s}")
        return self


class SineLaw(StrictModel):
    """mean + amplitude * sin(2 pi frequency t + phase)."""

    kind: Literal["sine"]
    mean: Finite = 0.0
    amplitude: Finite
    frequency_hz: Positive
    phase_rad: Finite = 0.0


class TableLaw(StrictModel):
    """Linear between (time, value) pairs; the end values hold outside."""

    kind: Literal["table"]
    times_s: tuple[Finite, ...] = Field(min_length=2)
    values: tuple[Finite, ...] = Field(min_length=2)

    @model_validator(mode="after")
    def _ordered(self) -> "TableLaw":
        if len(self.times_s) != len(self.values):
            raise ValueError(f"times_s has {len(self.times_s)} entries, values {len(self.values)}")
        if any(b <= a for a, b in zip(self.times_s[:-1], self.times_s[1:], strict=True)):
            raise ValueError("times_s must increase")
        return self


class HalfSineLaw(StrictModel):
    """peak * sin(pi (t - start) / duration) until start + duration, zero outside: a knock."""

    kind: Literal["half_sine"]
    peak: Finite
    start_s: NonNegative = 0.0
    duration_s: Positive


class PolynomialLaw(StrictModel):
    """Sum of coefficients[k] * (t - start_s)^k from start_s to end_s; the end values hold outside."""

    kind: Literal["polynomial"]
    coefficients: tuple[Finite, ...] = Field(min_length=1, max_length=LARGEST_DEGREE + 1)
    start_s: NonNegative = 0.0
    end_s: Positive | None = Field(None, description="left out: it never ends.")

    @model_validator(mode="after")
    def _ordered(self) -> "PolynomialLaw":
        if self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end_s {self.end_s} must be later than start_s {self.start_s}")
        return self


def _constant(value: float) -> ConstantLaw:
    return ConstantLaw(kind="constant", value=value)


if TYPE_CHECKING:
    Number = ConstantLaw
else:
    Number = Annotated[Finite, AfterValidator(_constant)]
    """A bare number stands for a constant law."""


def _kind(law: object) -> object:
    if isinstance(law, dict):
        return law.get("kind")
    is_number = isinstance(law, int | float) and not isinstance(law, bool)
    return "number" if is_number else getattr(law, "kind", None)


_Simple = (
    Annotated[Number, Tag("number")]
    | Annotated[ConstantLaw, Tag("constant")]
    | Annotated[RampLaw, Tag("ramp")]
    | Annotated[SineLaw, Tag("sine")]
    | Annotated[HalfSineLaw, Tag("half_sine")]
    | Annotated[PolynomialLaw, Tag("polynomial")]
    | Annotated[TableLaw, Tag("table")]
)
SimpleLaw = Annotated[_Simple, Discriminator(_kind)]


class SumLaw(StrictModel):
    """The sum of its terms."""

    kind: Literal["sum"]
    terms: tuple[SimpleLaw, ...] = Field(min_length=1)


Law = Annotated[_Simple | Annotated[SumLaw, Tag("sum")], Discriminator(_kind)]
"""A function of time, or a number for a constant one."""
