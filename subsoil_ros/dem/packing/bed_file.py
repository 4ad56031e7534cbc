"""A prepared bed as one file: written whole or not at all, and read with every check a run relies on; kept in
the user's cache folder by the hash of everything that made it."""

import contextlib
import hashlib
import json
import os
import tempfile
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ...cache_folders import user_cache_folder
from ...errors import SceneError
from ...loading.loader import ResolvedScene
from ...scene.bed_kinds import TiledBed
from ...scene.pair_laws import layer_soils, rest_spacing_m
from ...scene.soil import Soil
from ...source_digest import PACKAGE, law_digests, tree_digest
from ..bed import Bed
from ..periodic import refuse_narrow_period
from .bed_geometry import LARGEST_OVERLAP, pairs_in_reach, sample_edge_m

FORMAT = "subsoil_ros bed"
VERSION = 3

_ARRAYS = {
    "positions_m": (np.float64, 2),
    "lower_m": (np.float64, 1),
    "upper_m": (np.float64, 1),
    "kinetic_energy_joule": (np.float64, 0),
    "radii_m": (np.float64, 1),  # of length 0 where all are equal
    "materials": (np.int64, 1),  # of length 0 without layers
    "held": (np.bool_, 1),  # of length 0 where no particle is
}

CONTACTS = ("contact_pair", "contact_history")
"""Further arrays of the block of a field."""

SOURCES = (
    *(PACKAGE / "dem").glob("*.py"),
    *(PACKAGE / folder for folder in ("dem/packing", "contact_laws", "scene", "limits")),
)
"""Code that a bed depends on."""

_OF_THE_RUN = {
    "time_step_s", "precision", "engine", "device", "skin_m", "max_tool_overlap_m", "max_lost_particles",
    "monitors", "bonds",
}  # fmt: skip
"""Keys of the soil that its bed does not depend on."""


def law_hash(soil: Soil) -> str:
    """sha256 hex of law, particles and layers, which a scene must share with its bed file."""
    content = soil.model_dump(mode="json", include={"law", "particles", "layers"})
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def write_bed(path: Path, bed: Bed, soil: Soil, contacts: tuple[np.ndarray, ...] = ()) -> None:
    """Write `bed`, prepared under the law of `soil`, as a compressed .npz; atomic.

    contacts: pairs and histories of the block of a field, CONTACTS.

    Raises:
        OSError: the folder cannot be written to; nothing is left behind.
    """
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
        try:
            np.savez_compressed(
                file,
                format=np.array(FORMAT),
                version=np.array(VERSION),
                law_hash=np.array(law_hash(soil)),
                positions_m=bed.positions_m,
                lower_m=np.array(bed.lower_m),
                upper_m=np.array(bed.upper_m),
                kinetic_energy_joule=np.array(bed.kinetic_energy_joule),
                radii_m=np.empty(0) if bed.radii_m is None else bed.radii_m,
                materials=np.empty(0, np.int64) if bed.materials is None else bed.materials,
                held=np.empty(0, np.bool_) if bed.held is None else bed.held,
                sides=np.array(bed.sides),
                **dict(zip(CONTACTS, contacts, strict=False)),  # type: ignore[arg-type]
            )
            file.flush()
            os.chmod(file.name, 0o644)
            os.replace(file.name, path)
        except BaseException:
            os.unlink(file.name)
            raise


def read_bed(path: Path, soil: Soil) -> Bed:
    """The bed of a file that `write_bed` made, checked against the soil that it is read for.

    Raises:
        SceneError: file missing, damaged, of another kind, version or law; a bed that does not fit the
            bin, a particle outside it, or particles that overlap beyond LARGEST_OVERLAP.
    """
    where = f"soil.bed.file: {path}"
    content = _content(path, where)
    if content["law_hash"] != law_hash(soil):
        raise SceneError(
            f"{where}: was prepared under another law or with other particles (hash "
            f"{str(content['law_hash'])[:12]}, this scene has {law_hash(soil)[:12]}); prepare it anew with "
            "this scene's soil.law, soil.particles and soil.layers"
        )
    if content["sides"] != soil.bin.bed_sides:
        raise SceneError(
            f"{where}: was prepared between sides '{content['sides']}', soil.bin.sides is "
            f"'{soil.bin.sides}'; give the scene the sides of the bed, or prepare the bed anew"
        )
    lower, upper = content["lower_m"].tolist(), content["upper_m"].tolist()
    bed = Bed(
        np.ascontiguousarray(content["positions_m"]),
        (lower[0], lower[1], lower[2]),
        (upper[0], upper[1]),
        float(content["kinetic_energy_joule"]),
        content["radii_m"] if soil.particles.sizes else None,
        content["materials"] if soil.layers is not None else None,
        soil.bin.bed_sides,
        content["held"] if len(content["held"]) else None,
    )
    _refuse_wrong_bin(bed, soil, where)
    refuse_narrow_period(bed, soil)
    _refuse_wrong_particles(bed, soil, where)
    return bed


