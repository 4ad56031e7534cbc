"""When a run may end before its duration: once its mean is known."""

from typing import Annotated, Literal

from pydantic import Field

from ..strict_model import Positive, StrictModel

StopMetric = Literal["draft_newton", "draft.share_newton"]
"""Columns of series.csv that follow from the forces on the tools alone."""


class StopWhen(StrictModel):
    """The run ends when the interval of the mean of `metric` is narrow enough, or after `at_most_m`."""

    metric: StopMetric = Field(
        "draft_newton",
        description="column of series.csv; with mechanism.draft_driver draft.share_newton.",
    )
    relative_interval: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        description="half-width of the interval, relative to the mean."
    )
    confidence: Annotated[float, Field(gt=0.5, lt=1.0)] = Field(0.95, description="of the interval.")
    at_most_m: Positive | None = Field(
        None, description="travel of the tool after which the run ends in any case."
    )
