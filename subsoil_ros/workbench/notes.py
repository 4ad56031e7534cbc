"""What the panels share."""

from collections.abc import Callable
from typing import Any, TypeVar

from nicegui import ui

from ..errors import InputError

T = TypeVar("T")

FILES, SOIL = "/files", "/soil"
"""Addresses of the project folder, and of the soil of runs that go on."""


def columns(*names: str, **labels: str) -> list[dict[str, Any]]:
    """Columns of a table by their names; labels of others."""
    shown = dict(zip(names, names, strict=True)) | labels
    return [{"name": name, "label": label, "field": name, "align": "left"} for name, label in shown.items()]


def tell(work: Callable[[], T]) -> T | None:
    """Do it, or say on the page why not."""
    try:
        return work()
    except (InputError, OSError, UnicodeError) as error:
        ui.notify(str(error), type="negative", timeout=10_000)
        return None
