"""What Yuan & Yu (2020) print of their run, section 4, and where the paper contradicts itself."""

from typing import NamedTuple


class PaperValue(NamedTuple):
    """One printed result."""

    quantity: str
    printed: str


DRAFT = PaperValue("draft", "-331 to 1493 N over the run, typical cycle 363 to 1000 N")
DRAFT_CYCLE_NEWTON = (363.0, 1000.0)
DRAFT_NEWTON = (-331.06, 1492.75)
DRAFT_PERIOD_S = 0.5
PERIOD_S = 1.0  # of spring, angle and height
SPEED_M_PER_S = 0.5
SPRING = PaperValue("spring force", "-2231 to 2623 N (compression positive), period about 1 s")
SPRING_NEWTON = (-2231.0, 2623.0)
ANGLE = PaperValue("share entry angle", "-0.11 to 0 rad, period about 1 s")
ANGLE_RAD = (-0.11, 0.0)
HEIGHT = PaperValue("centre of mass of the shank", "-581.37 to -400.33 mm (181 mm), period about 1 s")
HEIGHT_TRAVEL_M = 0.18104

CONTRADICTIONS = (
    "The paper contradicts itself: its abstract gives 363-1000 N and 0-181 mm where its text gives the "
    "values above; draft repeats every 0.5 s, all else every 1 s; 2623 N on the spring go with 363 N of "
    "draft only right after a failure; 0.11 rad of swing cannot lift the shank by 181 mm; the sign and zero "
    "of the angle are ambiguous (compare peak to peak)."
)
