"""Printed results of Yuan & Yu (2020), section 4: the values of config/references/yuan_yu_2020.yaml."""

from subsoil_ros.loading.reference import read_reference

from . import CONFIG

REFERENCE = read_reference(CONFIG / "references" / "yuan_yu_2020.yaml")


def value(quantity: str) -> float:
    """The printed value of a quantity, by its dotted path in summary.json."""
    found = REFERENCE.values[quantity].value
    assert found is not None
    return found


DRAFT_CYCLE_NEWTON = (
    value("series.draft_newton.moving_10ms.min"),
    value("series.draft_newton.moving_10ms.max"),
)
_DRAFT = "series.draft_newton.run.moving_10ms"
DRAFT_NEWTON = (value(f"{_DRAFT}.min"), value(f"{_DRAFT}.max"))
DRAFT_PERIOD_S = value("failure_cycles.time_s.mean")
PERIOD_S = 1.0  # of spring, angle and height
SPEED_M_PER_S = 0.5
_SPRING = "series.spring.H9_spring.force_newton.run.moving_10ms"
SPRING_NEWTON = (value(f"{_SPRING}.min"), value(f"{_SPRING}.max"))
ANGLE_RANGE_RAD = value("series.body.shank.angle_rad.run.moving_10ms.range")
HEIGHT_RANGE_M = value("series.body.shank.z_m.run.moving_10ms.range")
