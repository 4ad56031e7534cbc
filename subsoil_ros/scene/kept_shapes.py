"""Shapes of mesh files that were found sound, in the user's cache by the content of the file.

Reading and checking needs trimesh, whose import takes every process a second.
"""

import contextlib
import functools
import hashlib
import os
import zipfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..cache_folders import user_cache_folder

Shape = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Vertices (n, 3) in the unit of the file, and facets (m, 3)."""

CHECKS = ("cad_mesh.py", "tool_mesh.py")
"""Sources that decide what is read, and what is sound."""


def sound_shape(path: Path, read: Callable[[], Shape]) -> Shape:
    """The shape of a mesh file: as it was kept, or as `read` reads and checks it, which is kept then."""
    try:
        content = path.read_bytes()
    except OSError:
        return read()  # says why
    digest = hashlib.sha256(_checks() + path.suffix.lower().encode() + content).hexdigest()
    kept = user_cache_folder() / "shapes" / f"{digest[:32]}.npz"
    damaged = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile)
    with contextlib.suppress(*damaged), np.load(kept, allow_pickle=False) as arrays:
        return arrays["vertices"], arrays["facets"]
    vertices, facets = read()
    with contextlib.suppress(OSError):  # it is read again next time
        kept.parent.mkdir(exist_ok=True)
        part = kept.with_name(f"{kept.name}.{os.getpid()}.npz")
        np.savez(part, vertices=vertices, facets=facets)
        os.replace(part, kept)
    return vertices, facets


@functools.cache
def _checks() -> bytes:
    """What the result of reading a file depends on beside the file."""
    sources = [(Path(__file__).parent / name).read_bytes() for name in CHECKS]
    return b"".join([version("trimesh").encode(), *sources])
