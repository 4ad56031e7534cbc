"""The series of a run: columns of numbers over time, read from its bag or from series.csv."""

import csv
import json
import math
from array import array
from collections.abc import Callable, Iterable, Mapping, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, RecordingError
from ..limits.stable_steps import derive_timing
from ..messages import CouplingReport, MechanismState, SoilState, ToolMotions, ToolWrenches
from ..recording.joined import open_record
from ..scene.scene import Scene
from ..schedule import Schedule
from ..whole_files import write_whole
from .columns import TIME, tick_cells

_BLOCK_ROWS = 1000


Column = NDArray[Any]
"""float64 or int64, (n,)."""


@dataclass(frozen=True)
class Series:
    """One row per series tick of a run.

    columns: by name, each (n,), float64 or (counts) int64; the unit is in the name. TIME is the first.
    wall_time_s: of the coupling up to the last row [s]; not a column, it differs between equal runs.
    """

    columns: dict[str, Column]
    run_id: str
    wall_time_s: float

    def __getitem__(self, name: str) -> Column:
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(self.columns[TIME])


def read_series(bag: Path, scene: Scene, on_time: Callable[[int], None] = lambda time_ns: None) -> Series:
    """The series of a bag that `scene` was recorded into; a run cut short has fewer rows.

    The series of a resumed run begins with the record of the run that it resumes.

    on_time: called with the simulated time [ns] of every message as it is read.

    Raises:
        InputError: there is no bag.
        RecordingError: it is damaged, or holds not one complete series tick.
    """
    timing = derive_timing(scene)
    schedule = Schedule.of(scene, timing)
    kinds: list[type] = [ToolMotions]
    if scene.mechanism is not None:
        kinds.append(MechanismState)
    if scene.soil is not None:
        kinds += [ToolWrenches, SoilState]
    kinds.append(CouplingReport)

    reader = open_record(bag)
    by_tick: dict[int, dict[type, Any]] = {}
    columns: dict[str, array[Any]] = {}  # 8 bytes a number, where a list takes 40
    last: CouplingReport | None = None

    def wanted(time_ns: int) -> bool:
        on_time(time_ns)
        tick, rest = divmod(time_ns, timing.communication_step_ns)
        return not rest and schedule.series_due(tick - 1)

    for record in reader.records(*kinds, at=wanted):
        records = by_tick.setdefault(record.tick, {})
        records[type(record)] = record
        if len(records) == len(kinds):
            del by_tick[record.tick]
            for name, value in tick_cells(scene, records):
                if name not in columns:
                    columns[name] = array("q" if isinstance(value, int) else "d")
                columns[name].append(value)
            last = records[CouplingReport]
    if last is None:
        raise RecordingError(
            f"{reader.path}: not one complete series tick is in it (every "
            f"{scene.record.series_ticks} ticks of {timing.communication_step_ns} ns); the run ended before, "
            "or another scene was recorded"
        )
    _refuse_ragged(columns, reader.path)
    return Series(
        {name: np.asarray(values) for name, values in columns.items()}, last.run_id, last.wall_time_s
    )


def write_series_csv(series: Series, path: Path) -> None:
    """Write every column with the shortest digits that read back to the same bits; whole, or not at all."""
    write_whole(path, lambda part: _write_rows(series, part))


