"""Forces of a terrain on a tool: passive earth pressure on its plates and before its mouth, bearing where it
presses down, friction along it, and the weight that it carries.

A plate that moves into the soil meets the pressure K gamma z + K_c c, or a spring's where that is less. K and
K_c are those of the three-dimensional wedge of McKyes and Ali before a plate of its rake and width
(wedge/failure_wedge.py). Where it looks down, K is larger by exp(2 theta tan phi), theta being its tilt
beyond the upright: the fan of shear between a wall and a footing, V.V. Sokolovskii, Statics of Granular Media
(1965). At theta = 90 degrees this gives Prandtl's N_q = tan^2(45 + phi / 2) exp(pi tan phi) and N_c.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..wedge.failure_wedge import Plate, Strength, least_wedge, wedge_terms
from .cavity import floor_at, world_of
from .terrain_field import Array, cell_of

SIDEWAYS_CELLS = 1.25
"""Distance from a surface at which the soil beside it is looked up, in cells: beyond the cell it touches."""

BESIDE_CELLS = 0.5
"""Distance from a surface at which it is in a cavity or not, in cells; half of it is slack."""

CLOSE_CELLS = 0.05
"""Gap below the tool up to which soil carries it, in cells."""

LOWEST_RAKE = math.radians(15.0)
"""Rake of a plate below which it meets no passive pressure: the charts of McKyes (1985) begin there."""

SLOWEST_M_PER_S = 1e-3
"""Speed below which friction goes to zero with it."""

LEVEL = 0.17
"""Level part of the normal of a plate up to which it is a footing: 10 degrees."""

LEAST_DEPTH_M = 1e-3
"""Depth below which a plate is out of the soil: the theory divides by it."""


class Surface(NamedTuple):
    """Points of a tool's surface in world axes, plate by plate."""

    arms_m: Array  # (points, 3) from the tool's origin
    normals: Array  # (points, 3)
    areas_m2: Array  # (points,)


class Felt(NamedTuple):
    """Forces on a tool, about its origin, in world axes; and what is needed to find them."""

    group_newton: Array  # (groups, 3)
    torque_newton_m: Array  # (3,)
    press_m: Array  # (plates + 1,) how far the spring of each plate is pressed, the mouth's last
    drift_m_per_s: Array  # (3,) of the soil in the cavity against the tool, which passes under it
    depth_m: Array  # (points,) of each point that is in contact; negative: it is not


@njit(cache=True, error_model="numpy")
def passive(width, rake, depth, strength, speed):
    """Normal pressure on a plate over gamma z, over c, and the rest [Pa], of the wedge that fails first."""
    plate = Plate(width, rake, depth, depth)
    beta, _ = least_wedge(plate, strength, speed)
    _, weight, cohesion, surcharge, adhesion, inertia = wedge_terms(plate, strength, beta)
    area = width * depth / math.sin(rake)
    normal = math.cos(strength.tool_friction) / area
    by_weight = normal * weight / (0.5 * strength.unit_weight * depth)
    rest = normal * (surcharge + max(adhesion, 0.0) + inertia * speed * speed)
    return by_weight, normal * cohesion / strength.cohesion if strength.cohesion > 0.0 else 0.0, rest


