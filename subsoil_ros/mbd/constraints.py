"""Constraints Phi(q, t) = 0, their Jacobian and right-hand sides (paper eq. 3-5).

Rows per joint, with p the joint point seen from either body and d = p_b - p_a:
revolute d = 0; prismatic n . d = 0 (n normal to the line, fixed in body a) and phi_b - phi_a = offset;
fixed d = 0 and phi_b - phi_a = offset; driver q_c = offset + integral of its speed.
Everything leaves scaled by the rows' scale; the Jacobian also by the columns' scale.
"""

import math

from .compiled import inner_kernel, kernel
from .laws import law_integral, law_rate, law_value
from .tables import DRIVER, PRISMATIC, REVOLUTE


@kernel
def turned(angle, point):
    """A body-fixed vector in world axes."""
    c, s = math.cos(angle), math.sin(angle)
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


@inner_kernel
def _difference(joint, q):
    """d = p_b - p_a, and the arms from the centres of mass to the two joint points."""
    a, b = 3 * joint.body_a, 3 * joint.body_b
    ax, az = turned(q[a + 2], joint.point_a)
    bx, bz = turned(q[b + 2], joint.point_b)
    return q[b] + bx - q[a] - ax, q[b + 1] + bz - q[a + 1] - az, ax, az, bx, bz


@kernel
def evaluate_residual(model, time, select, q, residual):
    """Phi(q, t) into `residual` (m,) [m]; answers the largest magnitude."""
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        row = joint.row
        if joint.kind == DRIVER:
            travel = law_integral(model.laws, joint.law, time, select)
            residual[row] = q[joint.coordinate] - joint.offset - travel
            continue
        dx, dz, _, _, _, _ = _difference(joint, q)
        turn = q[3 * joint.body_b + 2] - q[3 * joint.body_a + 2] - joint.offset
        if joint.kind == PRISMATIC:
            nx, nz = turned(q[3 * joint.body_a + 2], joint.normal)
            residual[row] = nx * dx + nz * dz
            residual[row + 1] = turn
            continue
        residual[row] = dx
        residual[row + 1] = dz
        if joint.kind != REVOLUTE:
            residual[row + 2] = turn
    worst = 0.0
    for row in range(residual.shape[0]):
        residual[row] *= model.row_scale[row]
        size = abs(residual[row])
        if size > worst or size != size:  # a NaN is the worst, and stays
            worst = size
    return worst


@kernel
def evaluate_jacobian(model, q, jacobian):
    """Phi_q into `jacobian` (m, n + 3), scaled."""
    jacobian[:] = 0.0
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        row = joint.row
        if joint.kind == DRIVER:
            jacobian[row, joint.coordinate] = 1.0
            continue
        a, b = 3 * joint.body_a, 3 * joint.body_b
        dx, dz, ax, az, bx, bz = _difference(joint, q)
        if joint.kind == PRISMATIC:
            nx, nz = turned(q[a + 2], joint.normal)
            jacobian[row, b], jacobian[row, b + 1] = nx, nz
            jacobian[row, a], jacobian[row, a + 1] = -nx, -nz
            jacobian[row, b + 2] = nz * bx - nx * bz
            jacobian[row, a + 2] = nx * dz - nz * dx - (nz * ax - nx * az)
        else:
            jacobian[row, b], jacobian[row + 1, b + 1] = 1.0, 1.0
            jacobian[row, a], jacobian[row + 1, a + 1] = -1.0, -1.0
            jacobian[row, b + 2], jacobian[row + 1, b + 2] = -bz, bx
            jacobian[row, a + 2], jacobian[row + 1, a + 2] = az, -ax
        if joint.kind != REVOLUTE:
            last = row + (1 if joint.kind == PRISMATIC else 2)
            jacobian[last, b + 2], jacobian[last, a + 2] = 1.0, -1.0
    for row in range(jacobian.shape[0]):
        for column in range(model.column_scale.shape[0]):
            jacobian[row, column] *= model.row_scale[row] * model.column_scale[column]


@kernel
def evaluate_speed(model, time, select, speed):
    """-Phi_t into `speed` (m,): what Phi_q q' must be."""
    speed[:] = 0.0
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind == DRIVER:
            value = law_value(model.laws, joint.law, time, select)
            speed[joint.row] = model.row_scale[joint.row] * value


@kernel
def evaluate_gamma(model, time, select, q, v, gamma):
    """gamma = Phi_q q'' into `gamma` (m,): velocity terms, and the driver's acceleration."""
    gamma[:] = 0.0
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        row = joint.row
        if joint.kind == DRIVER:
            gamma[row] = law_rate(model.laws, joint.law, time, select)
            continue
        a, b = 3 * joint.body_a, 3 * joint.body_b
        dx, dz, ax, az, bx, bz = _difference(joint, q)
        wa, wb = v[a + 2], v[b + 2]
        # centripetal part of -d''
        cx = wb * wb * bx - wa * wa * ax
        cz = wb * wb * bz - wa * wa * az
        if joint.kind == PRISMATIC:
            nx, nz = turned(q[a + 2], joint.normal)
            ux = v[b] - wb * bz - v[a] + wa * az
            uz = v[b + 1] + wb * bx - v[a + 1] - wa * ax
            # (n . d)'' = n . d'' + 2 wa (n turned) . d' - wa^2 n . d + terms with q''
            gamma[row] = nx * cx + nz * cz - 2.0 * wa * (nx * uz - nz * ux) + wa * wa * (nx * dx + nz * dz)
        else:
            gamma[row] = cx
            gamma[row + 1] = cz
    for row in range(gamma.shape[0]):
        gamma[row] *= model.row_scale[row]
