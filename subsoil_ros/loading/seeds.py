"""The key of a scene that changes its random bed."""

from ..errors import InputError
from ..scene.bed_kinds import Bed, DenseRandomBed, GridBed, TiledBed
from ..scene.soil import Soil
from ..scene.wedge_soil import WedgeSoil
from .loader import ResolvedScene


def is_random(bed: Bed) -> bool:
    """Whether the bed depends on a seed."""
    return isinstance(bed, (DenseRandomBed, TiledBed)) or (isinstance(bed, GridBed) and bed.jitter_m > 0.0)


def seed_key(scene: ResolvedScene) -> str:
    """Return the key of the seed of the bed.

    Raises:
        InputError: nothing in the scene's soil is random, so that seeds would change nothing.
    """
    soil = scene.scene.soil
    if isinstance(soil, WedgeSoil):
        return "soil.seed"
    bed = soil.bed if isinstance(soil, Soil) else None
    if bed is not None and is_random(bed):
        return "soil.bed.seed"
    what = "there is no soil" if bed is None else f"soil.bed is of kind '{bed.kind}' without jitter"
    if bed is not None and bed.kind == "saved":
        what = "soil.bed is a saved one"
    raise InputError(
        f"{scene.path}: seeds would change nothing: {what}. Use a tiled or a dense_random bed, or a grid "
        "with soil.bed.jitter_m, for instance a hundredth of a radius"
    )
