"""Measured forces beside those of particles and of closed forms.

    python -m validation.measured TABLE.csv --out DIR [--radius-mm 10] [--seed 1] [--travel-m 0.5 1.5]
        [--processes 2]
    python -m validation.measured all

The table's columns are those of template.csv (blades) or template_plates.csv. Every soil in it is calibrated
to its laboratory values. The same call goes on where it was stopped. `all` writes the tables and the figure
of REPORT.md from kept runs.
"""

import argparse
import csv
import re
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from subsoil_ros.errors import InputError, SubsoilError
from subsoil_ros.experiments.laboratory_fit import calibrate
from subsoil_ros.loading.material_file import read_material, write_material
from subsoil_ros.loading.validation import validated
from subsoil_ros.scene.material import LaboratorySoil

from . import page
from .blade_table import BLADES
from .plate_table import PLATES
from .table import LABORATORY, SETTINGS, Kind, Row, kind_of

NAME = re.compile(r"[\w-]+")
RESULTS = "results.csv"


def calibrated(rows: list[Row], radius_m: float, folder: Path, processes: int) -> dict[str, Path]:
    """File of the material of each soil in a table; one that is in the folder is not calibrated again.

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
        found[name] = path
    return found


def kept(path: Path) -> list[dict[str, str]]:
    """Rows of the results so far."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def same(one: Mapping[str, object], other: Mapping[str, object], kind: Kind) -> bool:
    """Whether two rows are of one measured run, radius and seed."""
    return all(str(one[key]) == str(other[key]) for key in (*kind.header, *SETTINGS))


def simulate(kind: Kind, rows: list[Row], soils: Mapping[str, Path], args: argparse.Namespace) -> None:
    """Run what is missing, and keep each row as it is done."""
    results, settings = (
        args.out / RESULTS,
        dict(zip(SETTINGS, (1e-3 * args.radius_mm, args.seed), strict=True)),
    )
    groups: dict[object, list[Row]] = defaultdict(list)
    for row in rows:
        if not any(same(row | settings, done, kind) for done in kept(results)):
            groups[kind.group(row)].append(row)
    with ProcessPoolExecutor(args.processes, get_context("spawn")) as pool:
        jobs = {
            pool.submit(
                kind.simulate, group, soils[str(group[0]["soil"])], *settings.values(), args.travel_m
            ): group
            for group in groups.values()
        }
        for job in as_completed(jobs):
            new = not results.is_file()
            with results.open("a", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, kind.kept)
                if new:
                    writer.writeheader()
                writer.writerows(
                    row | settings | found for row, found in zip(jobs[job], job.result(), strict=True)
                )


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulate the rows that have not been simulated; keep each as it is done; print the table."""
    parser = argparse.ArgumentParser(prog="python -m validation.measured", description=main.__doc__)
    parser.add_argument("table", type=Path, metavar="TABLE.csv", help="or: all")
    parser.add_argument("--out", type=Path, metavar="DIR")
    parser.add_argument("--radius-mm", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1, help="of the field")
    parser.add_argument(
        "--travel-m", type=float, nargs=2, metavar=("FROM", "TO"), help="of the means of blades"
    )
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args(arguments)
    if str(args.table) == "all":
        page.write()
        return 0
    if args.out is None:
        parser.error("--out: give the folder that materials and results are written to")
    try:
        kind = kind_of(args.table, (BLADES, PLATES))
        rows = kind.read(args.table)
        other = kept(args.out / RESULTS)
        if other and tuple(other[0]) != kind.kept:
            raise InputError(f"{args.out / RESULTS}: is of another kind of table; name another --out")
        soils = calibrated(rows, 1e-3 * args.radius_mm, args.out, args.processes)
        simulate(kind, rows, soils, args)
    except (SubsoilError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    shown = ("soil", *kind.place, "radius_m", kind.measured, *kind.results)
    print(f"| {' | '.join(shown)} |\n" + "|---" * len(shown) + "|")
    for done in kept(args.out / RESULTS):
        numbers = (f"{float(done[key]):.4g}" for key in shown[1:])
        print(f"| {' | '.join((done['soil'], *numbers))} |")
    return 0