@njit(cache=True, error_model="numpy")
def _at_wall(strength, friction, adhesion):
    """The strength at a wall of other friction [rad] and adhesion [Pa]."""
    s = strength
    return Strength(
        s.unit_weight, s.density, s.cohesion, s.friction, adhesion, friction, s.surcharge, s.speed_factor,
        s.plane_sides,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def depth_before(ground, x, y, z, ahead_x, ahead_y, around):
    """Mean depth of a point below the surface over the wedge before it: beside it, one depth and two ahead.

    ahead: level, of the length at which soil beside the point is looked up. Columns under the tool and beside
    the bin count as the soil around.
    """
    i, j = cell_of(ground, x + ahead_x, y + ahead_y)
    if i < 0:
        return -1.0
    deep = ground.firm_m[i, j] + ground.loose_m[i, j] - z
    size = math.hypot(ahead_x, ahead_y)
    if deep <= 0.0 or size == 0.0:
        return deep
    total = deep
    for k in (1.0, 2.0):
        far = 1.0 + k * deep / size
        i, j = cell_of(ground, x + far * ahead_x, y + far * ahead_y)
        known = i >= 0 and ground.under_m[i, j] == np.inf
        total += max((ground.firm_m[i, j] + ground.loose_m[i, j] if known else around) - z, 0.0)
    return total / 3.0


@njit(cache=True, error_model="numpy")
def find_contact(ground, cavity, pose, surface, box, around, felt):
    """Set `depth_m`: of each point of the surface that has soil outside, beside the cavity; box: of the
    columns that the tool touches."""
    o, cell = pose.origin_m, ground.cell_m
    far, near = SIDEWAYS_CELLS * cell, BESIDE_CELLS * cell
    (from_x, from_y), (rows, columns) = ground.corner_m, ground.firm_m.shape
    highest, beyond = -np.inf, math.ceil(SIDEWAYS_CELLS)
    for i in range(max(box[0] - beyond, 0), min(box[2] + beyond, rows)):
        for j in range(max(box[1] - beyond, 0), min(box[3] + beyond, columns)):
            highest = max(highest, ground.firm_m[i, j] + ground.loose_m[i, j])
    axes = cavity.axes @ pose.rotation.T  # rows: the axes of the cavity in the world
    arms, normals, depth = surface.arms_m, surface.normals, felt.depth_m
    firm, loose, under = ground.firm_m, ground.loose_m, ground.under_m
    for k in range(arms.shape[0]):
        depth[k] = -1.0
        px, py, pz = arms[k, 0], arms[k, 1], arms[k, 2]
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        z = o[2] + pz
        if z > highest + cell:
            continue
        x, y = o[0] + px, o[1] + py
        # cell_of would count references to the arrays of the ground at each point, fifty times as long
        i, j = math.floor((x + far * nx - from_x) / cell), math.floor((y + far * ny - from_y) / cell)
        if not (0 <= i < rows and 0 <= j < columns):
            continue
        top, lowest = firm[i, j] + loose[i, j], under[i, j]
        covered = lowest < np.inf
        if top < z - cell or (covered and top < lowest - CLOSE_CELLS * cell):
            continue
        dx, dy, dz = px + near * nx, py + near * ny, pz + near * nz
        a = math.floor((axes[0, 0] * dx + axes[0, 1] * dy + axes[0, 2] * dz - cavity.corner_m[0]) / cell)
        b = math.floor((axes[1, 0] * dx + axes[1, 1] * dy + axes[1, 2] * dz - cavity.corner_m[1]) / cell)
        up = axes[2, 0] * dx + axes[2, 1] * dy + axes[2, 2] * dz
        if up - floor_at(cavity, a, b) > -0.5 * BESIDE_CELLS * cell:
            continue
        if covered:  # below the tool: soil that carries it has the depth of the ground around
            depth[k] = around - z
        else:
            depth[k] = depth_before(ground, x, y, z, far * nx, far * ny, around)


@njit(cache=True, error_model="numpy")
def add_force(felt, group, arm, force):
    """Add a force at an arm from the tool's origin."""
    for d in range(3):
        felt.group_newton[group, d] += force[d]
    felt.torque_newton_m[0] += arm[1] * force[2] - arm[2] * force[1]
    felt.torque_newton_m[1] += arm[2] * force[0] - arm[0] * force[2]
    felt.torque_newton_m[2] += arm[0] * force[1] - arm[1] * force[0]


@njit(cache=True, error_model="numpy")
def _patch(surface, first, last, felt):
    """Of the points from first to last that are in contact: area, depth times area, largest depth, area
    vector, its middle times area."""
    area, mean, deep = 0.0, 0.0, 0.0
    normal, middle = np.zeros(3), np.zeros(3)
    for k in range(first, last):
        z = felt.depth_m[k]
        if z > 0.0:
            part = surface.areas_m2[k]
            area += part
            mean += part * z
            deep = max(deep, z)
            for d in range(3):
                normal[d] += part * surface.normals[k, d]
                middle[d] += part * surface.arms_m[k, d]
    return area, mean, deep, normal, middle


@njit(cache=True, error_model="numpy")
def _count(first, last, felt):
    """Number of points that are in contact."""
    count = 0
    for k in range(first, last):
        count += felt.depth_m[k] > 0.0
    return count


@njit(cache=True, error_model="numpy")
def _extent(surface, first, last, felt, across):
    """Extent of the points that are in contact, from the first to the last, along a direction."""
    low, high = np.inf, -np.inf
    for k in range(first, last):
        if felt.depth_m[k] > 0.0:
            p = surface.arms_m[k]
            place = across[0] * p[0] + across[1] * p[1] + across[2] * p[2]
            low, high = min(low, place), max(high, place)
    return high - low


@njit(cache=True, error_model="numpy")
def press_plates(shape, surface, pose, strength, soft, interval, felt):
    """Add the forces on all plates. soft: pressure over displacement of the spring [N/m3]."""
    for number in range(shape.plate_group.shape[0]):
        first, last = shape.plate_first[number], shape.plate_first[number + 1]
        area, mean, deep, normal, middle = _patch(surface, first, last, felt)
        if area == 0.0 or deep < LEAST_DEPTH_M:
            felt.press_m[number] = 0.0
            continue
        normal /= math.sqrt(normal @ normal)
        level = math.hypot(normal[0], normal[1])
        left = pose.rotation[:, 1].copy()  # the tool's y axis
        across = left - (left @ normal) * normal
        if level > LEVEL or across @ across < LEVEL:
            across = np.array([-normal[1], normal[0], 0.0])
        across /= math.sqrt(across @ across)
        spacing = math.sqrt(area / max(_count(first, last, felt), 1))
        tall = _extent(surface, first, last, felt, np.cross(normal, across)) + spacing
        width = _extent(surface, first, last, felt, across) + spacing
        if level <= LEVEL:
            width, tall = max(width, tall), min(width, tall)  # of a footing
        velocity = pose.velocity_m_per_s + np.cross(pose.spin_rad_per_s, middle / area)
        into = velocity @ normal
        by_weight, more = _pressures(math.atan2(level, normal[2]), width, deep, strength, into)
        # a footing at the surface bears gamma B N_gamma / 2, about that of N_q at the depth B / 2
        foot = max(-normal[2], 0.0) * 0.5 * min(width, tall)
        limit = by_weight * (mean / area + foot) + more
        pressed = min(max(felt.press_m[number] + into * interval, 0.0), limit / soft)
        felt.press_m[number] = pressed
        # its damper makes up for the force that is held over a tick
        part = min(max(pressed + into * interval, 0.0) * soft / limit, 1.0) if limit > 0.0 else 0.0
        # the wedge before a plate slides up along it, at the plate's own angle where that looks down
        tilt = min(math.atan2(level, normal[2]) - 0.5 * math.pi, 0.0)
        rising = max(into, 0.0) * math.tan(0.25 * math.pi - 0.5 * strength.friction + tilt)
        uphill = np.array([-normal[0] * normal[2], -normal[1] * normal[2], level * level]) / max(level, 1e-9)
        along = velocity - into * normal - rising * uphill
        along /= math.sqrt(along @ along) + SLOWEST_M_PER_S
        rest = (1.0 - math.sin(strength.friction)) * strength.unit_weight
        for k in range(first, last):
            z = felt.depth_m[k]
            if z > 0.0:
                pressure = part * (by_weight * (z + foot) + more)
                shear = math.tan(strength.tool_friction) * max(pressure, rest * z) + strength.adhesion
                force = -surface.areas_m2[k] * (pressure * normal + shear * along)
                add_force(felt, shape.plate_group[number], surface.arms_m[k], force)


@njit(cache=True, error_model="numpy")
def _pressures(rake, width, deep, strength, speed):
    """Passive pressure on a plate, per depth [Pa/m], and the rest [Pa]; beyond 90 degrees it looks down."""
    if rake < LOWEST_RAKE:
        return 0.0, 0.0
    theta, tangent = max(rake - 0.5 * math.pi, 0.0), math.tan(strength.friction)
    fan = math.exp(2.0 * theta * tangent)
    facing = _at_wall(strength, strength.tool_friction * math.cos(theta), strength.adhesion)
    by_weight, by_cohesion, more = passive(width, min(rake, 0.5 * math.pi), deep, facing, max(speed, 0.0))
    # cohesion is as a pressure c cot(phi) all over (corresponding states): K - 1 where weight has K
    cohesive = (fan * by_weight - 1.0) / (by_weight - 1.0) if tangent > 1e-6 else 1.0 + theta
    rest = cohesive * by_cohesion * strength.cohesion + fan * more
    return fan * by_weight * strength.unit_weight, rest


@njit(cache=True, error_model="numpy")
def _mouth(ground, cavity, pose, around):
    """Of the rims, at most a cell above the floor beside them, that move towards soil: width [m], mean depth
    [m] and speed [m/s], mean point at a third of the depth, from the tool's origin, mean level direction."""
    cell, shape = ground.cell_m, cavity.floor_m.shape
    width, depth, speed, at, ahead = 0.0, 0.0, 0.0, np.zeros(3), np.zeros(3)
    for a in range(shape[0]):
        for b in range(shape[1]):
            floor = cavity.floor_m[a, b]
            if math.isnan(floor):
                continue
            for da, db in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                wall = cavity.walls_m[0 if db == 0 else 1, min(a, a + da), min(b, b + db)]
                if not math.isnan(cavity.floor_m[a + da, b + db]) or wall > floor + cell:
                    continue
                x, y, z = world_of(cavity, cell, pose, a + 0.5 * da, b + 0.5 * db, floor)
                u, v, _ = world_of(cavity, cell, pose, a + 2.0 * da, b + 2.0 * db, floor)
                size = math.hypot(u - x, v - y)
                deep = depth_before(ground, x, y, z, u - x, v - y, around)
                if deep < LEAST_DEPTH_M or size < 0.1 * cell:
                    continue
                arm = np.array([x, y, z]) - pose.origin_m
                way = np.array([(u - x) / size, (v - y) / size, 0.0])
                fast = (pose.velocity_m_per_s + np.cross(pose.spin_rad_per_s, arm)) @ way
                if fast > 0.0:
                    width += cell
                    depth += cell * deep
                    speed += cell * fast
                    ahead += cell * way
                    at += cell * (arm + np.array([0.0, 0.0, deep / 3.0]))
    part = 1.0 / max(width, cell)
    return width, part * depth, part * speed, part * at, ahead / max(math.sqrt(ahead @ ahead), 1e-12)


@njit(cache=True, error_model="numpy")
def _held_newton(ground, cavity, width, strength):
    """Force that pushes back what is in a cavity: friction on its floor, and passive pressure of its mean
    height against the back."""
    content, columns = 0.0, 0
    for a in range(cavity.floor_m.shape[0]):
        for b in range(cavity.floor_m.shape[1]):
            if not math.isnan(cavity.floor_m[a, b]):
                content += cavity.carried_m[a, b]
                columns += 1
    height, flow = content / columns, math.tan(0.25 * math.pi + 0.5 * strength.friction)
    weight = strength.unit_weight * content * ground.cell_m * ground.cell_m / ground.swell
    passive_pa = 0.5 * strength.unit_weight * height * flow * flow + 2.0 * strength.cohesion * flow
    return weight * math.tan(strength.tool_friction) + width * height * passive_pa


@njit(cache=True, error_model="numpy")
def press_mouth(ground, cavity, group, pose, around, strength, soft, interval, felt):
    """Add the force of the soil before a cavity's mouth, whichever is less: its passive wedge fails, or what
    is in the cavity is pushed back. Then the soil stays where it is and the tool passes under it."""
    width, depth, speed, at, ahead = _mouth(ground, cavity, pose, around)
    mouth = felt.press_m.shape[0] - 1
    felt.drift_m_per_s[:] = 0.0
    if width == 0.0:
        felt.press_m[mouth] = 0.0
        return
    by_weight, by_cohesion, more = passive(width, 0.5 * math.pi, depth, _at_wall(strength, 0.0, 0.0), speed)
    area = width * depth
    most = area * (0.5 * by_weight * strength.unit_weight * depth + by_cohesion * strength.cohesion + more)
    held = _held_newton(ground, cavity, width, strength)
    # all of it up to half of what the soil ahead bears, then less, to none: no jump (chosen)
    felt.drift_m_per_s[:] = -speed * min(max(2.0 - 2.0 * held / most, 0.0), 1.0) * ahead
    limit = min(most, held)
    pressed = min(felt.press_m[mouth] + speed * interval, limit / (soft * area))
    felt.press_m[mouth] = pressed
    add_force(felt, group, at, -min(soft * area * (pressed + speed * interval), limit) * ahead)


@njit(cache=True, error_model="numpy")
def carry(ground, cavity, group, pose, weight, felt):
    """Add the weight of what the cavity holds; weight: of a volume of loose soil [N/m3]."""
    cell = ground.cell_m
    for a in range(cavity.floor_m.shape[0]):
        for b in range(cavity.floor_m.shape[1]):
            thick = cavity.carried_m[a, b]
            if thick > 0.0:
                x, y, z = world_of(cavity, cell, pose, a, b, cavity.floor_m[a, b] + 0.5 * thick)
                volume = thick * cell * cell
                add_force(
                    felt, group, np.array([x, y, z]) - pose.origin_m, np.array([0.0, 0.0, -weight * volume])
                )
