"""Passive failure in front of a raked plate: the wedge with two circular side crescents or with plane sides
that resist, and flow around; and the blocks that it fails in.

Angles [rad]: rake alpha of the plate and rupture angle beta against the horizontal, friction phi of the
soil and delta at the plate. docs/wedge.md derives the equations from equilibrium.
Sources: E. McKyes, O.S. Ali, J. Terramechanics 14 (1977) 43-58; E. McKyes, Soil Cutting and Tillage
(1985); J.V. Perumpral, R.D. Grisso, C.S. Desai, Trans. ASAE 26 (1983) 991-995; R.J. Godwin, G. Spoor,
J. Agric. Eng. Res. 22 (1977) 213-228.
"""

import math
from typing import NamedTuple

from numba import njit

SMALLEST_BETA = math.radians(1.0)
"""Smallest rupture angle of the search; that of the least force is far larger."""

GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)

SCANNED = 18
"""Number of intervals of beta, about 5 degrees each, in the scan before the golden section search."""

SEARCH_STEPS = 16
"""Steps of the search: 0.618^16 = 5e-4 of two intervals are left, 8e-5 rad. The force errs by its square."""


CRITICAL_STEPS = 16
"""Steps of the golden section search for the critical depth, to 5e-4 of the plate."""


class Strength(NamedTuple):
    """Strength of the soil. SI units."""

    unit_weight: float  # gamma [N/m3]
    density: float  # [kg/m3]
    cohesion: float  # c [Pa]
    friction: float  # phi [rad]
    adhesion: float  # c_a [Pa]
    tool_friction: float  # delta [rad]
    surcharge: float  # q [Pa]
    speed_factor: float  # on the inertia term
    plane_sides: bool = False  # the wedge's own sides resist (Perumpral); False: crescents (McKyes and Ali)


class Failure(NamedTuple):
    """How the soil in front of a plate fails."""

    beta: float  # rupture angle [rad]
    force: float  # P on the plate, at delta to its normal [N]
    length: float  # r of the wedge along the surface [m]; 0 without a wedge
    by_weight: float  # part of P that grows with depth
    by_inertia: float = 0.0  # part of P that accelerates the soil


class Plate(NamedTuple):
    """A plate in the soil. The wedge of a buried plate is that of a plate that reaches the surface."""

    width: float  # w [m]
    rake: float  # alpha [rad]
    depth: float  # d of its tip [m]
    height: float  # h of the plate above its tip [m], at most d


@njit(cache=True, error_model="numpy")
def wedge_terms(plate, soil, beta):
    """(length, weight, cohesion, surcharge, adhesion, inertia per velocity squared) of a wedge.

    length r [m]: along the surface. The others are parts of the force P on the plate [N], the last per
    velocity squared [N s2/m2]; McKyes and Ali's N_gamma = weight / (gamma d^2 w), and so on.
    """
    w, alpha, d, h = plate
    cot_alpha, cot_beta = 1.0 / math.tan(alpha), 1.0 / math.tan(beta)
    cot_reaction = 1.0 / math.tan(beta + soil.friction)
    length = d * (cot_beta + cot_alpha)
    # how far a crescent reaches sideways: r sin(eta), cos(eta) = d cot(alpha) / r (1977)
    side = 0.0 if soil.plane_sides else math.sqrt(max(length * length - (d * cot_alpha) ** 2, 0.0))
    share = 1.0 / (math.cos(alpha + soil.tool_friction) + math.sin(alpha + soil.tool_friction) * cot_reaction)
    weight = soil.unit_weight * 0.5 * d * length * (w + 2.0 * side / 3.0) * share
    cohesion = soil.cohesion * d * (1.0 + cot_beta * cot_reaction) * (w + side) * share
    surcharge = soil.surcharge * length * (w + side) * share
    if soil.plane_sides:  # two triangles, each under the pressure at rest, against the motion along the plane
        along = (math.sin(beta) + math.cos(beta) * cot_reaction) * d * length * share
        rest = (1.0 - math.sin(soil.friction)) * math.tan(soil.friction) * along
        weight += soil.unit_weight * d / 3.0 * rest
        cohesion += soil.cohesion * along
        surcharge += soil.surcharge * rest
    adhesion = soil.adhesion * h * (1.0 - cot_alpha * cot_reaction) * w * share
    tan_beta = math.tan(beta)
    inertia = soil.speed_factor * soil.density * d * w * share
    inertia *= (tan_beta + cot_reaction) / (1.0 + tan_beta * cot_alpha)
    return length, weight, cohesion, surcharge, adhesion, inertia


