"""Puts the results of a run into docs/results: tables, figures and a slim series, no bag.

    python -m benchmarks.ship_results RUN NAME --command "subsoil run ..."

RUN is a folder that `subsoil run` made and `subsoil report` finished. Left in docs/results/NAME: series.csv
with the columns that the tables compare, reproduction.*, summary.json, figures, and provenance.json (command,
commit, scene hash, wall time). tests/unit/test_shipped_results.py holds every table against its series.
"""

import argparse
import csv
import json
import shutil
import subprocess
from pathlib import Path

RESULTS = Path(__file__).parents[1] / "docs" / "results"
KEPT = ("reproduction.csv", "reproduction.json", "reproduction.md")
FIGURES = ("draft.png", "spring_force.png", "share_angle.png", "shank_height.png", "soil_cut.png",
           "over_travel.png", "disturbance.png", "spectra.png", "load_cycles.png",
           "reproduction.png")  # fmt: skip
COLUMNS = ("time_s", "draft_newton", "draft.share_newton", "draft.wheels_newton")


def slim_series(source: Path, target: Path, spring: str, shank: str) -> None:
    """Copies the columns that the tables compare, with all their digits."""
    wanted = [*COLUMNS, f"spring.{spring}.force_newton", f"spring.{spring}.length_m"]
    wanted += [f"body.{shank}.angle_rad", f"body.{shank}.z_m"]
    with source.open(newline="") as stream, target.open("w", newline="", encoding="utf-8") as out:
        reader = csv.DictReader(stream)
        names = [name for name in wanted if name in (reader.fieldnames or ())]
        writer = csv.DictWriter(out, names, lineterminator="\n", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(reader)


def ship(run: Path, name: str, command: str) -> Path:
    """Fills docs/results/NAME anew."""
    target = RESULTS / name
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    for file in KEPT:
        if (run / file).is_file():
            shutil.copy(run / file, target / file)
    for file in FIGURES:
        if (run / "figures" / file).is_file():
            shutil.copy(run / "figures" / file, target / file)
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    kept = {key: value for key, value in summary.items() if key not in ("checkpoint", "resumed_from")}
    (target / "summary.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    slim_series(run / "series.csv", target / "series.csv", "H9_spring", "shank")
    commit = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=RESULTS.parent, capture_output=True, text=True, check=True
    ).stdout.strip()
    provenance = {
        "command": command,
        "commit": commit,
        "scene": summary["scene"],
        "scene_hash": summary["scene_hash"],
        "particle_count": summary["particle_count"],
        "wall_s": summary["wall_s"],
    }
    (target / "provenance.json").write_text(json.dumps(provenance, indent=1) + "\n", encoding="utf-8")
    return target


def main() -> None:
    """Ships one run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("name")
    parser.add_argument("--command", required=True, help="that made the run, as text")
    args = parser.parse_args()
    print(ship(args.run, args.name, args.command))


if __name__ == "__main__":
    main()
