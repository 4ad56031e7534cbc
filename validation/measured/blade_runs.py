"""Measured drafts of flat blades beside those of particles and of closed forms.

    python -m validation.measured TABLE.csv --out DIR [--radius-mm 10] [--seed 1] [--travel-m 0.5 1.5]
        [--processes 2]
    python -m validation.measured all

The table's columns are those of template.csv. Every soil in it is calibrated to its laboratory values. The
same call goes on where it was stopped. `all` writes the tables and the figure of REPORT.md from kept runs.
"""

import argparse
import csv
import math
import re
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from subsoil_ros.errors import InputError, SubsoilError
from subsoil_ros.experiments.laboratory_fit import calibrate
from subsoil_ros.loading.material_file import read_material, write_material
from subsoil_ros.loading.validation import validated
from subsoil_ros.scene.material import LaboratorySoil, Material

from ..blades import Blade, Soil, godwin_odogherty, mckyes_ali, perumpral
from ..narrow_blade import pulled, soil_of
from . import page

LABORATORY = (
    "source", "cohesion_pa", "friction_angle_deg", "bulk_density_kg_per_m3", "metal_friction_angle_deg",
)  # fmt: skip
COLUMNS = (
    LABORATORY[0], "soil", *LABORATORY[1:], "rake_deg", "width_m", "depth_m", "speed_m_per_s", "draft_newton",
    "draft_error_newton", "vertical_newton",
)  # fmt: skip
OPTIONAL = ("draft_error_newton", "vertical_newton")
TEXTS = ("source", "soil")
NAME = re.compile(r"[\w-]+")
RESULTS = (
    "radius_m",
    "seed",
    "simulated_newton",
    "simulated_error_newton",
    "simulated_vertical_newton",
    "particles",
    "perumpral_newton",
    "godwin_odogherty_newton",
    "mckyes_ali_newton",
)
HEAP_M = 0.05
"""A blade stands out of the surface by its depth and this, so that no heap flows over it."""

DENSITIES = (500.0, 3000.0)
"""Bulk densities that a soil on earth can have [kg/m3]."""

UNIT, CONTRADICTED = 100.0, 2.0
"""A draft that is so many times off from theory has another unit; a cohesion whose theory is so many times
above the draft is asked about."""

Row = dict[str, str | float]


def read_table(path: Path) -> list[Row]:
    """Rows with numbers. Raises InputError for other columns, no row, or a cell that is no number."""
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise InputError(
                f"{path}: columns are {', '.join(reader.fieldnames or ())}; needed are {', '.join(COLUMNS)}"
            )
        rows = []
        for number, row in enumerate(reader, start=2):
            found: Row = {}
            for key in COLUMNS:
                text = (row[key] or "").strip()
                if key in TEXTS or (key in OPTIONAL and not text):
                    found[key] = text
                    continue
                try:
                    found[key] = float(text)
                except ValueError as error:
                    raise InputError(
                        f"{path}: line {number}: {key}: given '{text}'; it must be a number"
                    ) from error
            rows.append(found)
    if not rows:
        raise InputError(f"{path}: has no row; add measured runs below its columns")
    for number, row in enumerate(rows, start=2):
        _check(row, f"{path}: line {number}")
    return rows


def _check(row: Row, where: str) -> None:
    """Raises InputError for values that no soil or blade has, or another unit; warns of a cohesion that the
    draft contradicts."""
    density = float(row["bulk_density_kg_per_m3"])
    if not DENSITIES[0] <= density <= DENSITIES[1]:
        raise InputError(
            f"{where}: bulk_density_kg_per_m3: given {density:g}; a soil has {DENSITIES[0]:g} to "
            f"{DENSITIES[1]:g}: give the moist density in kg/m3, without which no draft can be predicted"
        )
    angles = (math.radians(float(row[key])) for key in ("friction_angle_deg", "metal_friction_angle_deg"))
    cohesion, draft = float(row["cohesion_pa"]), float(row["draft_newton"])
    try:
        theory = perumpral(Soil(cohesion, next(angles), density, next(angles)), _blade(row)).draft_newton
    except ValueError as error:
        raise InputError(f"{where}: {error}") from error
    if not theory / UNIT < draft < theory * UNIT:
        raise InputError(
            f"{where}: draft_newton: given {draft:g}; theory (Perumpral) says {theory:.3g} N with "
            f"cohesion_pa {cohesion:g}: are both in N and Pa?"
        )
    if cohesion > 0.0 and theory > CONTRADICTED * draft:
        print(
            f"{where}: cohesion_pa: {cohesion:g} makes {theory:.3g} N by theory (Perumpral), measured are "
            f"{draft:g} N: is it the intercept of a curved envelope? A dry sand has no cohesion",
            file=sys.stderr,
        )


def _blade(row: Row) -> Blade:
    width, depth, rake, speed = (
        float(row[key]) for key in ("width_m", "depth_m", "rake_deg", "speed_m_per_s")
    )
    return Blade(width, depth, math.radians(rake), speed)