@njit(cache=True, error_model="numpy")
def wedge_force(plate, soil, speed, beta):
    """P(beta) [N] on the plate, at delta to its normal; speed [m/s] forward."""
    _, weight, cohesion, surcharge, adhesion, inertia = wedge_terms(plate, soil, beta)
    return weight + cohesion + surcharge + adhesion + inertia * speed * speed


@njit(cache=True, error_model="numpy")
def least_wedge(plate, soil, speed):
    """(beta, P) of the wedge that fails first: the least P over beta.

    beta + phi + alpha + delta stays below pi, where P would be infinite. In front of a narrow plate of low
    rake, P may have a second minimum at the upright plane, without crescents; so a scan precedes the search.
    """
    first = SMALLEST_BETA
    last = min(math.pi - plate.rake - soil.tool_friction - soil.friction - 1e-6, 0.5 * math.pi)
    step = (last - first) / SCANNED
    best, least = 0, math.inf
    for k in range(SCANNED + 1):
        force = wedge_force(plate, soil, speed, first + k * step)
        if force < least:
            best, least = k, force
    low, high = first + max(best - 1, 0) * step, first + min(best + 1, SCANNED) * step
    one, two = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_one, at_two = wedge_force(plate, soil, speed, one), wedge_force(plate, soil, speed, two)
    for _ in range(SEARCH_STEPS):
        if at_one < at_two:
            high, two, at_two = two, one, at_one
            one = high - GOLDEN * (high - low)
            at_one = wedge_force(plate, soil, speed, one)
        else:
            low, one, at_one = one, two, at_two
            two = low + GOLDEN * (high - low)
            at_two = wedge_force(plate, soil, speed, two)
    beta = 0.5 * (low + high)
    force = wedge_force(plate, soil, speed, beta)
    # near the upright plane crescents shrink as a root, so steeply that the search can miss its end
    upright = wedge_force(plate, soil, speed, last)
    return (last, upright) if upright < force else (beta, force)


def bearing_factors(friction: float) -> tuple[float, float]:
    """(N_c, N_q) of soil that gives way sideways, at the friction angle phi [rad].

    N_q = tan^2(45 + phi / 2) exp(pi tan phi), N_c = (N_q - 1) cot phi, pi + 2 without friction: L. Prandtl,
    Nachr. Ges. Wiss. Goettingen (1920) 74-85; H. Reissner, Proc. 1st Int. Congr. Appl. Mech. (1924) 295-311.
    """
    tangent = math.tan(friction)
    n_q = math.tan(0.25 * math.pi + 0.5 * friction) ** 2 * math.exp(math.pi * tangent)
    return (math.pi + 2.0 if tangent < 1e-9 else (n_q - 1.0) / tangent), n_q


@njit(cache=True, error_model="numpy")
def lateral_pressure(soil, depth, speed):
    """Mean pressure [Pa] at `depth` [m] on a narrow face around which the soil flows, instead of up.

    c N_c + K_0 (gamma z + q) N_q with N_q = K_p exp(2 pi tan phi), K_p = (1 + sin phi) / (1 - sin phi),
    N_c = (N_q - 1) / tan phi (2 pi + 2 without friction), K_0 = 1 - sin phi (Godwin and Spoor 1977). Speed
    adds the momentum of the soil that is pushed aside, rho v^2, which is not in their theory.
    """
    tangent, sine = math.tan(soil.friction), math.sin(soil.friction)
    n_q = (1.0 + sine) / (1.0 - sine) * math.exp(2.0 * math.pi * tangent)
    n_c = 2.0 * math.pi + 2.0 if tangent < 1e-9 else (n_q - 1.0) / tangent
    pressure = soil.cohesion * n_c + (1.0 - sine) * (soil.unit_weight * depth + soil.surcharge) * n_q
    return pressure + soil.speed_factor * soil.density * speed * speed


@njit(cache=True, error_model="numpy")
def _around_force(plate, soil, speed, top):
    """P [N] of soil that flows around the part of the plate below the depth `top` [m]; its inertia [N]."""
    below = plate.depth - top
    pressure = lateral_pressure(soil, top + 0.5 * below, speed)  # on the upright section
    lean = math.sin(plate.rake + soil.tool_friction)
    inertia = soil.speed_factor * soil.density * speed * speed
    return pressure * plate.width * below / lean, inertia * plate.width * below / lean