def _write_rows(series: Series, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")  # in half the time of pandas
        writer.writerow(series.columns)
        for start in range(0, len(series), _BLOCK_ROWS):
            block = (column[start : start + _BLOCK_ROWS].tolist() for column in series.columns.values())
            for row in zip(*block, strict=True):
                writer.writerow([repr(value) for value in row])


def read_series_csv(path: Path) -> Series:
    """Read what write_series_csv wrote, bit for bit; run id and wall time come from summary.json beside it.

    Raises:
        InputError: as read_table_csv, or it has no column time_s.
    """
    columns = read_table_csv(path)
    if TIME not in columns:
        raise InputError(f"{path}: has no column '{TIME}'; it is no series of a run")
    columns[TIME] = columns[TIME].astype(np.float64)
    try:
        run = json.loads((path.parent / "summary.json").read_text(encoding="utf-8"))["run"]
    except (OSError, ValueError, KeyError):
        run = {}
    return Series(columns, str(run.get("id", "")), float(run.get("wall_s") or 0.0))


def write_table_csv(columns: Mapping[str, Iterable[object]], path: Path, digits: str = "") -> None:
    """Write columns (n,) as CSV, without pandas, which takes a second to import. NaN becomes an empty cell.

    digits: how floats are formatted, ".6g"; the shortest that read back to the same bits, if empty.
    """
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow([_cell(value, digits) for value in row])


def _cell(value: object, digits: str) -> str:
    if not isinstance(value, float):
        return str(value)
    return "" if math.isnan(value) else format(float(value), digits)


def read_table_csv(path: Path) -> dict[str, Column]:
    """Columns (n,) of a CSV file of numbers, by name: float64, or int64 where all of a column is whole.

    Cells are apart by commas or, as the first line has it, by semicolons or tabs, then with decimal commas.

    Raises:
        InputError: the file is not there, has no row, or a cell is no number.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        line = path.read_bytes()[: error.start].count(b"\n") + 1
        raise InputError(f"{path}: line {line} is no text in UTF-8; save it as CSV in UTF-8") from error
    lines = [line for line in lines if line.strip() and not line.lstrip(' "').startswith("#")]
    between = next((sign for sign in ";\t" if lines and sign in lines[0]), ",")
    rows = list(csv.reader(lines, delimiter=between))
    if len(rows) < 2:
        raise InputError(f"{path}: holds {len(rows)} lines; give a line of column names, then numbers")
    names = [name.strip() for name in rows[0]]
    if len(set(names)) != len(names) or not all(names):
        raise InputError(f"{path}: line 1: a column has no name, or two have the same; name each once")
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise InputError(f"{path}: row {number} has {len(row)} cells, the first {len(names)}")
    if between != ",":
        rows[1:] = [[cell.replace(",", ".", cell.count(",") == 1) for cell in row] for row in rows[1:]]
    columns = zip(*rows[1:], strict=True)
    return {name: _numbers(path, name, cells) for name, cells in zip(names, columns, strict=True)}


def _numbers(path: Path, name: str, cells: tuple[str, ...]) -> Column:
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


def _refuse_ragged(columns: Mapping[str, Sized], path: Path) -> None:
    row_count = len(columns[TIME])
    for name, values in columns.items():
        if len(values) != row_count:
            raise RecordingError(
                f"{path}: column {name} has {len(values)} values for {row_count} series ticks; "
                "the bag was not recorded from one scene"
            )


Columns = Series | Mapping[str, Column]
"""Columns by name, each (n,), with time_s among them."""


def running_mean(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Centred mean over `count` (made odd) values, over fewer at the ends, nan left out; (n,) -> (n,)."""
    half = min(count // 2, (len(values) - 1) // 2)
    if half < 1:
        return values
    known, window = ~np.isnan(values), np.ones(2 * half + 1)
    total = np.convolve(np.where(known, values, 0.0), window, "same")
    number = np.convolve(known, window, "same")
    return np.divide(total, number, out=np.full(len(values), np.nan), where=number > 0.0)


def moving_mean(columns: Columns, name: str, seconds: float) -> NDArray[np.float64]:
    """Centred mean of a column (n,) over `seconds`; the column itself where rows are farther apart."""
    return running_mean(columns[name], max(1, round(seconds / step_s(columns, seconds))))


def step_s(columns: Columns, otherwise_s: float = 1.0) -> float:
    """Time from row to row [s]; `otherwise_s` for a single row."""
    times = columns[TIME]
    return float(np.median(np.diff(times))) if len(times) > 1 else otherwise_s
