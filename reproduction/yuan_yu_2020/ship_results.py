"""Copies the tables of a run into results/: its comparison with the paper, and its provenance.

    python -m reproduction.yuan_yu_2020.ship_results RUN NAME --command "subsoil run ..." \
        [--figure NAME.png ...]

RUN is a folder that `subsoil run` made and `compare` finished. Left in results/NAME: reproduction.csv, .md,
provenance.json (command, commit, scene hash, window, wall time), and the figures that a page shows, with 256
colours and at most 1200 pixels wide. Bag and series are not copied: they are large, and the command makes
them again.
"""

import argparse
import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from . import RESULTS

KEPT = ("reproduction.csv", "reproduction.md")
LARGEST_WIDTH = 1200
"""Of a picture [pixels]."""


def ship_picture(source: Path, target: Path) -> None:
    """Copy a picture with fewer colours and pixels."""
    with Image.open(source) as picture:
        shown = picture.convert("RGB")
    if shown.width > LARGEST_WIDTH:
        height = round(shown.height * LARGEST_WIDTH / shown.width)
        shown = shown.resize((LARGEST_WIDTH, height), Image.Resampling.LANCZOS)
    shown.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(target, optimize=True)


def ship(run: Path, name: str, command: str, figures: Sequence[str]) -> Path:
    """Fills results/NAME anew."""
    target = RESULTS / name
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    for file in KEPT:
        shutil.copy(run / file, target / file)
    for file in figures:
        ship_picture(run / "figures" / file, target / file)
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    commit = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=RESULTS.parent, capture_output=True, text=True, check=True
    ).stdout.strip()
    provenance = {
        "command": command,
        "commit": commit,
        "scene": summary["scene"]["name"],
        "scene_hash": summary["scene"]["hash"],
        "particle_count": summary["particles"]["count"],
        "wall_s": summary["run"]["wall_s"],
        "window": summary["window"],
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
    parser.add_argument("--command", required=True, help="command that made the run, as text")
    parser.add_argument("--figure", nargs="+", default=[], metavar="NAME.png", help="figures for pages")
    args = parser.parse_args()
    print(ship(args.run, args.name, args.command, args.figure))


if __name__ == "__main__":
    main()
