"""Printed lines of a summary's loads and statistics."""

from collections.abc import Mapping
from typing import Any

Summary = Mapping[str, Any]

_CARRIERS = {
    "share": "soil on share", "wheels": "wheels", "hitch": "hitch", "tethers": "tethers", "loads": "loads",
    "inertia": "inertia",
}  # fmt: skip


def load_lines(summary: Summary) -> list[str]:
    """Lines of the quantities that the run has."""
    lines = [folded(summary), *load_words(summary).values()]
    return [line for line in lines if line]


def load_words(summary: Summary) -> dict[str, str]:
    """The same under headings, without `folded`."""
    words = {
        "Draft": _stationarity(summary),
        "Weight": _vertical(summary),
        "Power": _power(summary),
        "Frequency": _dominant_frequency(summary),
        "Cycle": _failures(summary),
        "Fatigue": _spring(summary),
        "Loosened section": _disturbance(summary),
    }
    return {heading: line for heading, line in words.items() if line}


def design_rows(summary: Summary, spring: str | None) -> list[tuple[str, str]]:
    """Results for a designer, heading and words; what the run does not have is absent.

    spring: name of the spring that the scene reports.
    """
    series, words = summary["series"], load_words(summary)
    for heading, name, sign in (
        ("Draft", "draft_newton", ""),
        ("Spring load", f"spring.{spring}.force_newton", " (compression is positive)"),
    ):
        found = series.get(name)
        if found is not None and found["mean"] is not None:
            spread = f"from {found['min']:.0f} to {found['max']:.0f} N{sign}"
            mean = words.get(heading, f"mean {found['mean']:.0f} N")
            words[heading] = f"{mean}; {spread}"
            if heading == "Draft" and found.get("stationarity") is None:
                words[heading] += "; the window is too short for an interval"
    order = ("Draft", "Cycle", "Frequency", "Spring load", "Fatigue", "Loosened section", "Power", "Weight")
    return [(heading, words[heading]) for heading in order if heading in words]


def folded(summary: Summary) -> str:
    """Line that the soil folded the shank back, with the time; empty where it did not."""
    passed = summary["loads"].get("past_dead_centre_s")
    if passed is None:
        return ""
    return (
        f"the soil folded the shank back: at {passed:.3f} s it passed the dead centre of its spring, and "
        "what follows is not the draft of a working tool"
    )


def _stationarity(summary: Summary) -> str:
    draft = summary["series"].get("draft_newton", {})
    steady = draft.get("stationarity")
    if steady is None:
        return ""
    words = f"draft: {draft['mean']:.0f}"
    if steady["mean_half_width"] is not None:
        words += f" +- {steady['mean_half_width']:.0f}"
    words += f" N (95 %, {steady['effective_count']:.0f} independent samples)"
    drift, half = steady["drift"], steady["drift_half_width"]
    if drift is not None and half is not None:
        words += f", trend over the window {100.0 * drift:+.1f} +- {100.0 * half:.1f} %"
    return f"{words}: {steady['verdict']}"


def _vertical(summary: Summary) -> str:
    vertical = summary["loads"]["vertical"]
    if "weight_newton" not in vertical:
        return ""
    parts = [
        f"{label} {vertical[f'{key}_newton']['mean']:.0f} N"
        for key, label in _CARRIERS.items()
        if f"{key}_newton" in vertical
    ]
    words = (
        f"weight {vertical['weight_newton']:.0f} N is carried by {', '.join(parts)}, rest "
        f"{vertical['rest_newton']:.0f} N (up is positive)"
    )
    if "wheels_newton" in vertical:
        words += f"; least on the wheels {vertical['wheels_newton']['min']:.0f} N"
    if "tip_depth_m" in summary["loads"]:
        words += f"; tip {1e3 * summary['loads']['tip_depth_m']['mean']:.0f} mm deep"
    return words


def _power(summary: Summary) -> str:
    power, specific = summary["loads"]["power"], summary["loads"]["specific"]
    if "draft_watt" not in power:
        return ""
    words = f"power {power['draft_watt']['mean']:.0f} W"
    if "energy_joule_per_m" in specific:
        words += f", {specific['energy_joule_per_m']:.0f} J/m"
    if "energy_joule_per_m3" in specific:
        words += f", {1e-3 * specific['energy_joule_per_m3']:.1f} kJ per cubic metre loosened"
    if "draft_newton_per_m" in specific:
        words += f"; draft {1e-3 * specific['draft_newton_per_m']:.1f} kN per metre of share"
    if "draft_pa" in specific:
        words += f", {1e-3 * specific['draft_pa']:.1f} kPa of loosened section"
    return words


def _dominant_frequency(summary: Summary) -> str:
    found = summary["series"].get("draft_newton", {}).get("spectrum")
    if found is None:
        return ""
    stands = "stands out of" if found["significant"] else "does not stand out of"
    return (
        f"draft is strongest at {found['dominant_hz']:.2f} Hz (resolved to {found['resolution_hz']:.2f} Hz), "
        f"which {stands} red noise (95 %)"
    )


def _failures(summary: Summary) -> str:
    found = summary.get("failure_cycles")
    if found is None:
        return ""
    travel = {key: 1e3 * value for key, value in found["travel_m"].items()}
    words = (
        f"soil fails every {travel['mean']:.0f} +- {travel['half_width']:.0f} mm of travel (deviation "
        f"{travel['deviation']:.0f} mm), every {found['time_s']['mean']:.2f} s (deviation "
        f"{found['time_s']['deviation']:.2f} s): {found['count']} cycles between peaks of the draft that "
        f"stand out by {found['threshold_newton']:.0f} N, one standard deviation; the draft rises in "
        f"{found['loading_fraction']:.2f} of the time"
    )
    if found["unloading_over_loading"] is not None:
        words += f" and falls {found['unloading_over_loading']:.2f} times as fast as it rises"
    return words


def _spring(summary: Summary) -> str:
    found = summary["loads"].get("rainflow")
    if found is None:
        return ""
    return (
        f"spring: {found['cycle_count']:g} load cycles, the largest of {found['max_range_newton']:.0f} N; as "
        f"harmful as {found['equivalent_range_newton']:.0f} N once a second"
    )


def _disturbance(summary: Summary) -> str:
    found = summary.get("disturbance")
    if found is None:
        return ""
    half = found.get("area_half_width_m2")
    interval = "" if half is None else f" +- {1e4 * half:.0f}"
    return (
        f"soil: {1e4 * found['area_m2']:.0f}{interval} cm2 loosened "
        f"({100.0 * found['moved_fraction']:.1f} % of the bed moved by more than a radius), "
        f"{1e3 * found['surface_width_m']:.0f} mm wide at the surface, "
        f"which rose by {1e3 * found['lift_max_m']:.0f} mm at most"
    )
