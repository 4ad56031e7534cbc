"""The paper's printed results beside a run: one row each, inside and outside of the metrics window.

Extremes and peak to peak are those of the 10 ms moving mean, cycle means the mean over the window; raw
extremes stand beside. A row agrees if ours is within 25 % of the printed value (the project's target). Values
whose sign or zero the paper leaves open are given under both readings, and not judged.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from subsoil_ros.analysis.columns import DRAFT, TIME, Body, spring_element
from subsoil_ros.analysis.disturbance import ZONE_M, SpeedZones
from subsoil_ros.analysis.metrics_window import Window
from subsoil_ros.analysis.series import Series, moving_mean
from subsoil_ros.analysis.spectra import SEGMENTS, SLOWEST
from subsoil_ros.analysis.summarize import MOVING_S, RunStatistics, compared_columns
from subsoil_ros.run_results import significance_words
from subsoil_ros.scene.mechanism import Driver
from subsoil_ros.scene.scene import Scene
from subsoil_ros.scene.time_laws import ConstantLaw

from . import printed
from .consistency import Statement, statements
from .levers import levers_of

TARGET = 0.25
"""Relative difference that counts as reproduced."""

RESOLVED_PERIODS = SEGMENTS * SLOWEST
"""A window that holds fewer of a period cannot show it: its spectrum does not look at it."""


@dataclass(frozen=True)
class Row:
    """One printed quantity. Differences are relative to the printed value."""

    quantity: str
    unit: str
    measure: str  # what of the run is compared
    published: float | None  # None: words
    inside: float | None  # in the metrics window; None: the run has none
    outside: float | None  # in the rest of the run
    raw_inside: float | None  # without moving mean, where that is something else
    raw_outside: float | None
    remark: str = ""

    @property
    def difference_inside(self) -> float | None:
        """Ours less the printed, over the printed."""
        return _relative(self.inside, self.published)

    @property
    def difference_outside(self) -> float | None:
        """As difference_inside."""
        return _relative(self.outside, self.published)

    @property
    def agrees(self) -> str:
        """Where ours is within TARGET: `window`, `outside`, `no`, or `` where there is nothing to judge."""
        if self.published is None:
            return ""
        for where, difference in (("window", self.difference_inside), ("outside", self.difference_outside)):
            if difference is not None and abs(difference) <= TARGET:
                return where
        return "no" if self.inside is not None or self.outside is not None else ""


@dataclass(frozen=True)
class Reproduction:
    """The whole table, and what of the printed numbers cannot hold."""

    scene: str
    scene_hash: str
    rows: tuple[Row, ...]
    statements: tuple[Statement, ...]

    def document(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "scene": self.scene,
            "scene_hash": self.scene_hash,
            "rows": [
                {**asdict(row), "difference_inside": row.difference_inside,
                 "difference_outside": row.difference_outside, "agrees": row.agrees}
                for row in self.rows
            ],
            "statements": [{**item._asdict(), "holds": item.holds} for item in self.statements],
            "contradictions": printed.REFERENCE.notes,
        }  # fmt: skip


def reproduction(
    scene: Scene, scene_hash: str, series: Series, window: Window, statistics: RunStatistics
) -> Reproduction:
    """The table of a run of the paper's machine; rows whose column the run lacks are left out."""
    levers = levers_of(scene)
    proofs = statements(levers, _speed(scene)) if levers is not None else ()
    rows = [
        *_extreme_rows(scene, series, window),
        *_period_rows(scene, window, series, statistics),
        *_phase_rows(scene, series, window),
        *_disturbance_rows(statistics),
    ]
    return Reproduction(scene.name, scene_hash, tuple(rows), proofs)


def _relative(ours: float | None, published: float | None) -> float | None:
    if ours is None or published is None or published == 0.0:
        return None
    return (ours - published) / abs(published)


def _speed(scene: Scene) -> float:
    """Working speed of the trolley [m/s]; that of the paper unless the scene drives at another."""
    mechanism = scene.mechanism
    if mechanism is not None and mechanism.draft_driver is not None:
        driver = mechanism.joints[mechanism.draft_driver]
        if isinstance(driver, Driver) and isinstance(driver.speed, ConstantLaw):
            return driver.speed.value
    return printed.SPEED_M_PER_S


