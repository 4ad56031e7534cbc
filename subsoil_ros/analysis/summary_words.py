"""What of a summary's loads and statistics is printed, line by line."""

from collections.abc import Mapping
from typing import Any

Summary = Mapping[str, Any]


def load_lines(summary: Summary) -> list[str]:
    """Lines for what the run has; none for what it has not."""
    lines = [
        _folded(summary),
        _stationarity(summary),
        _vertical(summary),
        _power(summary),
        _dominant_frequency(summary),
        _failures(summary),
        _spring(summary),
        _disturbance(summary),
    ]
    return [line for line in lines if line]


def _folded(summary: Summary) -> str:
    if "shank.past_dead_centre_s" not in summary:
        return ""
    return (
        f"the soil folded the shank back: at {summary['shank.past_dead_centre_s']:.3f} s it passed the dead "
        "centre of its spring, and what follows is not the draft of a working tool"
    )


def _stationarity(summary: Summary) -> str:
    prefix = "steady.draft_newton"
    if f"{prefix}_verdict" not in summary:
        return ""
    words = f"draft: {summary['draft_newton_mean']:.0f}"
    if f"{prefix}_mean_half_width" in summary:
        words += f" +- {summary[f'{prefix}_mean_half_width']:.0f}"
    words += f" N (95 %, {summary[f'{prefix}_effective_count']:.0f} independent samples)"
    if f"{prefix}_drift_half_width" in summary:
        drift, half = summary[f"{prefix}_drift"], summary[f"{prefix}_drift_half_width"]
        words += f", trend over the window {100.0 * drift:+.1f} +- {100.0 * half:.1f} %"
    return f"{words}: {summary[f'{prefix}_verdict']}"


def _vertical(summary: Summary) -> str:
    if "vertical.weight_newton" not in summary:
        return ""
    parts = [
        f"{label} {summary[f'vertical.{key}_newton_mean']:.0f} N"
        for key, label in (("share", "soil on share"), ("wheels", "wheels"), ("hitch", "hitch"))
        if f"vertical.{key}_newton_mean" in summary
    ]
    words = (
        f"weight {summary['vertical.weight_newton']:.0f} N is carried by {', '.join(parts)} (up is positive)"
    )
    if "vertical.wheels_newton_min" in summary:
        words += f"; least on the wheels {summary['vertical.wheels_newton_min']:.0f} N"
    if "tip_depth_m_mean" in summary:
        words += f"; tip {1e3 * summary['tip_depth_m_mean']:.0f} mm deep"
    return words


def _power(summary: Summary) -> str:
    if "power.draft_watt_mean" not in summary:
        return ""
    words = f"power {summary['power.draft_watt_mean']:.0f} W"
    if "specific.energy_joule_per_m" in summary:
        words += f", {summary['specific.energy_joule_per_m']:.0f} J/m"
    if "specific.energy_joule_per_m3" in summary:
        words += f", {1e-3 * summary['specific.energy_joule_per_m3']:.1f} kJ per cubic metre loosened"
    if "specific.draft_newton_per_m" in summary:
        words += f"; draft {1e-3 * summary['specific.draft_newton_per_m']:.1f} kN per metre of share"
    if "specific.draft_pa" in summary:
        words += f", {1e-3 * summary['specific.draft_pa']:.1f} kPa of loosened section"
    return words


def _dominant_frequency(summary: Summary) -> str:
    prefix = "spectrum.draft_newton"
    if f"{prefix}_dominant_hz" not in summary:
        return ""
    stands = "stands out of" if summary[f"{prefix}_significant"] else "does not stand out of"
    return (
        f"draft is strongest at {summary[f'{prefix}_dominant_hz']:.2f} Hz (resolved to "
        f"{summary[f'{prefix}_resolution_hz']:.2f} Hz), which {stands} red noise (95 %)"
    )


def _failures(summary: Summary) -> str:
    if "cycle.count" not in summary:
        return ""
    travel = {key: 1e3 * summary[f"cycle.travel_m_{key}"] for key in ("mean", "half_width", "deviation")}
    return (
        f"soil fails every {travel['mean']:.0f} +- {travel['half_width']:.0f} mm of travel (deviation "
        f"{travel['deviation']:.0f} mm), every {summary['cycle.time_s_mean']:.2f} s (deviation "
        f"{summary['cycle.time_s_deviation']:.2f} s): {summary['cycle.count']:.0f} cycles between peaks of "
        f"the draft that stand out by {summary['cycle.threshold_newton']:.0f} N, one standard deviation; the "
        f"draft rises in {summary['cycle.loading_fraction']:.2f} of the time and falls "
        f"{summary['cycle.unloading_over_loading']:.2f} times as fast as it rises"
    )


def _spring(summary: Summary) -> str:
    if "rainflow.cycle_count" not in summary:
        return ""
    return (
        f"spring: {summary['rainflow.cycle_count']:g} load cycles, the largest of "
        f"{summary['rainflow.max_range_newton']:.0f} N; as harmful as "
        f"{summary['rainflow.equivalent_range_newton']:.0f} N once a second"
    )


def _disturbance(summary: Summary) -> str:
    if "disturbance.area_m2" not in summary:
        return ""
    return (
        f"soil: {1e4 * summary['disturbance.area_m2']:.0f} cm2 loosened "
        f"({100.0 * summary['disturbance.moved_fraction']:.1f} % of the bed moved by more than a radius), "
        f"{1e3 * summary['disturbance.surface_width_m']:.0f} mm wide at the surface, which rose by "
        f"{1e3 * summary['disturbance.lift_max_m']:.0f} mm at most"
    )
