"""Meshes of CAD programs: formats, units, and turning them upright. Results are STL files in metres."""

import hashlib
import io
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..cache_folders import user_cache_folder
from ..errors import SceneError
from ..extras import require
from .tools import METRES, Blade, MeshUnit, Upward

if TYPE_CHECKING:
    import trimesh

STEP = (".step", ".stp")
FORMATS = (".stl", ".obj", ".3mf", *STEP)

CHORD_M = 5e-4
"""Largest distance of a facet from the surface of a STEP file: small beside the particles, 5 mm and more."""

SMALLEST_M, LARGEST_M = 0.005, 10.0
"""Sizes of tools that work soil: smaller and larger ones are probably in another unit."""

LIKELY_M = (0.05, 5.0)
"""Sizes of whole tools in metres; outside of them the unit of a file without one is asked for."""


def size_of(mesh: "trimesh.Trimesh") -> str:
    """Edges of the mesh's box in words."""
    return " x ".join(f"{edge:.4g}" for edge in np.ptp(mesh.vertices, axis=0))


def read_cad(path: Path, where: str) -> "tuple[trimesh.Trimesh, float | None]":
    """The mesh in the unit of its file, and metres per unit; None where the format names no unit.

    Raises:
        SceneError: another format, a file that cannot be read or holds no facets.
        InputError: STEP or 3MF without the libraries that read it.
    """
    import trimesh

    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise SceneError(f"{where}: given a '{path.suffix}' file, allowed are {', '.join(FORMATS)}")
    more: dict[str, Any] = {}
    if kind == ".3mf":
        require(f"{where}: reading 3MF", "lxml", "networkx")
    if kind in STEP:
        require(f"{where}: reading STEP", "cascadio")
        more = {"tol_linear": CHORD_M * 1e3}  # in millimetres
    try:
        content = path.read_bytes()
    except OSError as error:
        raise SceneError(
            f"{where}: {error.strerror}; give the path of a mesh, seen from the folder of the scene file"
        ) from error
    if kind == ".stl":
        _refuse_cut_off(content, where)
    try:
        loaded = trimesh.load_scene(io.BytesIO(content), file_type=kind[1:], **more)
        mesh = loaded.to_mesh()
    except Exception as error:  # trimesh raises whatever its parsers meet
        words = " ".join(str(error).split())
        raise SceneError(f"{where}: cannot be read as {kind[1:].upper()}: {words}") from error
    if len(mesh.faces) == 0:
        raise SceneError(f"{where}: holds no facets; it is empty or no {kind[1:].upper()} file")
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    if kind in STEP:
        return mesh, 1.0
    named = loaded.units if kind == ".3mf" else None
    return mesh, trimesh.units.unit_conversion(named, "meters") if named else None


def metres_per_unit(mesh: "trimesh.Trimesh", unit: MeshUnit | None, where: str) -> float:
    """Metres per unit of a file that names none: of `unit`, else 1 where that is the size of a tool.

    Raises:
        SceneError: no unit is given, and in metres no tool is of this size.
    """
    if unit is not None:
        return METRES[unit]
    size = float(np.ptp(mesh.vertices, axis=0).max())
    low, high = LIKELY_M
    if low <= size <= high:
        return 1.0
    likely = [name for name, metres in METRES.items() if low <= size * metres <= high]
    sizes = ", ".join(f"unit: {name} for {size * METRES[name]:.3g} m" for name in likely or METRES)
    raise SceneError(
        f"{where}: is {size_of(mesh)} large, and the file names no unit; in metres no tool is of that size. "
        f"Give {sizes}"
    )


def refuse_absurd(mesh: "trimesh.Trimesh", metres: float, where: str) -> None:
    """Raise SceneError for a size that no tool has, in the unit that is named."""
    size = metres * float(np.ptp(mesh.vertices, axis=0).max())
    if not SMALLEST_M <= size <= LARGEST_M:
        raise SceneError(
            f"{where}: is {size:.3g} m large, and no tool is below {SMALLEST_M:g} m or above "
            f"{LARGEST_M:g} m; correct its unit: in the file, or by 'unit'"
        )


def blade_mesh(blade: Blade, height_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (8, 3) [m] and facets (12, 3) of a blade, its cutting edge along y through the origin."""
    import trimesh

    rake, under = math.radians(blade.rake_deg), math.radians(blade.clearance_deg)
    lean, behind = height_m / math.tan(rake), blade.thickness_m / math.sin(rake)
    heel = blade.thickness_m / math.sin(rake - under)  # along the underside to the back
    profile = [(0.0, 0.0), (-lean, height_m), (-lean - behind, height_m),
               (-heel * math.cos(under), heel * math.sin(under))]  # fmt: skip
    sides = (-0.5 * blade.width_m, 0.5 * blade.width_m)
    hull = trimesh.convex.convex_hull(np.array([(x, y, z) for x, z in profile for y in sides]))
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def turned_upright(
    mesh: "trimesh.Trimesh", up: Upward, rotation_deg: tuple[float, float, float]
) -> np.ndarray:
    """Vertices (n, 3) with the axis `up` of the file turned to z, then about x, y and z in this order."""
    import trimesh

    vertices = np.asarray(mesh.vertices)
    if up == "y":
        vertices = vertices[:, [0, 2, 1]] * (1.0, -1.0, 1.0)
    x, y, z = map(math.radians, rotation_deg)
    turn = trimesh.transformations.euler_matrix(x, y, z, "sxyz")[:3, :3]
    return vertices @ turn.T


def write_stl(vertices_m: np.ndarray, faces: np.ndarray, name: str) -> Path:
    """The file of a mesh in the user's cache, named by its content; equal meshes have one file.

    Raises:
        SceneError: it cannot be written.
    """
    import trimesh

    content = trimesh.Trimesh(vertices_m, faces, process=False).export(file_type="stl")
    assert isinstance(content, bytes)
    digest = hashlib.sha256(content).hexdigest()[:16]
    folder = user_cache_folder() / "meshes"
    path = folder / f"{name}-{digest}.stl"
    try:
        folder.mkdir(exist_ok=True)
        if not path.is_file():
            part = folder / f"{path.name}.{os.getpid()}"
            part.write_bytes(content)
            os.replace(part, path)
    except OSError as error:
        raise SceneError(
            f"{path}: cannot be written ({error.strerror}); set XDG_CACHE_HOME to a folder that can, or "
            "export the tool as STL in metres, turned upright"
        ) from error
    return path


def _refuse_cut_off(content: bytes, where: str) -> None:
    """Raise SceneError for an STL file that ends before its last facet."""
    is_text = content.lstrip().startswith(b"solid") and b"facet" in content[:1000]
    missing = ""
    if is_text and b"endsolid" not in content:
        missing = "it has no 'endsolid'"
    elif not is_text and len(content) >= 84:
        count, held = int.from_bytes(content[80:84], "little"), (len(content) - 84) // 50
        missing = f"{held} of its {count} facets are there" if held < count else ""
    if missing:
        raise SceneError(f"{where}: is cut off: {missing}; copy or export it again")
