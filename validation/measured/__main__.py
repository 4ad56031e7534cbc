"""Measured drafts of flat blades beside those of particles and of closed forms.

    python -m validation.measured TABLE.csv --out DIR [--radius-mm 10] [--processes 2]

The table's columns are those of template.csv. Every soil in it is calibrated to its laboratory values.
"""

import argparse
import csv
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from subsoil_ros.errors import InputError, SubsoilError
from subsoil_ros.experiments.laboratory_fit import calibrate
from subsoil_ros.loading.material_file import read_material, write_material
from subsoil_ros.loading.validation import validated
from subsoil_ros.scene.material import LaboratorySoil, Material

from ..blades import Blade, godwin_odogherty, perumpral
from ..narrow_blade import pulled, soil_of

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
    "simulated_newton",
    "simulated_error_newton",
    "simulated_vertical_newton",
    "perumpral_newton",
    "godwin_odogherty_newton",
)


def read_table(path: Path) -> list[dict[str, str | float]]:
    """Rows with numbers. Raises InputError for other columns, no row, or a cell that is no number."""
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise InputError(
                f"{path}: columns are {', '.join(reader.fieldnames or ())}; needed are {', '.join(COLUMNS)}"
            )
        rows = []
        for number, row in enumerate(reader, start=2):
            found: dict[str, str | float] = {}
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
    return rows


def calibrated(
    rows: list[dict[str, str | float]], radius_m: float, folder: Path, processes: int
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
            write_material(path, calibrate(soil, radius_m, processes, lambda text: None))
        material = read_material(path, str(path))
        if material.soil != soil or material.radius_m != radius_m:
            raise InputError(f"{path}: is of other laboratory values or another radius; name another --out")
        found[name] = path, material
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table and writes it."""
    parser = argparse.ArgumentParser(prog="python -m validation.measured", description=main.__doc__)
    parser.add_argument("table", type=Path)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--radius-mm", type=float, default=10.0)
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args(arguments)
    radius = 1e-3 * args.radius_mm
    try:
        rows = read_table(args.table)
        materials = calibrated(rows, radius, args.out, args.processes)
    except (SubsoilError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    with (args.out / "results.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, (*COLUMNS, *RESULTS))
        writer.writeheader()
        print(
            "| soil | rake deg | width m | depth m | m/s | measured N | simulated N | Perumpral N | G-O'D N |"
        )
        print("|---" * 9 + "|")
        for row in rows:
            path, kept = materials[str(row["soil"])]
            blade = Blade(
                float(row["width_m"]), float(row["depth_m"]), math.radians(float(row["rake_deg"])),
                float(row["speed_m_per_s"]),
            )  # fmt: skip
            pull = pulled(str(path.resolve()), radius, blade)
            (draft, half), (vertical, _) = pull.draft, pull.vertical
            theory = soil_of(kept)
            forms = (perumpral(theory, blade).draft_newton, godwin_odogherty(theory, blade).draft_newton)
            writer.writerow(row | dict(zip(RESULTS, (draft, half, vertical, *forms), strict=True)))
            file.flush()
            print(
                f"| {row['soil']} | {row['rake_deg']:g} | {row['width_m']:g} | {row['depth_m']:g} "
                f"| {row['speed_m_per_s']:g} | {row['draft_newton']:.0f} | {draft:.0f} +- {half:.0f} "
                f"| {forms[0]:.0f} | {forms[1]:.0f} |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
