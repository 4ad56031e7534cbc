"""Prepared beds kept in the user's cache folder, by the hash of everything that made them."""

import contextlib
import hashlib
import json
import zipfile
import zlib
from pathlib import Path

import numpy as np

from ...cache_folders import user_cache_folder
from ...errors import SceneError
from ...loading.loader import ResolvedScene
from ...scene.bed_kinds import TiledBed
from ...scene.soil import Soil
from ...source_digest import PACKAGE, law_digests, tree_digest
from ..bed import Bed
from .bed_file import CONTACTS, VERSION, read_bed, write_bed
from .tile_edge import tile_edge_m

SOURCES = (
    *(PACKAGE / "dem").glob("*.py"),
    *(PACKAGE / folder for folder in ("dem/beds", "contact_laws", "scene", "limits")),
)
"""Code that a bed depends on."""

_OF_THE_RUN = {
    "time_step_s", "precision", "device", "skin_m", "max_tool_overlap_m", "max_lost_particles",
    "monitors", "bonds",
}  # fmt: skip
"""Keys of the soil that its bed does not depend on."""


def cached_bed_path(resolved: ResolvedScene) -> Path:
    """Path in the cache of the bed of a scene, or of the block of its field."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    described = soil.model_dump(mode="json", exclude=_OF_THE_RUN)
    if described.pop("window") is not None:  # the block of its field
        described["edge_m"] = tile_edge_m(soil)
        described["bin"] = soil.bin.depth_m
        del described["surface"]  # cut from the field
    content = {
        "soil": described,
        "gravity_m_per_s2": resolved.scene.gravity_m_per_s2,
        "code": tree_digest(SOURCES),
        "laws": law_digests(),
        "version": VERSION,
    }
    key = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return user_cache_folder() / "beds" / f"{key[:32]}.npz"


def cached_tile_path(soil: Soil, edge_m: float) -> Path:
    """Path in the cache of the tile of a tiled bed, which serves all bins and laws."""
    assert isinstance(soil.bed, TiledBed)
    content = {
        "particles": soil.particles.model_dump(mode="json", include={"radius_m", "sizes"}),
        "bed": [soil.bed.seed, soil.bed.solid_fraction, edge_m],
        "code": tree_digest(SOURCES),
        "version": VERSION,
    }
    key = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return user_cache_folder() / "beds" / f"tile-{key[:32]}.npz"


def load_cached(path: Path, soil: Soil) -> Bed | None:
    """The bed kept at `path`; None if it is missing or damaged."""
    if not path.is_file():
        return None
    try:
        return read_bed(path, soil)
    except SceneError:
        return None  # it is prepared again and replaces the damaged file


def load_contacts(path: Path) -> tuple[np.ndarray, ...] | None:
    """The contacts kept with the bed at `path`; None if they are missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return tuple(file[name] for name in CONTACTS)
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile, zlib.error):
        return None


def keep(path: Path, bed: Bed, soil: Soil, contacts: tuple[np.ndarray, ...] = ()) -> None:
    """Keep a bed for later runs; where the folder cannot be written to, they prepare it again."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bed(path, bed, soil, contacts)