@dataclass(frozen=True)
class _Extremes:
    """Least, largest and mean of one column, smoothed and raw, in and out of the window."""

    low: tuple[float, float | None]  # inside, outside
    high: tuple[float, float | None]
    mean: tuple[float, float | None]
    raw_low: tuple[float, float | None]
    raw_high: tuple[float, float | None]

    @staticmethod
    def of(series: Series, name: str, window: Window) -> "_Extremes":
        smooth, raw = moving_mean(series, name, MOVING_S), np.asarray(series[name], np.float64)
        rows, rest = window.rows, ~window.rows

        def both(values: NDArray[np.float64], take: Any) -> tuple[float, float | None]:
            return float(take(values[rows])), float(take(values[rest])) if rest.any() else None

        return _Extremes(
            both(smooth, np.min),
            both(smooth, np.max),
            both(raw, np.mean),
            both(raw, np.min),
            both(raw, np.max),
        )

    def row(
        self, quantity: str, unit: str, measure: str, published: float, part: str, remark: str = ""
    ) -> Row:
        (inside, outside), raw = getattr(self, part), getattr(self, f"raw_{part}", (None, None))
        return Row(quantity, unit, measure, published, inside, outside, raw[0], raw[1], remark)

    def span(self, quantity: str, unit: str, published: float, remark: str = "") -> Row:
        smooth, raw = (
            tuple(None if a is None or b is None else a - b for a, b in zip(high, low, strict=True))
            for high, low in ((self.high, self.low), (self.raw_high, self.raw_low))
        )
        return Row(quantity, unit, "peak to peak", published, smooth[0], smooth[1], raw[0], raw[1], remark)


def _extreme_rows(scene: Scene, series: Series, window: Window) -> Iterator[Row]:
    draft = _Extremes.of(series, DRAFT, window)
    low, high = printed.DRAFT_CYCLE_NEWTON
    yield draft.row("draft, cycle", "N", "least", low, "low")
    yield draft.row("draft, cycle", "N", "largest", high, "high")
    yield draft.span("draft, cycle", "N", high - low)
    yield draft.row("draft, cycle", "N", "mean", 0.5 * (low + high), "mean", "printed: middle of the cycle")
    yield draft.row("draft, run", "N", "largest", printed.DRAFT_NEWTON[1], "high", "printed at 3.5 s")
    yield draft.row("draft, run", "N", "least", printed.DRAFT_NEWTON[0], "low", "negative: pushed forward")
    names = compared_columns(scene)
    spring = spring_element(scene.report.spring).load
    if spring in names and spring in series:
        force = _Extremes.of(series, spring, window)
        tension, compression = printed.SPRING_NEWTON
        yield force.row("spring force", "N", "largest compression", compression, "high")
        yield force.row("spring force", "N", "largest tension", tension, "low", "tension is negative")
        yield force.span("spring force", "N", compression - tension)
    shank = scene.report.shank
    if shank is not None and scene.mechanism is not None and Body(shank).angle_rad in series:
        angle = _Extremes.of(series, Body(shank).angle_rad, window)
        turn = [value - scene.mechanism.bodies[shank].angle_rad for value in (angle.low[0], angle.high[0])]
        yield angle.span(
            "share entry angle", "rad", printed.ANGLE_RANGE_RAD,
            f"from the working pose, tip back negative: {turn[0]:.4f} to {turn[1]:.4f}; mirrored: "
            f"{-turn[1]:.4f} to {-turn[0]:.4f}",
        )  # fmt: skip
        height = _Extremes.of(series, Body(shank).z_m, window)
        yield height.span("height of the shank's centre of mass", "m", printed.HEIGHT_RANGE_M)


