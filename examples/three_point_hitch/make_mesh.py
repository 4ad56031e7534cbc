"""Writes tine.stl: a straight blade 60 mm wide and 0.30 m tall at a rake of 60 degrees, origin at the top."""

import math
from pathlib import Path

import numpy as np
import trimesh

WIDTH_M, DEPTH_M, THICKNESS_M = 0.06, 0.30, 0.03
RAKE_RAD = math.radians(60.0)


def main() -> None:
    """Extrudes the profile in x and z along y."""
    forward = DEPTH_M / math.tan(RAKE_RAD)
    profile = np.array(
        [(0.0, 0.0), (forward, -DEPTH_M), (forward - THICKNESS_M, -DEPTH_M), (-THICKNESS_M, 0.0)]
    )
    corners = [(x, y, z) for y in (-0.5 * WIDTH_M, 0.5 * WIDTH_M) for x, z in profile]
    trimesh.convex.convex_hull(np.array(corners)).export(Path(__file__).parent / "tine.stl")


if __name__ == "__main__":
    main()
