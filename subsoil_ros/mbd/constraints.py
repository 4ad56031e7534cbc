"""Constraints Phi(q, t) = 0, their Jacobian and right-hand sides (paper eq. 3-5).

Rows per joint, with p the joint point seen from either body and d = p_b - p_a:
revolute d = 0; prismatic n . d = 0 (n normal to the line, fixed in body a) and phi_b - phi_a = offset;
point on line n . d = 0; fixed d = 0 and phi_b - phi_a = offset; rod |d| = offset; turn lock
phi_b - phi_a = offset; driver q_c = offset + integral of its speed; relative driver the same for
n . d (n its axis) or phi_b - phi_a.
Everything leaves scaled by the rows' scale; the Jacobian also by the columns' scale.
"""

import math

import numpy as np

from .compiled import inner_kernel, kernel
from .tables import (
    DRIVER,
    FIXED,
    POINT_ON_LINE,
    PRISMATIC,
    RELATIVE_DRIVER,
    REVOLUTE,
    ROD,
)
from .time_functions import law_integral, law_rate, law_value


@kernel
def evaluate_turns(q, turns):
    """Cosine and sine of every angle of `q` (n + 3,) into `turns` (bodies + 1, 2)."""
    for i in range(turns.shape[0]):
        turns[i, 0] = math.cos(q[3 * i + 2])
        turns[i, 1] = math.sin(q[3 * i + 2])


