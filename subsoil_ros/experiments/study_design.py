"""What a study compares: factors and their values, the reference run, seeds; read from a design file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..errors import InputError
from ..loading.validation import suggestion, validated
from ..strict_model import Fraction, StrictModel
from ..yaml_document import read_document
from .run_metrics import METRICS
from .sweep_points import Point

REFERENCE = "reference"

Overrides = tuple[str, ...]  # KEY=VALUE, as after --set
Seeds = Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]


class Reference(StrictModel):
    """Another run that errors are given against, finer than the reference but too costly to repeat."""

    overrides: Overrides  # over the scene and the common ones, not over `reference`
    seeds: Seeds = (0,)


class StudyDesign(StrictModel):
    """A study of one scene."""

    overrides: Overrides = ()  # in every run
    reference: Overrides = ()  # the run that all others are measured against
    seeds: Seeds
    confidence: Fraction = 0.95
    intervals: Literal["seeds", "records"] = "seeds"  # of the scatter over the seeds, or of each run's record
    factors: dict[str, dict[str, Overrides]]  # factor, value, its changes of the reference
    one_at_a_time: tuple[str, ...] | None = (
        None  # factors whose values also run alone (default: every factor)
    )
    presets: dict[str, dict[str, str]] = {}  # name, then the value of each factor that differs
    metrics: tuple[str, ...] = ("draft_mean_newton", "spring_range_newton")  # the Pareto set's error
    additional_references: dict[str, Reference] = {}

    @model_validator(mode="after")
    def _known(self) -> "StudyDesign":
        if len(set(self.seeds)) < len(self.seeds):
            raise ValueError("seeds: one is given twice; each bed counts once")
        for factor in self.one_at_a_time or ():
            if factor not in self.factors:
                raise ValueError(f"one_at_a_time: no factor '{factor}'; {suggestion(factor, self.factors)}")
        for name, chosen in self.presets.items():
            for factor, value in chosen.items():
                if factor not in self.factors:
                    raise ValueError(
                        f"presets.{name}: no factor '{factor}'; {suggestion(factor, self.factors)}"
                    )
                if value not in self.factors[factor]:
                    raise ValueError(
                        f"presets.{name}.{factor}: no value '{value}'; "
                        f"{suggestion(value, self.factors[factor])}"
                    )
        if self.intervals == "records" and self.confidence != 0.95:
            raise ValueError(
                f"confidence: {self.confidence:g} given; with intervals: records it is 0.95, as in records"
            )
        names = [metric.name for metric in METRICS]
        for name in self.metrics:
            if name not in names:
                raise ValueError(f"metrics: no metric '{name}'; {suggestion(name, names)}")
        taken = {REFERENCE, *self.presets} & {*self.additional_references}
        if taken or REFERENCE in self.presets:
            raise ValueError(
                f"additional_references, presets: '{(taken or {REFERENCE}).pop()}' names another run"
            )
        return self

    def all_presets(self) -> tuple["StudyPreset", ...]:
        """The reference run, the values of factors one at a time, the presets; without seeds."""
        found = [StudyPreset(Point({}, name=REFERENCE, overrides=self.reference), {})]
        for factor in self.factors if self.one_at_a_time is None else self.one_at_a_time:
            for value in self.factors[factor]:
                found.append(self._preset(f"{factor}: {value}", {factor: value}))
        return (*found, *(self._preset(name, chosen) for name, chosen in self.presets.items()))

    def _preset(self, name: str, factors: dict[str, str]) -> "StudyPreset":
        own = [change for factor, value in factors.items() for change in self.factors[factor][value]]
        return StudyPreset(Point({}, name=name, overrides=(*self.reference, *own)), factors)


@dataclass(frozen=True)
class StudyPreset:
    """A run of a study, without its seed."""

    point: Point
    factors: dict[str, str]  # those that differ from the reference


def read_design(path: Path) -> StudyDesign:
    """Raises InputError for a file that is missing or is no design; a line per wrong place."""
    return validated(StudyDesign, read_document(path, str(path)), str(path))


def design_of(scene: Path) -> Path:
    """Where the design of a shipped scene stands: studies/NAME.yaml beside its folder.

    Raises:
        InputError: there is none.
    """
    path = scene.parent.parent / "studies" / f"{scene.stem}.yaml"
    if not path.is_file():
        raise InputError(
            f"{scene}: has no design of a study at {path}; name one by --design (docs/studies.md says what "
            "is in it)"
        )
    return path
