"""Conversion of dataclasses to named arrays and back, for checkpoints."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import astuple, fields
from typing import Any, TypeVar

import numpy as np

from ..messages import SpatialMotion, ToolMotion
from .bed import Bed

Record = TypeVar("Record")


def named(prefix: str, record: Any) -> dict[str, np.ndarray]:
    """The arrays of a dataclass or NamedTuple, under PREFIX.FIELD; not copied."""
    return {f"{prefix}.{name}": getattr(record, name) for name in _names(type(record))}


def _names(kind: Any) -> tuple[str, ...]:
    return getattr(kind, "_fields", None) or tuple(item.name for item in fields(kind))


def from_named(kind: type[Record], prefix: str, arrays: Mapping[str, np.ndarray]) -> Record:
    """What `named` took apart, of the same arrays.

    Raises:
        KeyError: an array is missing.
    """
    return kind(**{name: arrays[f"{prefix}.{name}"] for name in _names(kind)})


def below(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays under PREFIX., by the rest of their names."""
    start = f"{prefix}."
    return {key.removeprefix(start): array for key, array in arrays.items() if key.startswith(start)}


def motion_array(motion: ToolMotion) -> np.ndarray:
    """A motion as (7,) float64, (14,) of one in space, without the tool's name."""
    return np.array(astuple(motion)[1:], np.float64)


def motion_from(tool: str, array: np.ndarray) -> ToolMotion:
    """The motion that `motion_array` took apart."""
    numbers = array.tolist()
    return SpatialMotion(tool, *numbers) if math.isnan(numbers[3]) else ToolMotion(tool, *numbers)


def bed_digest(bed: Bed, positions_m: np.ndarray) -> np.ndarray:
    """(32,) uint8, sha256 of the particles (n, 3) [m] that a run starts from, and of their box."""
    digest = hashlib.sha256(repr((bed.lower_m, bed.upper_m, bed.sides)).encode())
    digest.update(b"" if bed.held is None else bed.held.tobytes())
    digest.update(np.ascontiguousarray(positions_m).tobytes())
    return np.frombuffer(digest.digest(), np.uint8)