def _content(path: Path, where: str) -> dict[str, Any]:
    """The arrays of a bed file, their format, version, types and shapes checked."""
    damaged = f"{where}: is damaged or no bed file; copy it again, or prepare the bed anew"
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {key: file[key] for key in file.files}
    except (
        ValueError,
        EOFError,
        KeyError,
        zipfile.BadZipFile,
        zlib.error,
        AttributeError,
        RuntimeError,
    ) as error:
        raise SceneError(f"{damaged} ({' '.join(str(error).split())})") from error
    except OSError as error:
        raise SceneError(f"{where}: cannot be read ({error.strerror or error}); give a bed file") from error
    if content.get("format", np.array("")).tolist() != FORMAT:
        raise SceneError(f"{damaged} (its format is not '{FORMAT}')")
    version = content.get("version", np.array(None)).tolist()
    if version != VERSION:
        raise SceneError(f"{where}: has version {version}, readable is {VERSION}; prepare the bed anew")
    for key, (kind, dimensions) in _ARRAYS.items():
        array = content.get(key)
        if array is None or array.ndim != dimensions or array.dtype != kind:
            raise SceneError(f"{damaged} ('{key}' is missing or no array of {dimensions} dimensions)")
    shapes = [content[key].shape for key in ("positions_m", "lower_m", "upper_m")]
    if shapes[0][0] < 1 or shapes[0][1:] != (3,) or shapes[1:] != [(3,), (2,)]:
        raise SceneError(f"{damaged} (arrays of shape {shapes})")
    for key in ("law_hash", "sides"):
        content[key] = str(content.get(key, ""))
    return content


def _refuse_wrong_bin(bed: Bed, soil: Soil, where: str) -> None:
    """Raise SceneError if the bed differs from the bin by more than a particle spacing and 2 %."""
    low, high = bed.lower_m, bed.upper_m
    found = (high[0] - low[0], high[1] - low[1], -bed.floor_m)
    wanted = (soil.bin.length_m, soil.bin.width_m, soil.bin.depth_m)
    if not np.allclose(found, wanted, rtol=0.02, atol=1.001 * rest_spacing_m(soil)):
        raise SceneError(
            f"{where}: is a bed of {found[0]:.4g} x {found[1]:.4g} x {found[2]:.4g} m, soil.bin is "
            f"{wanted[0]:g} x {wanted[1]:g} x {wanted[2]:g} m; give soil.bin the size of the bed"
        )


def _refuse_wrong_particles(bed: Bed, soil: Soil, where: str) -> None:
    x = bed.positions_m
    count, bounds = len(x), soil.particles.bounds_m
    for key, array, allowed in (
        ("radii_m", bed.radii_m, bounds),
        ("materials", bed.materials, (0, len(layer_soils(soil)) - 1)),
    ):
        if array is None:
            continue
        if len(array) != count or not ((array >= allowed[0]) & (array <= allowed[1])).all():
            raise SceneError(
                f"{where}: has {len(array)} {key} for {count} particles, each to be from {allowed[0]:g} to "
                f"{allowed[1]:g}; prepare the bed anew"
            )
    if bed.held is not None and len(bed.held) != count:
        raise SceneError(
            f"{where}: has {len(bed.held)} values of 'held' for {count} particles, allowed is one each; "
            "prepare the bed anew"
        )
    inside = (x >= bed.lower_m).all(axis=1) & (x[:, :2] <= bed.upper_m).all(axis=1)  # not a number: outside
    if not inside.all():
        k = int(np.argmin(inside))
        raise SceneError(
            f"{where}: particle {k} at {x[k].tolist()} m is outside the bin, {np.sum(~inside) - 1} others "
            "too; prepare the bed anew"
        )
    bonds = pairs_in_reach(bed, soil)
    share = bonds.excess_m / bonds.smaller_m
    if share.max(initial=0.0) > LARGEST_OVERLAP:
        k = int(np.argmax(share))
        first, second = sorted(bonds.pair[k].tolist())
        raise SceneError(
            f"{where}: particles {first} and {second} overlap by {bonds.excess_m[k]:.3g} m more than at "
            f"rest, allowed is {LARGEST_OVERLAP * bonds.smaller_m[k]:.3g} m; they would be shot apart: "
            "prepare the bed anew"
        )


def bed_path(resolved: ResolvedScene) -> Path:
    """Path in the cache of the bed of a scene, or of the block of its field."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    described = soil.model_dump(mode="json", exclude=_OF_THE_RUN)
    if described.pop("window") is not None:  # the block of its field
        described["edge_m"] = sample_edge_m(soil)
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


def sample_path(soil: Soil, edge_m: float) -> Path:
    """Path in the cache of the sample of a tiled bed, which serves all bins and laws."""
    assert isinstance(soil.bed, TiledBed)
    content = {
        "particles": soil.particles.model_dump(mode="json", include={"radius_m", "sizes"}),
        "bed": [soil.bed.seed, soil.bed.solid_fraction, edge_m],
        "code": tree_digest(SOURCES),
        "version": VERSION,
    }
    key = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return user_cache_folder() / "beds" / f"sample-{key[:32]}.npz"


def load_bed(path: Path, soil: Soil) -> Bed | None:
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


def store_bed(path: Path, bed: Bed, soil: Soil, contacts: tuple[np.ndarray, ...] = ()) -> None:
    """Keep a bed for later runs; where the folder cannot be written to, they prepare it again."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bed(path, bed, soil, contacts)
