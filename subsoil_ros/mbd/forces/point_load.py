"""A prescribed force and moment at a point fixed in the body, along world axes."""

from ...scene.mechanism import PointLoad
from ..function_tables import function_value
from ..geometry import turned
from ..kernel_options import inner_kernel
from ..machine_arrays import BY_LOADS
from .force_table import POINT_LOAD, Builder

KIND = POINT_LOAD


@inner_kernel
def add(model, held, i, at, q, turns, v, total, powers):
    """Add its force and moment."""
    force, (time, select) = model.forces[i], at
    body = 3 * force.body_b
    fx = function_value(model.functions, force.functions[0], time, select)
    fz = function_value(model.functions, force.functions[1], time, select)
    px, pz = turned(turns, force.body_b, force.point_b)
    moment = function_value(model.functions, force.functions[2], time, select) + px * fz - pz * fx
    total[body] += fx
    total[body + 1] += fz
    total[body + 2] += moment
    powers[BY_LOADS] += fx * v[body] + fz * v[body + 1] + moment * v[body + 2]


@inner_kernel
def mode_at(model, held, i, at, q, turns, v):
    """Return its only mode."""
    return 0


@inner_kernel
def report(model, held, i, at, q, turns, v):
    """Report nothing, and no energy stored."""
    return 0.0, 0.0, 0.0, 0.0


def fill(builder: Builder, name: str, force: PointLoad) -> None:
    """Add its row to the table."""
    row = builder.row(name, POINT_LOAD)
    row["body_b"] = builder.poses.index(force.body)
    row["point_b"] = builder.poses.point(force.body, force.point_m)
    parts = (force.force_x_newton, force.force_z_newton, force.moment_newton_m)
    row["functions"] = [[builder.functions.add(part) for part in parts]]