@njit(cache=True, error_model="numpy")
def _split_force(plate, soil, speed, critical):
    """P [N] where the wedge starts at the depth `critical` [m] and the soil flows around the plate below, and
    its inertia [N]."""
    upper = Plate(plate.width, plate.rake, critical, plate.height - (plate.depth - critical))
    beta, above = least_wedge(upper, soil, speed)
    below, inertia = _around_force(plate, soil, speed, critical)
    return above + below, inertia + wedge_terms(upper, soil, beta)[5] * speed * speed


@njit(cache=True, error_model="numpy")
def failure(plate, soil, speed):
    """The Failure that comes first.

    A wedge from the tip; or soil that flows around the plate below a critical depth, with a wedge from there
    (the critical depth of least P, Godwin and Spoor); or around all of a buried plate. P is the least of
    these, so it is continuous. beta and r are always those of the wedge from the tip.
    """
    if plate.depth <= 0.0 or plate.height <= 0.0 or plate.width <= 0.0:
        return Failure(0.25 * math.pi, 0.0, 0.0, 0.0, 0.0)
    beta, force = least_wedge(plate, soil, speed)
    length, weight, _, _, _, inertia = wedge_terms(plate, soil, beta)
    inertia *= speed * speed
    by_weight = weight / force if force > 0.0 else 0.0
    # where flow just below the tip costs more than the wedge loses, it does so all the way up
    partly = _split_force(plate, soil, speed, plate.depth - 0.02 * plate.height)[0] < force
    around, pushed = _around_force(plate, soil, speed, plate.depth - plate.height)
    if around < force:
        force, by_weight, inertia = around, 0.0, pushed
    if partly:
        low, high = plate.depth - plate.height, plate.depth
        for _ in range(CRITICAL_STEPS):
            one, two = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
            if _split_force(plate, soil, speed, one)[0] < _split_force(plate, soil, speed, two)[0]:
                high = two
            else:
                low = one
        split, pushed = _split_force(plate, soil, speed, 0.5 * (low + high))
        if split < force:
            force, inertia = split, pushed
    return Failure(beta, force, length, by_weight, inertia / force if force > 0.0 else 0.0)


def bearing_pressure(soil: Strength, depth: float, whole: float = 1.0) -> tuple[float, float]:
    """(pressure [Pa], part of it by weight) at which soil gives way sideways, at `depth` [m].

    whole: part of its cohesion that the soil still has.
    """
    cohesive, frictional = bearing_factors(soil.friction)
    weight = soil.unit_weight * depth * frictional
    pressure = whole * soil.cohesion * cohesive + soil.surcharge * frictional + weight
    return pressure, weight / pressure if pressure > 0.0 else 0.0


def parted(plate: Plate, strength: Strength, whole: float) -> Failure:
    """Failure in front of a shank that parts broken soil at its bearing pressure.

    whole: part of its cohesion that the soil still has.
    """
    pressure, by_weight = bearing_pressure(strength, plate.depth - 0.5 * plate.height, whole)
    force = pressure * plate.width * plate.height / math.sin(plate.rake + strength.tool_friction)
    return Failure(0.25 * math.pi - 0.5 * strength.friction, force, 0.0, by_weight)


def bearing(phase: float, drop: float, gradual: bool) -> float:
    """Part of its strength that a block bears at a phase of its cycle, 0 to 1; it fails at 1."""
    return 1.0 - drop * (4.0 * phase * (1.0 - phase) if gradual else 1.0 - phase)


def mean_bearing(drop: float, gradual: bool) -> float:
    """`bearing` on average over the cycle."""
    return 1.0 - drop * (2.0 / 3.0 if gradual else 0.5)


def block_number(depth_m: float, size_m: float | None) -> float:
    """Blocks in a wedge of this depth. They have one size, so their number goes as the depth squared; up to
    the depth `size_m`, or without one, there is one."""
    return 1.0 if size_m is None else max(depth_m / size_m, 1.0) ** 2


def block_sizes(blocks: float) -> list[float]:
    """Part of the wedge that each block is; the last one may be a fraction of a block."""
    return [min(blocks - number, 1.0) / blocks for number in range(math.ceil(blocks))]