def turns_of(q: np.ndarray) -> np.ndarray:
    """Cosines and sines (bodies + 1, 2) of the angles of `q` (n + 3,)."""
    turns = np.empty((len(q) // 3, 2))
    evaluate_turns(q, turns)
    return turns


@inner_kernel
def turned(turns, body, point):
    """A vector in the frame of a body in world axes."""
    c, s = turns[body, 0], turns[body, 1]
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


@inner_kernel
def difference(part, q, turns):
    """d = p_b - p_a of a joint or force, and the arms from the centres of mass to the two points."""
    a, b = 3 * part.body_a, 3 * part.body_b
    ax, az = turned(turns, part.body_a, part.point_a)
    bx, bz = turned(turns, part.body_b, part.point_b)
    return q[b] + bx - q[a] - ax, q[b + 1] + bz - q[a + 1] - az, ax, az, bx, bz


@inner_kernel
def _has_line(joint):
    """Whether its first row is n . d."""
    return (
        joint.kind == PRISMATIC
        or joint.kind == POINT_ON_LINE
        or (joint.kind == RELATIVE_DRIVER and joint.coordinate < 2)
    )


@inner_kernel
def _turn_row(joint):
    """Its row of phi_b - phi_a, or -1."""
    if joint.kind == PRISMATIC:
        return joint.row + 1
    if joint.kind == FIXED:
        return joint.row + 2
    if joint.kind == REVOLUTE or joint.kind == ROD or joint.kind == DRIVER or _has_line(joint):
        return -1
    return joint.row


@kernel
def evaluate_residual(model, time, select, q, turns, residual):
    """Phi(q, t) into `residual` (m,) [m]; answers the largest magnitude."""
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        row = joint.row
        travel = 0.0
        if joint.kind >= DRIVER:
            travel = law_integral(model.laws, joint.law, time, select)
        if joint.kind == DRIVER:
            residual[row] = q[joint.coordinate] - joint.offset - travel
            continue
        turn_row = _turn_row(joint)
        if turn_row >= 0:
            turn = q[3 * joint.body_b + 2] - q[3 * joint.body_a + 2]
            residual[turn_row] = turn - joint.offset - travel
            if turn_row == row:
                continue
        dx, dz, _, _, _, _ = difference(joint, q, turns)
        if _has_line(joint):
            nx, nz = turned(turns, joint.body_a, joint.normal)
            residual[row] = nx * dx + nz * dz
            if joint.kind == RELATIVE_DRIVER:
                residual[row] -= joint.offset + travel
        elif joint.kind == ROD:
            residual[row] = math.sqrt(dx * dx + dz * dz) - joint.offset
        else:
            residual[row] = dx
            residual[row + 1] = dz
    worst = 0.0
    for row in range(residual.shape[0]):
        residual[row] *= model.row_scale[row]
        size = abs(residual[row])
        if size > worst or size != size:  # a NaN is the worst, and stays
            worst = size
    return worst


@kernel
def evaluate_jacobian(model, q, turns, jacobian):
    """Phi_q into `jacobian` (m, n + 3), scaled; it must be zero where no joint has an entry."""
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        row = joint.row
        if joint.kind == DRIVER:
            jacobian[row, joint.coordinate] = 1.0
            continue
        a, b = 3 * joint.body_a, 3 * joint.body_b
        turn_row = _turn_row(joint)
        if turn_row >= 0:
            jacobian[turn_row, b + 2], jacobian[turn_row, a + 2] = 1.0, -1.0
            if turn_row == row:
                continue
        dx, dz, ax, az, bx, bz = difference(joint, q, turns)
        if _has_line(joint) or joint.kind == ROD:
            if joint.kind == ROD:
                length = math.sqrt(dx * dx + dz * dz)
                nx, nz, swing = dx / length, dz / length, 0.0
            else:
                nx, nz = turned(turns, joint.body_a, joint.normal)
                swing = nx * dz - nz * dx  # n turns with body a
            jacobian[row, b], jacobian[row, b + 1] = nx, nz
            jacobian[row, a], jacobian[row, a + 1] = -nx, -nz
            jacobian[row, b + 2] = nz * bx - nx * bz
            jacobian[row, a + 2] = swing - (nz * ax - nx * az)
        else:
            jacobian[row, b], jacobian[row + 1, b + 1] = 1.0, 1.0
            jacobian[row, a], jacobian[row + 1, a + 1] = -1.0, -1.0
            jacobian[row, b + 2], jacobian[row + 1, b + 2] = -bz, bx
            jacobian[row, a + 2], jacobian[row + 1, a + 2] = az, -ax
    for row in range(jacobian.shape[0]):
        for entry in range(model.sparsity.first[row], model.sparsity.first[row + 1]):
            column = model.sparsity.columns[entry]
            jacobian[row, column] *= model.row_scale[row] * model.column_scale[column]


@kernel
def evaluate_speed(model, time, select, speed):
    """-Phi_t into `speed` (m,): what Phi_q q' must be."""
    speed[:] = 0.0
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind >= DRIVER:
            value = law_value(model.laws, joint.law, time, select)
            speed[joint.row] = model.row_scale[joint.row] * value


@kernel
def evaluate_gamma(model, time, select, q, turns, v, gamma):
    """gamma = Phi_q q'' into `gamma` (m,): velocity terms, and the driver's acceleration."""
    gamma[:] = 0.0
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        row = joint.row
        if joint.kind >= DRIVER:
            gamma[row] = law_rate(model.laws, joint.law, time, select)
        if joint.kind == DRIVER or _turn_row(joint) == row:
            continue
        a, b = 3 * joint.body_a, 3 * joint.body_b
        dx, dz, ax, az, bx, bz = difference(joint, q, turns)
        wa, wb = v[a + 2], v[b + 2]
        # centripetal part of -d''
        cx = wb * wb * bx - wa * wa * ax
        cz = wb * wb * bz - wa * wa * az
        if _has_line(joint) or joint.kind == ROD:
            ux = v[b] - wb * bz - v[a] + wa * az
            uz = v[b + 1] + wb * bx - v[a + 1] - wa * ax
            if joint.kind == ROD:
                # |d|'' = e . d'' + (d'^2 - (e . d')^2) / |d|, e = d / |d|
                length = math.sqrt(dx * dx + dz * dz)
                nx, nz = dx / length, dz / length
                across = nx * uz - nz * ux
                gamma[row] = nx * cx + nz * cz - across * across / length
            else:
                # (n . d)'' = n . d'' + 2 wa (n turned) . d' - wa^2 n . d + terms with q''
                nx, nz = turned(turns, joint.body_a, joint.normal)
                gamma[row] += nx * cx + nz * cz - 2.0 * wa * (nx * uz - nz * ux)
                gamma[row] += wa * wa * (nx * dx + nz * dz)
        else:
            gamma[row] = cx
            gamma[row + 1] = cz
    for row in range(gamma.shape[0]):
        gamma[row] *= model.row_scale[row]
