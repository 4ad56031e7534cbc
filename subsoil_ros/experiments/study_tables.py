"""Tables and figure of a study."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from .._version import __version__
from ..analysis.intervals import Interval
from ..figures.sweep_figures import Dot, Panel, draw_study
from ..yaml_document import Document
from .run_metrics import METRICS, Metric
from .study_design import REFERENCE, StudyDesign
from .study_errors import Measurement, PresetResult

_SPEED_UP = ("speed_up", "speed_up_low", "speed_up_high")


def wide_table(judged: Sequence[PresetResult], design: StudyDesign) -> list[Document]:
    """A row per preset. METRIC_error is relative to the reference (energy_residual: a difference), _low and
    _high are of its interval, _verdict is in words; METRIC_error_vs_NAME is against a reference. _runs: how
    many of its runs have the metric, where not all need have it.
    """
    rows = []
    for item in judged:
        row: Document = {
            "preset": item.name,
            **{f"factor.{factor}": item.factors.get(factor, "") for factor in design.factors},
            "seeds": item.seeds,
            "failures": len(item.failures),
            "failure": item.failures[0] if item.failures else "",
            **_interval("wall_s", item.wall_s),
            **_interval("cpu_s", item.cpu_s),
        }
        row |= dict(zip(_SPEED_UP, item.speed_up or (math.nan,) * 3, strict=True))
        for metric in METRICS:
            row |= _interval(metric.name, item.values.get(metric.name))
            row |= _interval(f"{metric.name}_error", item.errors.get(metric.name))
            row[f"{metric.name}_verdict"] = item.verdict(metric.name)
            if metric.absent_in_some:
                row[f"{metric.name}_runs"] = item.runs_with(metric.name)
            for name in design.additional_references:
                error = item.errors_against.get(name, {}).get(metric.name)
                row |= _interval(f"{metric.name}_error_vs_{name}", error)
        rows.append({**row, "bound": item.bound, "pareto": item.pareto})
    return rows


def _interval(name: str, interval: Interval | None) -> dict[str, float]:
    if interval is None:
        return {name: math.nan, f"{name}_low": math.nan, f"{name}_high": math.nan}
    return {name: interval.mean, f"{name}_low": interval.low, f"{name}_high": interval.high}


def markdown(judged: Sequence[PresetResult], design: StudyDesign, measured: Sequence[Measurement]) -> str:
    """The printed table: CPU time, speed-up, and each error with its interval."""
    metrics = [metric for metric in METRICS if _told(judged, metric)]
    heads = ["preset", "CPU s", "times faster", *(_heading(metric) for metric in metrics), "Pareto"]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for item in judged:
        name = item.name.replace("|", r"\|")
        if item.cpu_s is None:
            reason = item.failures[0].replace("|", "/") if item.failures else "no run"
            lines.append(f"| {name} | failed: {reason} |" + " |" * (len(heads) - 2))
            continue
        cells = [name, _plus_minus(item.cpu_s, "{:.3g}"), _faster(item)]
        cells += [_cell(item, metric) for metric in metrics]
        lines.append(f"| {' | '.join([*cells, 'yes' if item.pareto else ''])} |")
    return "\n".join([*lines, "", *_legend(judged, design), *_true_runs(design, measured), ""])


def _told(judged: Sequence[PresetResult], metric: Metric) -> bool:
    """Whether a metric has a column: an error, or a value where the reference runs have none."""
    return any(metric.name in item.errors for item in judged) or (
        metric.absent_in_some != "" and any(metric.name in item.values for item in judged)
    )


def _heading(metric: Metric) -> str:
    return f"{metric.label} %" if metric.relative else f"{metric.label} (difference)"


def _cell(item: PresetResult, metric: Metric) -> str:
    value, error = item.values.get(metric.name), item.errors.get(metric.name)
    if metric.absent_in_some and (error is None or item.name == REFERENCE):
        return f"({_presence(item, metric)})"
    if value is None or error is None:
        return ""
    if item.name == REFERENCE:
        return f"({value.mean:.4g})"
    scaled = error.scaled(100.0) if metric.relative else error
    text = _plus_minus(scaled, "{:+.3g}" if metric.relative else "{:+.1g}")
    if metric.absent_in_some and error.count < item.seeds:
        text += f", in {error.count} of {item.seeds}"
    return f"{text} (~)" if item.verdict(metric.name) == "within seed scatter" else text


def _presence(item: PresetResult, metric: Metric) -> str:
    """The value of a metric that not all runs have, and how many do."""
    value = item.values.get(metric.name)
    return "none" if value is None else f"{value.mean:.3g} {metric.unit} in {value.count} of {item.seeds}"


def _plus_minus(interval: Interval, form: str) -> str:
    text = form.format(interval.mean)
    if math.isnan(interval.half_width):
        return text
    return f"{text} +- {form.replace('+', '').format(interval.half_width)}"


def _faster(item: PresetResult) -> str:
    if item.speed_up is None:
        return ""
    mean, low, high = item.speed_up
    return f"{mean:.3g}" if math.isnan(low) else f"{mean:.3g} ({low:.3g} to {high:.3g})"


def _legend(judged: Sequence[PresetResult], design: StudyDesign) -> list[str]:
    percent = f"{100.0 * design.confidence:g} %"
    whose = "Student's t of the differences of equal seeds"
    if design.intervals == "records":
        whose = f"of the runs' own records where they have one, else {whose}"
    lines = [
        f"Errors against `{REFERENCE}`, whose row has the values themselves; {len(design.seeds)} bed seeds. "
        f"+-: {percent} intervals, {whose}; (~): less than the scatter "
        "of the seeds, so no difference that these runs resolve. CPU time: of the ticks alone, without "
        "start-up and compilation. Pareto: no other run is both faster and nearer, by "
        f"{' and '.join(design.metrics)} at the far end of their intervals."
    ]
    for metric in METRICS:
        if metric.absent_in_some:
            told = "in brackets the value itself" if _told(judged, metric) else "no run has one"
            lines.append(f"{metric.label.capitalize()}: {told}; {metric.absent_in_some}.")
    if len(design.seeds) == 1 and design.intervals != "records":
        lines.append("One seed: nothing says how much a difference means.")
    return lines


def _true_runs(design: StudyDesign, measured: Sequence[Measurement]) -> list[str]:
    """The runs that count as true, one by one: those of the reference and of the additional references."""
    return [
        f"- `{item.preset}`, seed {item.seed}, {item.cpu_s:.4g} s: "
        + "; ".join(
            f"{metric.label} {item.metrics[metric.name]:.4g}"
            for metric in METRICS
            if metric.name in item.metrics
        )
        + "."
        for item in measured
        if item.preset in (REFERENCE, *design.additional_references)
    ]


def expected_presets(
    judged: Sequence[PresetResult],
    design: StudyDesign,
    facts: Document,
    duration_s: float,
    scene: str,
) -> Document:
    """`expected:` of the reference and each preset, as a scene's presets take it; only measured intervals.

    The reference's own error is the scatter of its mean over the seeds.
    """
    seeds = f"{len(design.seeds)} bed seeds"
    found: Document = {}
    for item in judged:
        if item.wall_s is None or item.name not in (REFERENCE, *design.presets):
            continue
        errors, against = item.errors, f"{REFERENCE}, {seeds}"
        if item.name == REFERENCE:
            errors, against = _scatter(item), f"its own mean over {seeds}"
        found[item.name] = {
            "expected": {
                "against": against,
                "errors": _intervals(errors),
                "errors_against": {name: _intervals(others) for name, others in item.errors_against.items()},
                "confidence": design.confidence,
                **_notes(item, judged[0]),
                "wall_s_per_simulated_s": item.wall_s.mean / duration_s,
                "machine": f"{facts['machine']}, {facts['threads']} threads",
                "source": f"subsoil study {Path(scene).name}, version {__version__}, engines {facts['code']}",
            }
        }
    return found


def _notes(item: PresetResult, reference: PresetResult) -> dict[str, list[str]]:
    """What no error says: a metric that more or fewer of its runs have than of the reference's."""
    notes = [
        f"{metric.label}: {_presence(item, metric)}; {REFERENCE}: {_presence(reference, metric)}"
        for metric in METRICS
        if metric.absent_in_some and item.runs_with(metric.name) != reference.runs_with(metric.name)
    ]
    return {"notes": notes} if notes else {}


