"""Edge of the tile of a tiled bed (dem.beds.tile)."""

from ...errors import SceneError
from ...scene.bed_kinds import TiledBed
from ...scene.pair_laws import layer_soils, pair_values
from ...scene.soil import Soil
from ..periodic import SMALLEST_CELLS, up_to_mm

USUAL_EDGE = 40.0
"""Edge of a tile over the mean radius if the scene gives none: some 9,000 particles. Small tiles scatter."""

MARGIN = 1.05
"""Margin of the smallest edge: a tile shrinks while it is pressed and under the law of a scene."""

SKIN = 0.3
"""Skin of the neighbour lists over the radius while settling; that of the scene may differ from run to run,
and the bed must not."""


def tile_edge_m(soil: Soil) -> float:
    """Edge of the cubic tile of a scene's bed [m]; periodic sides take a whole number of tiles.

    Raises:
        SceneError: it is larger than the bin, or its particles would not have one nearest image.
    """
    assert isinstance(soil.bed, TiledBed)
    length, width = soil.bin.length_m, soil.bin.width_m
    reach = max(pair_values(layer)[0].reach for layer in layer_soils(soil))
    radius = soil.particles.mean_volume_radius_m
    smallest = MARGIN * SMALLEST_CELLS * (2.0 * soil.particles.bounds_m[1] + reach + SKIN * radius)
    given, largest = soil.bed.tile_m, min(length, width)
    if given is not None and not smallest <= given <= largest:
        raise SceneError(
            f"soil.bed.tile_m: {given:g} m given; allowed is at least {up_to_mm(smallest):g} m, "
            f"{SMALLEST_CELLS} times the reach of a particle, and at most {largest:g} m, the smaller of "
            "soil.bin.length_m and soil.bin.width_m"
        )
    if largest < smallest:
        raise SceneError(
            f"soil.bin: {length:g} x {width:g} m is narrower than the smallest tile, "
            f"{up_to_mm(smallest):g} m, {SMALLEST_CELLS} times the reach of a particle; make the bin wider "
            "or the particles smaller"
        )
    edge = given or max(smallest, min(USUAL_EDGE * radius, largest))
    if soil.bin.sides != "periodic":
        return edge
    tiles = round(width / edge)
    return width / (tiles if width / tiles >= smallest else tiles - 1)