def _period_rows(scene: Scene, window: Window, series: Series, statistics: RunStatistics) -> Iterator[Row]:
    times = series[TIME][window.rows]
    length_s = float(times[-1] - times[0])
    spring, shank = scene.report.spring, scene.report.shank
    for label, name, published in (
        ("period of the draft", DRAFT, printed.DRAFT_PERIOD_S),
        ("period of the spring force", spring_element(spring).load, printed.PERIOD_S),
        ("period of the entry angle", Body(shank).angle_rad, printed.PERIOD_S),
        ("period of the height", Body(shank).z_m, printed.PERIOD_S),
    ):
        found = statistics.spectra.get(name)
        if found is None:
            continue
        half = 0.5 * found.resolution_hz
        remark = (
            f"largest density at {found.dominant_hz:.2f} +- {half:.2f} Hz, which {significance_words(found)}"
        )
        period_s = 1.0 / found.dominant_hz if found.significant else None
        if length_s < RESOLVED_PERIODS * published:
            remark += f"; {length_s:.2f} s do not hold {RESOLVED_PERIODS:g} periods of {published:g} s"
        yield Row(label, "s", "dominant", published, period_s, None, None, None, remark)


def _phase_rows(scene: Scene, series: Series, window: Window) -> Iterator[Row]:
    """Correlation of rates of draft and spring energy: -1 by conclusion 3, +1 by the end of section 4.2."""
    found = phase(scene, series, window)
    if found is None:
        return
    for reading, published in (("conclusion 3", -1.0), ("end of section 4.2", 1.0)):
        yield Row(
            "phase of draft and spring energy", "", f"correlation of rates, {reading}", None, found, None,
            None, None, "the paper: draft"
            f" {'falls' if published < 0.0 else 'rises'} while the spring stores ({published:+g})",
        )  # fmt: skip


def phase(scene: Scene, series: Series, window: Window) -> float | None:
    """Correlation of d(draft)/dt with d(spring energy)/dt over the window, from 10 ms moving means.

    The energy is that of a linear spring, F^2 / (2 k), F without its damper: k (free length - length).
    """
    levers = levers_of(scene)
    name = spring_element(scene.report.spring).coordinate
    if levers is None or name not in series or window.rows.sum() < 16 or scene.mechanism is None:
        return None
    spring: Any = scene.mechanism.forces[str(scene.report.spring)]
    compression = spring.free_length_m - moving_mean(series, name, MOVING_S)[window.rows]
    energy = 0.5 * levers.stiffness_newton_per_m * compression**2 + spring.preload_newton * compression
    draft = moving_mean(series, DRAFT, MOVING_S)[window.rows]
    one, two = np.diff(draft), np.diff(energy)
    if one.std() == 0.0 or two.std() == 0.0:
        return None
    return float(np.corrcoef(one, two)[0, 1])


def _disturbance_rows(statistics: RunStatistics) -> Iterator[Row]:
    found = statistics.disturbance
    if found is None or found.speeds is None:
        return
    speeds = found.speeds

    def row(measure: str, holds: bool, values: tuple[float, ...], unit: str) -> Row:
        shown = ", ".join(f"{value:.3f}" if math.isfinite(value) else "-" for value in values)
        return Row(
            "disturbance", "", measure, None, 1.0 if holds else 0.0, None, None, None,
            f"{'holds' if holds else 'does not hold'}: {shown} {unit}",
        )  # fmt: skip

    steps = f"m/s in steps of {ZONE_M:g} m"
    yield row("most at the tip, then at the blade", most_at_tip(speeds), (speeds.tip, speeds.blade), "m/s")
    yield row("decreases ahead", falls(speeds.ahead), speeds.ahead, steps)
    yield row("decreases sideways", falls(speeds.aside), speeds.aside, steps)


def most_at_tip(speeds: SpeedZones) -> bool:
    """Fastest at the tip, then at the blade, then elsewhere: the paper's order."""
    others = [value for value in (*speeds.ahead[1:], *speeds.aside[1:]) if math.isfinite(value)]
    return bool(speeds.tip > speeds.blade > max(others, default=0.0))


def falls(speeds: tuple[float, ...]) -> bool:
    """Whether speeds decrease from zone to zone, those left out where no particle was."""
    known = [value for value in speeds if math.isfinite(value)]
    return len(known) > 1 and all(b < a for a, b in itertools.pairwise(known))
