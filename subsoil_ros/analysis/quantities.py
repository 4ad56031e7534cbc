"""Quantities of a summary by their dotted paths."""

from collections.abc import Iterator, Mapping
from typing import Any


def flattened(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return every value of a summary by its path, keys joined by dots: `series.draft_newton.run.max`."""
    return dict(_leaves(summary, ""))


def _leaves(group: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in group.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def short_name(path: str) -> str:
    """Return the last word of a dotted path; where that is `value`, the one before."""
    words = path.split(".")
    return words[-2] if words[-1] == "value" and len(words) > 1 else words[-1]
