"""Runs the scenes of examples/gallery and draws a picture of each: python -m dev.gallery [NAME ...]

Pictures and films go to examples/gallery/pictures; a quarter of an hour on two cores for all. Without names,
every scene of the folder but the one that the others are laid over.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "examples" / "gallery"
BASE = "soil"
VIEWS = {"disc_gang": "corner", "mouldboard": "corner", "three_shanks": "corner", "sweep": "corner"}
"""Of those whose tools reach across the travel; of the others the cut along the mid-plane."""

FILMS = {"disc_gang", "mouldboard", "rotary_tiller"}
SIZE, FILM_SIZE, FRAMES_PER_S = ("480", "270"), ("320", "180"), "10"


def scenes() -> list[str]:
    """Names of the scenes, in alphabetical order."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml") if path.stem != BASE)


def draw(name: str, folder: Path) -> None:
    """Run a scene in `folder` and write its picture, or film, beside the others."""
    run, pictures = folder / name, FOLDER / "pictures"
    view = ("--view", VIEWS.get(name, "longitudinal"))
    subsoil("run", FOLDER / f"{name}.yaml", "--mode", "direct", "--out", run)
    if name in FILMS:
        film = ("--film", pictures / f"{name}.gif", "--fps", FRAMES_PER_S)
        subsoil("render", run, *view, "--size", *FILM_SIZE, *film)
    else:
        subsoil("render", run, *view, "--size", *SIZE)
        (picture,) = (run / "pictures").glob("*.png")
        picture.replace(pictures / f"{name}.png")


def subsoil(*words: object) -> None:
    """A verb of the command line, in a process of its own."""
    subprocess.run([sys.executable, "-m", "subsoil_ros.cli.main", *map(str, words)], check=True)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Run the scenes of the gallery and draw them.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="scenes to draw (default: all)")
    args = parser.parse_args(arguments)
    known = scenes()
    unknown = sorted(set(args.names) - set(known))
    if unknown:
        parser.error(f"NAME: {unknown[0]} given; allowed are {', '.join(known)}")
    with tempfile.TemporaryDirectory() as folder:
        for name in args.names or known:
            print(name, flush=True)
            draw(name, Path(folder))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
