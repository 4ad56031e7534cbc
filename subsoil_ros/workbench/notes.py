"""What the panels share."""

from collections.abc import Callable
from typing import TypeVar

from nicegui import ui

from ..errors import InputError

T = TypeVar("T")

FILES, SOIL = "/files", "/soil"
"""Addresses of the project folder, and of the soil of runs that go on."""


def tell(work: Callable[[], T]) -> T | None:
    """Do it, or say on the page why not."""
    try:
        return work()
    except (InputError, OSError, UnicodeError) as error:
        ui.notify(str(error), type="negative", timeout=10_000)
        return None
