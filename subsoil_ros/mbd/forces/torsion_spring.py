"""Spring and damper on the angle between two bodies: moment on body_b = k (theta_0 - theta) + M_0 - c theta'.

theta = phi_b - phi_a less that of the reference pose. Its elastic part and stops: elastic.py.
"""

from ...scene.mechanism import TorsionSpring
from ..joints.rows import ROTATION_LOCK
from ..kernel_options import inner_kernel
from .elastic import fill_elastic, fill_stops
from .force_table import LOCKED_TORSION, TORSION_SPRING, Builder


@inner_kernel
def measure(force, q, v):
    """Angle, its rate, and no direction and no arms."""
    a, b = 3 * force.body_a, 3 * force.body_b
    return q[b + 2] - q[a + 2] - force.origin, v[b + 2] - v[a + 2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


def fill(builder: Builder, name: str, force: TorsionSpring) -> None:
    """Add its row to the table, and a rotation lock if it is locked."""
    row = builder.row_between(name, TORSION_SPRING, force)
    if force.locked:
        builder.lock(name, row, LOCKED_TORSION, ROTATION_LOCK, float(row["origin"][0]))
        return
    row["acts_in"] = {"both": 0, "positive": 1, "negative": -1}[force.acts_in]
    row["damping"] = force.damping_newton_m_s_per_rad
    table = None if force.table is None else (force.table.angles_rad, force.table.moments_newton_m)
    fill_elastic(
        builder, row, force.stiffness_newton_m_per_rad, force.preload_newton_m, force.rest_angle_rad, table
    )
    fill_stops(row, force.stops)
