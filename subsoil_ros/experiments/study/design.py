"""What a study compares: factors and their values, the finest run, seeds; read from a design file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from ...errors import InputError
from ...loading.keys import suggestion
from ...loading.validation_errors import validated
from ...strict_model import Fraction, StrictModel
from ...yaml_document import read_document
from ..run_metrics import METRICS
from ..sweep.plan import Point

FINEST = "finest"

Overrides = tuple[str, ...]  # KEY=VALUE, as after --set
Seeds = Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]


class Reference(StrictModel):
    """Another run that errors are given against, finer than the finest that can be repeated."""

    overrides: Overrides  # over the scene and the common ones, not over `finest`
    seeds: Seeds = (0,)


class StudyDesign(StrictModel):
    """A study of one scene."""

    overrides: Overrides = ()  # in every run
    finest: Overrides = ()  # the run that all others are measured against
    seeds: Seeds
    confidence: Fraction = 0.95
    factors: dict[str, dict[str, Overrides]]  # factor, value, its changes of the finest
    one_at_a_time: tuple[str, ...] | None = (
        None  # factors whose values also run alone (default: every factor)
    )
    combinations: dict[str, dict[str, str]] = {}  # name, then the value of each factor that differs
    metrics: tuple[str, ...] = ("draft_mean_newton", "spring_range_newton")  # the Pareto set's error
    additional_references: dict[str, Reference] = {}

    @model_validator(mode="after")
    def _known(self) -> "StudyDesign":
        if len(set(self.seeds)) < len(self.seeds):
            raise ValueError("seeds: one is given twice; each bed counts once")
        for factor in self.one_at_a_time or ():
            if factor not in self.factors:
                raise ValueError(f"one_at_a_time: no factor '{factor}'; {suggestion(factor, self.factors)}")
        for name, chosen in self.combinations.items():
            for factor, value in chosen.items():
                if factor not in self.factors:
                    raise ValueError(
                        f"combinations.{name}: no factor '{factor}'; {suggestion(factor, self.factors)}"
                    )
                if value not in self.factors[factor]:
                    raise ValueError(
                        f"combinations.{name}.{factor}: no value '{value}'; "
                        f"{suggestion(value, self.factors[factor])}"
                    )
        names = [metric.name for metric in METRICS]
        for name in self.metrics:
            if name not in names:
                raise ValueError(f"metrics: no metric '{name}'; {suggestion(name, names)}")
        taken = {FINEST, *self.combinations} & {*self.additional_references}
        if taken or FINEST in self.combinations:
            raise ValueError(
                f"additional_references, combinations: '{(taken or {FINEST}).pop()}' names another run"
            )
        return self

    def variants(self) -> tuple["Variant", ...]:
        """The finest run, the values of factors one at a time, the combinations; without seeds."""
        found = [Variant(Point({}, name=FINEST, overrides=self.finest), {})]
        for factor in self.factors if self.one_at_a_time is None else self.one_at_a_time:
            for value in self.factors[factor]:
                found.append(self._variant(f"{factor}: {value}", {factor: value}))
        return (*found, *(self._variant(name, chosen) for name, chosen in self.combinations.items()))

    def _variant(self, name: str, factors: dict[str, str]) -> "Variant":
        own = [change for factor, value in factors.items() for change in self.factors[factor][value]]
        return Variant(Point({}, name=name, overrides=(*self.finest, *own)), factors)


@dataclass(frozen=True)
class Variant:
    """A run of a study, without its seed."""

    point: Point
    factors: dict[str, str]  # those that differ from the finest


def read_design(path: Path) -> StudyDesign:
    """Raises InputError for a file that is missing or is no design; a line per wrong place."""
    design: StudyDesign = validated(StudyDesign, read_document(path, str(path)), str(path))
    return design


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
