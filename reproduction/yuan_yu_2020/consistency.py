"""Contradictions between the paper's numbers, by statics, inertia and energy with the levers of the scene.

In a shank at rest, the moments of soil and spring balance. A shank that the soil suddenly releases oscillates
at its natural frequency, and its inertia force is then up to stiffness times half the range of the swing:
half the printed range of the spring force, to which the declared stiffness was fitted.
"""

import math
from typing import NamedTuple

from . import printed
from .levers import Levers


class Statement(NamedTuple):
    """One claim about printed numbers, with the numbers that decide it."""

    claim: str
    finding: str
    needed: float  # what the claim needs
    available: float  # what there is to meet it
    unit: str

    @property
    def holds(self) -> bool:
        """Whether what is needed is available."""
        return abs(self.needed) <= abs(self.available)


def statements(levers: Levers, speed_m_per_s: float) -> tuple[Statement, ...]:
    """Every claim that the levers of a machine decide."""
    return (
        _tension(levers),
        _compression_of_largest_draft(levers),
        _phase(levers),
        _offset(levers),
        _height(levers),
        _frequency(levers),
        _energy(levers, speed_m_per_s),
    )


def _swing_newton(levers: Levers, period_s: float) -> float:
    """Spring force that the shank's inertia can take up while it swings through the printed range."""
    return levers.inertial_newton(printed.ANGLE_RANGE_RAD, period_s)


def _released_newton(levers: Levers) -> float:
    """The same of a shank that the soil lets go at once: it swings at its own frequency."""
    return _swing_newton(levers, 1.0 / levers.frequency_hz)


def _inertia_words(levers: Levers) -> str:
    return (
        f"swung by {printed.ANGLE_RANGE_RAD:g} rad, the shank's inertia, "
        f"{levers.inertia_kg_m2:.2f} kg m2 about the hinge, takes up "
        f"{_swing_newton(levers, printed.PERIOD_S):.0f} N in a cycle of {printed.PERIOD_S:g} s, "
        f"{_swing_newton(levers, printed.DRAFT_PERIOD_S):.0f} N in {printed.DRAFT_PERIOD_S:g} s, and "
        f"{_released_newton(levers):.0f} N where the soil lets go at once and the shank swings at its own "
        f"{levers.frequency_hz:.1f} Hz"
    )


def _tension(levers: Levers) -> Statement:
    tension, least = printed.SPRING_NEWTON[0], printed.DRAFT_NEWTON[0]
    held = levers.unloaded_newton + least * levers.tip_lever_m / levers.spring_arm_m
    share = levers.draft_newton(tension, levers.share_lever_m)
    return Statement(
        f"the spring in {-tension:g} N of tension",
        f"at rest it needs a draft of {share:.0f} N on the share (lever {levers.share_lever_m:.2f} m against "
        f"the spring's {levers.spring_arm_m:.2f} m); the printed least of {least:g} N, all of it at the tip, "
        f"leaves {held - tension:.0f} N of the spring to inertia: {_inertia_words(levers)}",
        held - tension,
        _released_newton(levers),
        "N",
    )


def _compression_of_largest_draft(levers: Levers) -> Statement:
    largest, force = printed.DRAFT_NEWTON[1], printed.SPRING_NEWTON[1]
    at_rest = levers.spring_newton(largest)
    return Statement(
        f"{largest:g} N of draft with {force:g} N on the spring",
        f"at rest {largest:g} N on the share press the spring with {at_rest:.0f} N; {force:g} N go with "
        f"{levers.draft_newton(force, levers.share_lever_m):.0f} N there: the rest is on the wheels, or "
        f"{at_rest - force:.0f} N are inertia of a shank that the next block stops",
        at_rest - force,
        _released_newton(levers),
        "N",
    )


def _phase(levers: Levers) -> Statement:
    spring, draft = printed.SPRING_NEWTON[1], printed.DRAFT_CYCLE_NEWTON[0]
    at_rest = levers.unloaded_newton + draft * levers.tip_lever_m / levers.spring_arm_m
    return Statement(
        f"{spring:g} N on the spring while the draft is {draft:g} N (conclusion 3, at 1.5 s)",
        f"{draft:g} N of draft, all of it at the tip, hold {at_rest:.0f} N of the spring; the other "
        f"{spring - at_rest:.0f} N must accelerate the shank, as in the moment after a failure "
        f"({_released_newton(levers):.0f} N at most), but not in a smooth cycle of {printed.PERIOD_S:g} s "
        f"({_swing_newton(levers, printed.PERIOD_S):.0f} N)",
        spring - at_rest,
        _released_newton(levers),
        "N",
    )


def _offset(levers: Levers) -> Statement:
    """The line from draft to spring force through both printed ranges, and where it meets no draft."""
    low, high = printed.DRAFT_NEWTON
    tension, compression = printed.SPRING_NEWTON
    ratio = (compression - tension) / (high - low)
    offset = tension - ratio * low
    return Statement(
        "both printed ranges in one quasi-static motion",
        f"their ratio, {ratio:.2f} N of spring per N of draft, fits the levers "
        f"({levers.share_lever_m / levers.spring_arm_m:.2f}), but then the spring without draft would be at "
        f"{offset:.0f} N; the shank's weight, {levers.mass_kg:g} kg at {levers.com_arm_m[0] * 1e3:.0f} mm, "
        f"leaves it at {levers.unloaded_newton:.0f} N, and no stop or preload is printed",
        offset,
        levers.unloaded_newton,
        "N",
    )


def _height(levers: Levers) -> Statement:
    swing = printed.ANGLE_RANGE_RAD
    rise = levers.swing_height_m(swing)
    return Statement(
        f"{1e3 * printed.HEIGHT_RANGE_M:.0f} mm of height by {swing:g} rad of swing",
        f"a swing of {swing:g} rad moves the centre of mass by {1e3 * rise:.1f} mm; the rest, "
        f"{1e3 * (printed.HEIGHT_RANGE_M - rise):.0f} mm, is the whole machine going up or down: an entry",
        printed.HEIGHT_RANGE_M,
        rise,
        "m",
    )


def _frequency(levers: Levers) -> Statement:
    frequency = 1.0 / printed.PERIOD_S
    needed = levers.inertia_kg_m2 * (2.0 * math.pi * frequency) ** 2
    return Statement(
        f"the spring's own oscillation at {frequency:g} Hz",
        f"the shank swings on this spring at {levers.frequency_hz:.1f} Hz; {frequency:g} Hz needs "
        f"{needed:.0f} N m/rad instead of {levers.stiffness_newton_m_per_rad:.0f}, and "
        f"{printed.SPRING_NEWTON[1] * levers.spring_arm_m:.0f} N m would turn it by "
        f"{printed.SPRING_NEWTON[1] * levers.spring_arm_m / needed:.1f} rad: the period is not the spring's",
        levers.frequency_hz,
        frequency,
        "Hz",
    )


def _energy(levers: Levers, speed_m_per_s: float) -> Statement:
    stored = 0.5 * printed.SPRING_NEWTON[1] ** 2 / levers.stiffness_newton_per_m
    work = sum(printed.DRAFT_CYCLE_NEWTON) / 2.0 * speed_m_per_s * printed.PERIOD_S
    return Statement(
        "the energy that the spring stores in a cycle",
        f"{stored:.1f} J at {printed.SPRING_NEWTON[1]:g} N, of {work:.0f} J that the trolley spends in "
        f"{printed.PERIOD_S:g} s: there is enough, so energy does not forbid the cycle",
        stored,
        work,
        "J",
    )