def calibrated(
    rows: list[Row], radius_m: float, folder: Path, processes: int
) -> dict[str, tuple[Path, Material]]:
    """File and material of each soil in a table; one that is in the folder is not calibrated again.

    Raises:
        SubsoilError: values that no soil has, two sets of them for one soil, or a file of others.
    """
    soils: dict[str, LaboratorySoil] = {}
    for row in rows:
        name, values = str(row["soil"]), {key: row[key] for key in LABORATORY}
        if not NAME.fullmatch(name):
            raise InputError(f"soil '{name}': allowed are letters, digits, _ and -")
        soil = validated(LaboratorySoil, {"model": "laboratory", "name": name, **values}, f"soil {name}")
        if soils.setdefault(name, soil) != soil:
            raise InputError(f"soil '{name}': has several sets of laboratory values; give each a name")
    folder.mkdir(parents=True, exist_ok=True)
    found = {}
    for name, soil in soils.items():
        path = folder / f"{name}.yaml"
        if not path.exists():
            write_material(
                path, calibrate(soil, radius_m, processes, partial(print, file=sys.stderr, flush=True))
            )
        material = read_material(path, str(path))
        low, high = material.radii_m
        if material.soil != soil or not low <= radius_m <= high:
            raise InputError(
                f"{path}: is of other laboratory values, or of a radius less than half or more than twice "
                "this one; name another --out"
            )
        found[name] = path, material
    return found


def drawn(
    row: Row, soil: Path, radius_m: float, seed: int, travel_m: tuple[float, float] | None
) -> dict[str, float]:
    """The simulated blade of a row, and closed forms with the strength that its particles were found to have.

    travel_m: from where to where means are taken (default: as narrow_blade.pulled).
    """
    depth = float(row["depth_m"])
    blade = _blade(row)
    way = {} if travel_m is None else {"first_m": travel_m[0], "depths": travel_m[1] / depth}
    pull = pulled(str(soil.resolve()), radius_m, blade, seed=seed, above_m=depth + HEAP_M, **way)
    theory = soil_of(read_material(soil, str(soil)))
    forces = (*pull.draft, pull.vertical[0])
    forms = (form(theory, blade).draft_newton for form in (perumpral, godwin_odogherty, mckyes_ali))
    return dict(zip(RESULTS, (radius_m, seed, *forces, pull.particles, *forms), strict=True))


def kept(path: Path) -> list[dict[str, str]]:
    """Rows of the results so far."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def same(one: Mapping[str, object], other: Mapping[str, object]) -> bool:
    """Whether two rows are of one measured run, radius and seed."""
    return all(str(one[key]) == str(other[key]) for key in (*COLUMNS, "radius_m", "seed"))


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the blades that have not been drawn; keep each row as it is done; print the table."""
    parser = argparse.ArgumentParser(prog="python -m validation.measured", description=main.__doc__)
    parser.add_argument("table", type=Path, metavar="TABLE.csv", help="or: all")
    parser.add_argument("--out", type=Path, metavar="DIR")
    parser.add_argument("--radius-mm", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1, help="of the field")
    parser.add_argument("--travel-m", type=float, nargs=2, metavar=("FROM", "TO"), help="of the means")
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args(arguments)
    if str(args.table) == "all":
        page.write()
        return 0
    if args.out is None:
        parser.error("--out: give the folder that materials and results are written to")
    radius, travel = 1e-3 * args.radius_mm, tuple(args.travel_m) if args.travel_m else None
    try:
        rows = read_table(args.table)
        materials = calibrated(rows, radius, args.out, args.processes)
    except (SubsoilError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    results = args.out / "results.csv"
    settings = {"radius_m": radius, "seed": args.seed}
    missing = [row for row in rows if not any(same(row | settings, done) for done in kept(results))]
    missing.sort(key=lambda row: -float(row["depth_m"]))  # the longest first
    with ProcessPoolExecutor(args.processes, get_context("spawn")) as pool:
        jobs = {
            pool.submit(drawn, row, materials[str(row["soil"])][0], radius, args.seed, travel): row
            for row in missing
        }
        for job in as_completed(jobs):
            new = not results.is_file()
            with results.open("a", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, (*COLUMNS, *RESULTS))
                if new:
                    writer.writeheader()
                writer.writerow(jobs[job] | job.result())
    print("| soil | rake deg | width m | depth m | r mm | measured N | simulated N | Perumpral N | G-O'D N |")
    print("|---" * 9 + "|")
    for done in kept(results):
        measured, draft, half, *forms = (
            float(done[key])
            for key in ("draft_newton", *RESULTS[2:4], "perumpral_newton", "godwin_odogherty_newton")
        )
        print(
            f"| {done['soil']} | {done['rake_deg']} | {done['width_m']} | {done['depth_m']} "
            f"| {1e3 * float(done['radius_m']):g} | {measured:.0f} | {draft:.0f} +- {half:.0f} "
            f"| {forms[0]:.0f} | {forms[1]:.0f} |"
        )
    return 0