def _scatter(item: PresetResult) -> dict[str, Interval]:
    """Relative intervals of a preset's own means."""
    found = {}
    for metric in METRICS:
        value, unit = item.values.get(metric.name), item.values.get(metric.part_of or metric.name)
        if value is not None and unit is not None and unit.mean:
            found[metric.name] = Interval(0.0, value.half_width / abs(unit.mean), value.count)
    return found


def _intervals(errors: Mapping[str, Interval]) -> dict[str, dict[str, float]]:
    """Of the metrics whose error is a part of the true value, where there is an interval."""
    return {
        metric.name: {"mean": error.mean, "low": error.low, "high": error.high}
        for metric in METRICS
        if metric.relative
        and (error := errors.get(metric.name)) is not None
        and not math.isnan(error.half_width)
    }


def draw(judged: Sequence[PresetResult], design: StudyDesign, scene: str, path: Path) -> Path:
    """Errors against CPU time, a panel per metric."""
    panels = []
    for metric in METRICS:
        factor = 100.0 if metric.relative else 1.0
        title = f"{metric.label}, against the reference run"
        unit = "error [%]" if metric.relative else "difference"
        shown = [item.errors.get(metric.name) for item in judged]
        dots = _dots(judged, [None if error is None else error.scaled(factor) for error in shown])
        if not dots and _told(judged, metric):
            title, unit = f"{metric.label}; the reference run has none", f"[{metric.unit}]"
            values = _dots(judged, [item.values.get(metric.name) for item in judged])
            dots = tuple(replace(dot, resolved=True) for dot in values)
        if dots:
            panels.append(Panel(title, unit, dots))
    pareto = [number for number, item in enumerate(judged) if item.pareto]
    title = (
        f"{scene}: {len(design.seeds)} bed seeds, {100 * design.confidence:g} % intervals; "
        "hollow: less than the seeds' scatter; bold: Pareto"
    )
    return draw_study(panels, [item.name for item in judged], pareto, title, path)


def _dots(judged: Sequence[PresetResult], shown: Sequence[Interval | None]) -> tuple[Dot, ...]:
    return tuple(
        Dot(number, _group(item), item.cpu_s.mean, found.mean, found.half_width, found.resolved)
        for number, (item, found) in enumerate(zip(judged, shown, strict=True))
        if item.cpu_s is not None and found is not None
    )


def _group(item: PresetResult) -> str:
    if len(item.factors) == 1 and ": " in item.name:
        return next(iter(item.factors))
    return REFERENCE if item.name == REFERENCE else "presets"
