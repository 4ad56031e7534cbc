"""Constraints Phi(q, t) = 0, their Jacobian and right-hand sides (paper eq. 3-5), over all joints.

All results are scaled by the rows' scale; the Jacobian also by the columns' scale.
"""

from ..kernel_options import kernel
from . import driver, fixed, point_on_line, prismatic, revolute, rod
from .rows import (
    DRIVER,
    FIXED,
    POINT_ON_LINE,
    PRISMATIC,
    REVOLUTE,
    ROD,
    ROTATION_LOCK,
    angle_jacobian,
    angle_residual,
)


@kernel
def evaluate_residual(model, time, select, q, turns, residual):
    """Write Phi(q, t) into `residual` (m,) [m]; return the largest magnitude."""
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind == REVOLUTE:
            revolute.residual(joint, q, turns, residual)
        elif joint.kind == PRISMATIC:
            prismatic.residual(joint, q, turns, residual)
        elif joint.kind == FIXED:
            fixed.residual(joint, q, turns, residual)
        elif joint.kind == POINT_ON_LINE:
            point_on_line.residual(joint, q, turns, residual)
        elif joint.kind == ROD:
            rod.residual(joint, q, turns, residual)
        elif joint.kind == ROTATION_LOCK:
            angle_residual(joint, joint.row, q, residual)
        else:
            driver.residual(model, joint, time, select, q, turns, residual)
    worst = 0.0
    for row in range(residual.shape[0]):
        residual[row] *= model.row_scale[row]
        size = abs(residual[row])
        if size > worst or size != size:  # a NaN is the worst, and stays
            worst = size
    return worst


@kernel
def evaluate_jacobian(model, q, turns, jacobian):
    """Write Phi_q into `jacobian` (m, n + 3), which must be zero where no joint has an entry."""
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind == REVOLUTE:
            revolute.jacobian(joint, q, turns, jacobian)
        elif joint.kind == PRISMATIC:
            prismatic.jacobian(joint, q, turns, jacobian)
        elif joint.kind == FIXED:
            fixed.jacobian(joint, q, turns, jacobian)
        elif joint.kind == POINT_ON_LINE:
            point_on_line.jacobian(joint, q, turns, jacobian)
        elif joint.kind == ROD:
            rod.jacobian(joint, q, turns, jacobian)
        elif joint.kind == ROTATION_LOCK:
            angle_jacobian(joint, joint.row, jacobian)
        else:
            driver.jacobian(joint, q, turns, jacobian)
    for row in range(jacobian.shape[0]):
        for entry in range(model.sparsity.first[row], model.sparsity.first[row + 1]):
            column = model.sparsity.columns[entry]
            jacobian[row, column] *= model.row_scale[row] * model.column_scale[column]


@kernel
def evaluate_speed(model, time, select, speed):
    """Write -Phi_t, which Phi_q q' must be equal to, into `speed` (m,)."""
    speed[:] = 0.0
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind >= DRIVER:
            speed[joint.row] = model.row_scale[joint.row] * driver.speed(model, joint, time, select)


@kernel
def evaluate_gamma(model, time, select, q, turns, v, gamma):
    """Write Phi_q q'' into `gamma` (m,): velocity terms, and the accelerations of drivers."""
    gamma[:] = 0.0
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind == REVOLUTE:
            revolute.gamma(joint, q, turns, v, gamma)
        elif joint.kind == PRISMATIC:
            prismatic.gamma(joint, q, turns, v, gamma)
        elif joint.kind == FIXED:
            fixed.gamma(joint, q, turns, v, gamma)
        elif joint.kind == POINT_ON_LINE:
            point_on_line.gamma(joint, q, turns, v, gamma)
        elif joint.kind == ROD:
            rod.gamma(joint, q, turns, v, gamma)
        elif joint.kind >= DRIVER:
            driver.gamma(model, joint, time, select, q, turns, v, gamma)
    for row in range(gamma.shape[0]):
        gamma[row] *= model.row_scale[row]
