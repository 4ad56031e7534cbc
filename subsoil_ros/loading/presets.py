"""Accuracy presets: named changes of a scene, and what a study measured of their error and their time."""

from typing import Any

from ..strict_model import Finite, Fraction, Positive, StrictModel
from ..yaml_document import Document
from .validation_errors import validated


class ErrorInterval(StrictModel):
    """Error of one metric relative to what counts as true, and the interval that holds it."""

    mean: Finite
    low: Finite
    high: Finite


class Expected(StrictModel):
    """What a study measured of a preset. `subsoil study` writes it; nothing here is estimated."""

    against: str  # the runs that count as true
    errors: dict[str, ErrorInterval]  # by name of the metric
    errors_against: dict[str, dict[str, ErrorInterval]] = {}  # of other references, by their names
    confidence: Fraction  # of the intervals
    notes: list[str] = []  # what no error says
    wall_s_per_simulated_s: Positive | None = None  # None where another scene was measured
    machine: str  # that took this time
    source: str  # table, command and version


class Preset(StrictModel):
    """One preset: a fragment that is laid over the scene, as a start is."""

    changes: dict[str, Any] = {}
    expected: Expected | None = None  # None: the study has not been run


def read_preset(content: Document, place: str) -> Preset:
    """A preset of a scene document; `place` names it in errors. Raises SceneError."""
    return validated(Preset, content, place)
