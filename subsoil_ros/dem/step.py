"""A soil step up to the tools in one call.

Called from Python one by one, the kernels' sixty arguments cost 50 us a step if the particles fill the cache:
5 % of a step of 9,000 particles.
"""

from numba import njit

from .integration import kick_drift
from .pairs import pair_forces
from .walls import wall_forces


@njit(cache=True, nogil=True, error_model="numpy")
def drift_and_contacts(motion, pairs, walls, kicks, contacts):
    """kick_drift unless `kicks` is 0, then, if `contacts` is true, the forces of pairs and walls.

    `motion`, `pairs` and `walls` hold the arguments of kick_drift (all but the last), pair_forces and
    wall_forces. Returns the number of particles that have left the reach of their lists; if there are any,
    no forces were computed.
    """
    far = kick_drift(*motion, kicks) if kicks > 0 else 0
    if contacts and far == 0:
        pair_forces(*pairs)
        wall_forces(*walls)
    return far
