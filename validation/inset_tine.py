"""The tine of field_tine set back inside itself: what larger particles make of the size of a tool.

    python -m validation.inset_tine OUT [--inset-mm 10] [--narrower-mm 10]

Writes OUT/share.stl and OUT/shank.stl, which are convex: every facet moved inward by the first length, or the
width smaller by the second on each side.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import HalfspaceIntersection, QhullError

MESHES = Path(__file__).parents[1] / "config" / "meshes"

NEAR_M = 5e-4
"""Corners nearer to each other are one: facets between them would have no area."""


def inset(mesh: trimesh.Trimesh, by_m: float) -> trimesh.Trimesh:
    """The convex solid whose facets lie inside those of a convex one by a length.

    Raises:
        SystemExit: nothing is left of it.
    """
    hull = trimesh.convex.convex_hull(mesh)
    planes = np.column_stack(
        (hull.face_normals, by_m - np.einsum("ij,ij->i", hull.face_normals, hull.triangles[:, 0]))
    )
    _, first = np.unique(
        planes.round(5) + 0.0, axis=0, return_index=True
    )  # one for all triangles of a flat side
    planes = planes[first]
    try:
        corners = HalfspaceIntersection(planes, hull.center_mass).intersections
    except QhullError:
        raise SystemExit(f"--inset-mm {1e3 * by_m:g}: leaves nothing of the tine; give less") from None
    apart, _ = trimesh.points.remove_close(corners, NEAR_M)
    return trimesh.convex.convex_hull(apart)


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes both meshes."""
    parser = argparse.ArgumentParser(prog="python -m validation.inset_tine")
    parser.add_argument("out", type=Path)
    parser.add_argument("--inset-mm", type=float, default=0.0)
    parser.add_argument("--narrower-mm", type=float, default=0.0)
    args = parser.parse_args(arguments)
    args.out.mkdir(parents=True, exist_ok=True)
    for name in ("share", "shank"):
        mesh = inset(trimesh.load_mesh(MESHES / f"{name}.stl"), 1e-3 * args.inset_mm)
        narrow = 1.0 - 1e-3 * args.narrower_mm / mesh.bounds[1, 1]
        if narrow <= 0.0:
            raise SystemExit(f"--narrower-mm {args.narrower_mm:g}: leaves nothing of the {name}; give less")
        mesh.apply_scale((1.0, narrow, 1.0))
        mesh.export(args.out / f"{name}.stl")
    return 0


if __name__ == "__main__":
    sys.exit(main())
