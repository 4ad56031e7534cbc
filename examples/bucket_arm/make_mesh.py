"""Writes bucket.stl: bottom, back and two sides of 15 mm plate, 0.2 m wide, open to -x and upward."""

from pathlib import Path

import trimesh

PLATES = {  # lower and upper corner [m], about the pin on which the bucket turns; each reaches into the next
    "bottom": ((-0.10, -0.10, -0.165), (0.10, 0.10, -0.15)),
    "back": ((0.085, -0.098, -0.155), (0.099, 0.098, 0.0)),
    "left": ((-0.06, 0.085, -0.157), (0.09, 0.099, -0.02)),
    "right": ((-0.06, -0.099, -0.157), (0.09, -0.085, -0.02)),
}


def main() -> None:
    """One closed box for each plate."""
    boxes = [trimesh.creation.box(bounds=corners) for corners in PLATES.values()]
    trimesh.util.concatenate(boxes).export(Path(__file__).parent / "bucket.stl")


if __name__ == "__main__":
    main()
