"""Printed results of Yuan & Yu (2020), section 4: the values of config/references/yuan_yu_2020.yaml."""

from subsoil_ros.analysis.columns import DRAFT, Body, spring_element
from subsoil_ros.analysis.summarize import MOVING
from subsoil_ros.analysis.summary import path_of
from subsoil_ros.loading.reference import read_reference

from . import CONFIG

REFERENCE = read_reference(CONFIG / "references" / "yuan_yu_2020.yaml")


def value(quantity: str) -> float:
    """The printed value of a quantity, by its dotted path in summary.json."""
    found = REFERENCE.values[quantity].value
    assert found is not None
    return found


DRAFT_CYCLE_NEWTON = (
    value(path_of(DRAFT, MOVING, "min")),
    value(path_of(DRAFT, MOVING, "max")),
)
_DRAFT = path_of(DRAFT, "run", MOVING)
DRAFT_NEWTON = (value(f"{_DRAFT}.min"), value(f"{_DRAFT}.max"))
DRAFT_PERIOD_S = value("failure_cycles.time_s.mean")
PERIOD_S = 1.0  # of spring, angle and height
SPEED_M_PER_S = 0.5
_SPRING = path_of(spring_element("H9_spring").load, "run", MOVING)
SPRING_NEWTON = (value(f"{_SPRING}.min"), value(f"{_SPRING}.max"))
ANGLE_RANGE_RAD = value(path_of(Body("shank").angle_rad, "run", MOVING, "range"))
HEIGHT_RANGE_M = value(path_of(Body("shank").z_m, "run", MOVING, "range"))
