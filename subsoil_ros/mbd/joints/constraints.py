"""Constraints Phi(q, t) = 0, their Jacobian and right-hand sides (paper eq. 3-5), over all joints.

All results are scaled by the rows' scale; the Jacobian also by the columns' scale.
"""

from ..function_tables import function_integral, function_rate, function_value
from ..kernel_options import kernel, part_of_kernel
from . import KINDS, driver
from .rows import DRIVER


def _at_pose(name):
    """The kernel `name` (residual, jacobian) of every kind as one, which chooses by the kind of the joint."""
    chosen = getattr(driver, name)
    for kind, module in KINDS.items():
        if module is not driver:
            chosen = _choose_at_pose(kind, getattr(module, name), chosen)
    return chosen


def _choose_at_pose(kind, its, other):
    @part_of_kernel
    def choose(joint, q, turns, rows):
        if joint.kind == kind:
            its(joint, q, turns, rows)
        else:
            other(joint, q, turns, rows)

    return choose


def _choose_in_motion(kind, its, other):
    @part_of_kernel
    def choose(joint, q, turns, v, rows):
        if joint.kind == kind:
            its(joint, q, turns, v, rows)
        else:
            other(joint, q, turns, v, rows)

    return choose


_residual, _jacobian, _gamma = _at_pose("residual"), _at_pose("jacobian"), driver.gamma
for _kind, _module in KINDS.items():
    if _module is not driver:
        _gamma = _choose_in_motion(_kind, _module.gamma, _gamma)


@kernel
def evaluate_residual(model, time, select, q, turns, residual):
    """Write Phi(q, t) into `residual` (m,) [m]; return the largest magnitude."""
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind >= DRIVER:
            residual[joint.row] = function_integral(model.functions, joint.function, time, select)
        _residual(joint, q, turns, residual)
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
        _jacobian(joint, q, turns, jacobian)
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
            value = function_value(model.functions, joint.function, time, select)
            speed[joint.row] = model.row_scale[joint.row] * value


@kernel
def evaluate_gamma(model, time, select, q, turns, v, gamma):
    """Write Phi_q q'' into `gamma` (m,): velocity terms, and the accelerations of drivers."""
    gamma[:] = 0.0
    for i in range(model.joints.shape[0]):
        joint = model.joints[i]
        if joint.kind >= DRIVER:
            gamma[joint.row] = function_rate(model.functions, joint.function, time, select)
        _gamma(joint, q, turns, v, gamma)
    for row in range(gamma.shape[0]):
        gamma[row] *= model.row_scale[row]
