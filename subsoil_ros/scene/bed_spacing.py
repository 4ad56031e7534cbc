"""How far apart the particles of a bed stand."""

from .beds import GridBed
from .pairs import layer_soils, pair_values
from .soil import Soil


def rest_spacing_m(soil: Soil) -> float:
    """Centre to centre of a pair without load: 2 r - rest overlap [m].

    Spheres of several sizes: of two of mean volume. Layers that differ: the widest.
    """
    overlap = min(pair_values(layer)[0].rest_overlap for layer in layer_soils(soil))
    return 2.0 * soil.particles.mean_volume_radius_m - overlap


def particle_spacing_m(soil: Soil) -> float:
    """Spacing of a grid as given; without one (`rest`, and beds that are no grid) that without load [m]."""
    if isinstance(soil.bed, GridBed) and soil.bed.spacing_m != "rest":
        return soil.bed.spacing_m
    return rest_spacing_m(soil)
