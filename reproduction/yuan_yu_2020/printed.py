"""What Yuan & Yu (2020) print of their run, section 4: the values of config/references/yuan_yu_2020.yaml."""

from subsoil_ros.loading.reference import read_reference

from . import CONFIG

REFERENCE = read_reference(CONFIG / "references" / "yuan_yu_2020.yaml")


def value(quantity: str) -> float:
    """The printed value of a quantity of summary.json."""
    found = REFERENCE.values[quantity].value
    assert found is not None
    return found


DRAFT_CYCLE_NEWTON = (value("draft_newton_10ms_min"), value("draft_newton_10ms_max"))
DRAFT_NEWTON = (value("run.draft_newton_10ms_min"), value("run.draft_newton_10ms_max"))
DRAFT_PERIOD_S = value("cycle.time_s_mean")
PERIOD_S = 1.0  # of spring, angle and height
SPEED_M_PER_S = 0.5
_SPRING = "run.spring.H9_spring.force_newton_10ms"
SPRING_NEWTON = (value(f"{_SPRING}_min"), value(f"{_SPRING}_max"))
ANGLE_RANGE_RAD = value("run.body.shank.angle_rad_10ms_range")
HEIGHT_RANGE_M = value("run.body.shank.z_m_10ms_range")
