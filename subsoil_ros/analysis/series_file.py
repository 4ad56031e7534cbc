"""series.csv, read back."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .series import Series


def read_table_csv(path: Path) -> dict[str, NDArray[Any]]:
    """Columns (n,) of a CSV file of numbers, by name: float64, or int64 where all of a column is whole.

    Raises:
        InputError: the file is not there, has no row, or a cell is no number.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = [row for row in csv.reader(stream) if row and not row[0].lstrip().startswith("#")]
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text in UTF-8; save it as CSV") from error
    if len(rows) < 2:
        raise InputError(f"{path}: holds {len(rows)} lines; needed is one of column names, then the numbers")
    names = [name.strip() for name in rows[0]]
    if len(set(names)) != len(names) or not all(names):
        raise InputError(f"{path}: line 1: a column has no name, or two have the same; name each once")
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise InputError(f"{path}: row {number} has {len(row)} cells, the first {len(names)}")
    columns = zip(*rows[1:], strict=True)
    return {name: _numbers(path, name, cells) for name, cells in zip(names, columns, strict=True)}


def _numbers(path: Path, name: str, cells: tuple[str, ...]) -> NDArray[Any]:
    try:
        return np.array([int(cell) for cell in cells], dtype=np.int64)
    except (ValueError, OverflowError):
        pass
    numbers = []
    for number, cell in enumerate(cells, 2):
        try:
            numbers.append(float(cell))
        except ValueError:
            raise InputError(
                f"{path}: row {number}, column '{name}': '{cell[:40]}' is no number; numbers are written as "
                "1234.5, without thousands separators"
            ) from None
    return np.array(numbers)


def read_series_csv(path: Path) -> Series:
    """The series that write_series_csv wrote, the same bits; run id and wall time are of summary.json beside.

    Raises:
        InputError: as read_table_csv, or it has no column time_s.
    """
    columns = read_table_csv(path)
    if "time_s" not in columns:
        raise InputError(f"{path}: has no column 'time_s'; it is no series of a run")
    columns["time_s"] = columns["time_s"].astype(np.float64)
    try:
        summary = json.loads((path.parent / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        summary = {}
    return Series(columns, str(summary.get("run_id", "")), float(summary.get("wall_s") or 0.0))
