"""Spring and damper on one coordinate against a time function: k (g(t) - q_c) + c (g' - q_c')."""

from ...scene.mechanism import CoordinateSpring
from ..function_tables import function_rate, function_value
from ..geometry import COORDINATE_INDEX
from ..kernel_options import inner_kernel
from ..machine_arrays import BY_DRIVERS, DISSIPATED
from .elastic import spring_mode, spring_push
from .force_table import COORDINATE_SPRING, Builder

KIND = COORDINATE_SPRING


@inner_kernel
def _stretch(model, force, at, q, v):
    """e = target - q, e', and the target's rate."""
    time, select = at
    stretch = function_value(model.functions, force.functions[0], time, select) - q[force.coordinate]
    target_rate = function_rate(model.functions, force.functions[0], time, select)
    return stretch, target_rate - v[force.coordinate], target_rate


@inner_kernel
def add(model, held, i, at, q, turns, v, total, powers):
    """Add its force; the work of a moving target counts as work of drivers."""
    force = model.forces[i]
    stretch, rate, target_rate = _stretch(model, force, at, q, v)
    push, elastic, _ = spring_push(model, force, held.modes[i], stretch, rate)
    total[force.coordinate] += push
    powers[BY_DRIVERS] += push * target_rate
    powers[DISSIPATED] += (push - elastic) * rate


@inner_kernel
def mode_at(model, held, i, at, q, turns, v):
    force = model.forces[i]
    if force.acts_in == 0:
        return 0
    stretch, rate, _ = _stretch(model, force, at, q, v)
    return spring_mode(model, force, stretch, rate, 0.0, 0.0)


@inner_kernel
def report(model, held, i, at, q, turns, v):
    """Coordinate, its rate, force, and energy stored."""
    force = model.forces[i]
    stretch, rate, _ = _stretch(model, force, at, q, v)
    push, _, stored = spring_push(model, force, held.modes[i], stretch, rate)
    return q[force.coordinate], v[force.coordinate], push, stored


def fill(builder: Builder, name: str, force: CoordinateSpring) -> None:
    """Add its row to the table."""
    row, body = builder.row(name, COORDINATE_SPRING), builder.poses.index(force.body)
    row["body_b"], row["coordinate"] = body, 3 * body + COORDINATE_INDEX[force.coordinate]
    row["functions"][0, 0] = builder.functions.add(force.target)
    row["acts_in"] = {"both": 0, "pull_up": 1, "push_down": -1}[force.acts_in]
    row["stiffness"], row["damping"] = force.stiffness, force.damping
