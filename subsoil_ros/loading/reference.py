"""Reference files: values of a paper or a field record that a report prints beside those of a run."""

from pathlib import Path

from pydantic import Field, model_validator

from ..strict_model import Finite, Positive, StrictModel
from ..units import unit_of_path
from ..yaml_document import read_document
from .validation import validated

LIKE_THEIR_COLUMN = ("mean", "min", "max", "range", "std")
"""Statistics of a column of the series that have its unit, which is in its name."""


class ReferenceValue(StrictModel):
    """One quantity of the reference, in the unit that the quantity has in summary.json."""

    value: Finite | None = None
    low: Finite | None = None  # band, both or neither
    high: Finite | None = None
    tolerance: Positive | None = None  # the band as a part of the value, instead of low and high
    unit: str  # printed; 1 for a ratio
    source: str = ""  # page, figure, instrument, remark

    @model_validator(mode="after")
    def _consistent(self) -> "ReferenceValue":
        if (self.low is None) != (self.high is None):
            raise ValueError("a band needs both 'low' and 'high'")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low {self.low:g} is above high {self.high:g}; exchange them")
        if self.value is None and self.low is None:
            raise ValueError("needs a 'value', or a band of 'low' and 'high'")
        if self.tolerance is not None and (self.low is not None or not self.value):
            raise ValueError("'tolerance' is a part of a 'value' that is not 0; else give 'low' and 'high'")
        return self

    @property
    def band(self) -> tuple[float, float] | None:
        """Least and largest that agree; None where the reference gives no band."""
        if self.low is not None and self.high is not None:
            return self.low, self.high
        if self.tolerance is None or self.value is None:
            return None
        half = self.tolerance * abs(self.value)
        return self.value - half, self.value + half


class Reference(StrictModel):
    """What `report.reference` names."""

    name: str = Field(min_length=1)  # heading of the table, and in legends
    source: str = ""  # where all of it is published, or was measured
    notes: tuple[str, ...] = ()  # printed below the table
    values: dict[str, ReferenceValue] = Field(min_length=1)  # by dotted path in summary.json

    @model_validator(mode="after")
    def _units(self) -> "Reference":
        for quantity, given in self.values.items():
            start, *_, statistic = quantity.split(".")
            if start != "series" or statistic not in LIKE_THEIR_COLUMN:
                continue
            unit = unit_of_path(quantity) or given.unit
            if given.unit != unit:
                raise ValueError(
                    f"values.{quantity}.unit: {given.unit} given, and the run has this quantity in {unit}; "
                    f"give unit: {unit}, with value and band in it"
                )
        return self


def read_reference(path: Path, place: str = "report.reference") -> Reference:
    """Read a reference file.

    Raises:
        SceneError: it is missing, no YAML, or no reference; the line says which value is wrong, and how.
    """
    shown = f"{place}: {path}"
    return validated(Reference, read_document(path, shown), shown)
