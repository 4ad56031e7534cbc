"""Accuracy presets: named changes of a scene, and what a study measured of their error and their time."""

from typing import Any

from pydantic import ValidationError

from ..errors import SceneError
from .base import Finite, Fraction, Part, Positive


class ErrorInterval(Part):
    """Error of one metric relative to what counts as true, and the interval that holds it."""

    mean: Finite
    low: Finite
    high: Finite


class Expected(Part):
    """What a study measured of a preset. `subsoil study` writes it; nothing here is estimated."""

    against: str  # the runs that count as true
    errors: dict[str, ErrorInterval]  # by name of the metric
    errors_against: dict[str, dict[str, ErrorInterval]] = {}  # of other references, by their names
    confidence: Fraction  # of the intervals
    notes: list[str] = []  # what no error says
    wall_s_per_simulated_s: Positive
    machine: str  # that took this time
    source: str  # table, command and version


class Preset(Part):
    """One preset: a fragment that is laid over the scene, as a start is."""

    changes: dict[str, Any] = {}
    expected: Expected | None = None  # None: the study has not been run


def read_preset(content: object, place: str) -> Preset:
    """A preset of a scene document; `place` names it in errors. Raises SceneError."""
    try:
        return Preset.model_validate(content or {})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join([place, *(str(part) for part in first["loc"])])
        if first["type"] == "extra_forbidden":
            raise SceneError(f"{where}: unknown key; a preset has 'changes' and 'expected'") from error
        raise SceneError(f"{where}: {first['msg'].lower()} (given {str(first['input'])[:60]})") from error
