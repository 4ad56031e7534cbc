"""What tables of measured blades and of measured plates have in common."""

import csv
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from subsoil_ros.errors import InputError

Row = dict[str, str | float]

LABORATORY = (
    "source", "cohesion_pa", "friction_angle_deg", "bulk_density_kg_per_m3", "metal_friction_angle_deg",
)  # fmt: skip
SOIL = (LABORATORY[0], "soil", *LABORATORY[1:])
TEXTS = ("source", "soil")
SETTINGS = ("radius_m", "seed")

DENSITIES = (500.0, 3000.0)
"""Bulk densities that a soil on earth can have [kg/m3]."""

UNIT, CONTRADICTED = 100.0, 2.0
"""A force that is so many times off from theory has another unit; a cohesion whose theory is so many times
above the force is asked about."""


class Kind(NamedTuple):
    """Tables of one kind of body."""

    columns: tuple[str, ...]  # after SOIL
    measured: str  # the column that is predicted
    unit: str
    optional: tuple[str, ...]
    results: tuple[str, ...]  # predicted +- interval first, then closed forms
    place: tuple[str, ...]  # columns that tell rows of one soil apart
    theory: tuple[str, Callable[[Row], float]]  # its name, and what it says of a row
    group: Callable[[Row], object]  # rows of one run
    simulate: Callable[..., list[dict[str, float]]]  # rows, material, radius, seed, travel: RESULTS of each

    @property
    def header(self) -> tuple[str, ...]:
        """Columns of a table."""
        return SOIL + self.columns

    @property
    def kept(self) -> tuple[str, ...]:
        """Columns of results."""
        return self.header + SETTINGS + self.results

    def read(self, path: Path) -> list[Row]:
        """Rows with numbers. Raises InputError for no row, a cell that is no number, a value that no soil or
        body has, or another unit; warns of a cohesion that the force contradicts."""
        with path.open(newline="", encoding="utf-8") as file:
            cells = list(csv.DictReader(file))
        if not cells:
            raise InputError(f"{path}: has no row; add measured runs below its columns")
        rows = []
        for number, row in enumerate(cells, start=2):
            found: Row = {}
            for key in self.header:
                text = (row[key] or "").strip()
                if key in TEXTS or (key in self.optional and not text):
                    found[key] = text
                    continue
                try:
                    found[key] = float(text)
                except ValueError as error:
                    raise InputError(
                        f"{path}: line {number}: {key}: given '{text}'; it must be a number"
                    ) from error
            self._check(found, f"{path}: line {number}")
            rows.append(found)
        return rows

    def _check(self, row: Row, where: str) -> None:
        density = float(row["bulk_density_kg_per_m3"])
        if not DENSITIES[0] <= density <= DENSITIES[1]:
            raise InputError(
                f"{where}: bulk_density_kg_per_m3: given {density:g}; a soil has {DENSITIES[0]:g} to "
                f"{DENSITIES[1]:g}: give the moist density in kg/m3, without which no force can be predicted"
            )
        name, form = self.theory
        cohesion, measured, unit = float(row["cohesion_pa"]), float(row[self.measured]), self.unit
        try:
            theory = form(row)
        except ValueError as error:
            raise InputError(f"{where}: {error}") from error
        if not theory / UNIT < measured < theory * UNIT:
            raise InputError(
                f"{where}: {self.measured}: given {measured:g}; theory ({name}) says {theory:.3g} {unit} "
                f"with cohesion_pa {cohesion:g}: are both in {unit} and Pa?"
            )
        if cohesion > 0.0 and theory > CONTRADICTED * measured:
            print(
                f"{where}: cohesion_pa: {cohesion:g} makes {theory:.3g} {unit} by theory ({name}), "
                f"measured are {measured:g} {unit}: is it the intercept of a curved envelope (dry sand has "
                "none), or has the soil not failed yet?",
                file=sys.stderr,
            )


def kind_of(path: Path, kinds: Sequence[Kind]) -> Kind:
    """The one whose columns a table has. Raises InputError for other columns."""
    with path.open(newline="", encoding="utf-8") as file:
        header = tuple(next(csv.reader(file), ()))
    for kind in kinds:
        if header == kind.header:
            return kind
    needed = ", or ".join(", ".join(kind.header) for kind in kinds)
    raise InputError(f"{path}: columns are {', '.join(header)}; needed are {needed}")
