"""Write the tools of the gallery into meshes/: python examples/gallery/make_meshes.py

x forward, y left, z up, in metres. Dimensions are those of ordinary implements; walls are 12 mm thick,
about as thick as a particle, so that no particle passes through them.
"""

import math
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

THICKNESS_M = 0.012
FACING = np.array([math.sqrt(0.5), math.sqrt(0.5), 0.0])
"""Horizontal direction in which the mouldboard faces: forward and to the left."""


def bar() -> trimesh.Trimesh:
    """An upright bar of 40 x 40 mm, 0.5 m long, about its foot."""
    return trimesh.creation.box(bounds=[[-0.04, -0.02, 0.0], [0.0, 0.02, 0.5]])


def sweep() -> trimesh.Trimesh:
    """A sweep 0.25 m wide: a flat triangle that rises backward by 15 degrees, its tip at the origin."""
    length, half, rise = 0.18, 0.125, 0.18 * math.tan(math.radians(15.0))
    top = np.array([[0.0, 0.0, 0.0], [-length, half, rise], [-length, -half, rise]])
    below = np.array([[-length, half, rise - THICKNESS_M], [-length, -half, rise - THICKNESS_M]])
    return trimesh.PointCloud(np.vstack([top, below])).convex_hull


def sweep_stem() -> trimesh.Trimesh:
    """The bar that carries the sweep."""
    return trimesh.creation.box(bounds=[[-0.17, -0.015, 0.045], [-0.13, 0.015, 0.45]])


def disc() -> trimesh.Trimesh:
    """A dished disc of radius 0.16 m on a sphere of radius 0.40 m, hollow towards -y, about its centre."""
    radius, sphere = 0.16, 0.40
    r = np.linspace(0.0, radius, 9)
    hollow = np.column_stack([r, sphere - np.sqrt(sphere**2 - r**2)])
    mesh = trimesh.creation.revolve(np.vstack([hollow - [0.0, THICKNESS_M], hollow[::-1]]), sections=40)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.5 * math.pi, (1.0, 0.0, 0.0)))
    return mesh


def closed_sheet(front: NDArray[np.float64], offset: NDArray[np.float64]) -> trimesh.Trimesh:
    """A grid of points (rows, columns, 3) and the same moved by offset, closed along its rim."""
    rows, columns = front.shape[:2]
    vertices = np.vstack([front.reshape(-1, 3), (front + offset).reshape(-1, 3)])
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]
    faces += [face[:, ::-1] + rows * columns for face in faces]
    rim = [*number[0, :], *number[1:, -1], *number[-1, -2::-1], *number[-2:0:-1, 0]]
    back = [k + rows * columns for k in rim]
    for k, after in enumerate([*range(1, len(rim)), 0]):
        faces.append(np.array([[rim[after], rim[k], back[k]], [rim[after], back[k], back[after]]]))
    mesh = trimesh.Trimesh(vertices, np.vstack(faces))
    trimesh.repair.fix_normals(mesh)
    return mesh


def mouldboard() -> trimesh.Trimesh:
    """A plough body that throws to the left: share line at 45 degrees, 0.30 m wide, its tip at the origin.

    The face stands at 35 degrees at its foot and leans over at its top, more so along its length.
    """
    along, up = np.linspace(0.0, 1.0, 13), np.linspace(0.0, 1.0, 11)
    points = np.empty((len(up), len(along), 3))
    for j, s in enumerate(along):
        foot = np.array([-0.30 * s, 0.30 * s, 0.0])
        first, last = math.radians(35.0), math.radians(90.0 + 50.0 * s)
        place = np.zeros(2)  # away from the share line, up
        for i, part in enumerate(up):
            if i:
                angle = first + (last - first) * (part - 0.05)
                place = place + 0.032 * np.array([math.cos(angle), math.sin(angle)])
            points[i, j] = foot - FACING * place[0] + [0.0, 0.0, place[1]]
    return closed_sheet(points, -THICKNESS_M * FACING)


def rotor() -> trimesh.Trimesh:
    """A tiller's rotor along y: a shaft and six L-shaped knives on a circle of 0.20 m."""
    shaft = trimesh.creation.cylinder(radius=0.03, height=0.30, sections=24)
    shaft.apply_transform(trimesh.transformations.rotation_matrix(0.5 * math.pi, (1.0, 0.0, 0.0)))
    parts = [shaft]
    for k in range(6):
        side = 1.0 if k % 2 else -1.0
        y = 0.10 * (k % 3 - 1)
        arm = trimesh.creation.box(bounds=[[-0.02, y - 0.006, 0.025], [0.02, y + 0.006, 0.20]])
        low, high = sorted((y + 0.004 * side, y + 0.06 * side))
        foot = trimesh.creation.box(bounds=[[-0.025, low, 0.188], [0.025, high, 0.20]])
        turn = trimesh.transformations.rotation_matrix(k * math.pi / 3.0, (0.0, 1.0, 0.0))
        for part in (arm, foot):
            part.apply_transform(turn)
            parts.append(part)
    return trimesh.util.concatenate(parts)


def cone() -> trimesh.Trimesh:
    """A cone of 30 degrees and 80 mm on a rod, its tip at the origin (ASAE S313, four times as large)."""
    height = 0.04 / math.tan(math.radians(15.0))
    profile = [[0.0, 0.0], [0.04, height], [0.025, height + 0.002], [0.025, 0.55], [0.0, 0.55]]
    return trimesh.creation.revolve(profile, sections=32)


MESHES = (bar, sweep, sweep_stem, disc, mouldboard, rotor, cone)

if __name__ == "__main__":
    folder = Path(__file__).with_name("meshes")
    for make in MESHES:
        mesh = make()
        mesh.export(folder / f"{make.__name__}.stl")
        print(f"{make.__name__}: {len(mesh.faces)} facets, {mesh.volume * 1e6:.0f} cm3")
