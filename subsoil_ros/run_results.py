"""Results of a run in words and tables, as the command line prints them and the page of a run shows them."""

import csv
import difflib
import sys
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .analysis.columns import (
    DRAFT,
    MECHANISM,
    Body,
    PlanarTool,
    Wrench,
    draft_parts,
    spring_element,
)
from .analysis.fitted_range import words
from .analysis.spectra import SLOWEST, Spectrum
from .analysis.summary import KnownMean, Number, Summary, flattened, path_of
from .limits.soil_at_work import speed_and_depth
from .loading.loader import ResolvedScene
from .loading.reference import Reference, ReferenceValue
from .scene.scene import Scene
from .scene.tool_mesh import load_tool_mesh
from .units import unit_of_path
from .yaml_document import Document

_CARRIERS = {
    "share": "soil on share", "wheels": "wheels", "hitch": "hitch", "tethers": "tethers", "loads": "loads",
    "inertia": "inertia",
}  # fmt: skip


def print_summary(
    summary: Summary,
    scene: Scene,
    directory: Path,
    console: Console | None = None,
    bag: Path | None = None,
    reference: Reference | None = None,
) -> None:
    """The printed tables: metrics, the values of a reference beside them, and where all is.

    bag: folder or .mcap file (default: `bag` in `directory`).
    """
    console = console or Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    headings, rows = metrics_table(summary, scene)
    if rows:
        console.print(_table(f"{scene.name}: {summary.run.simulated_s:.4g} s simulated", headings, rows))
    figures = directory / "figures"
    drawn = str(figures) if figures.is_dir() else f"none yet, `subsoil report {directory}` draws them"
    lines = [*summary_facts(summary), _bag_words(bag or directory / "bag"), f"figures: {drawn}"]
    if reference is not None:
        cells = [row.cells() for row in reference_rows(reference, summary.document())]
        console.print(_table(f"beside {escape(reference.name)}", HEADINGS, cells))
        lines = reference_lines(reference, summary.document()) + lines
    for line in lines:
        console.print(line, soft_wrap=True, markup=False)


def _table(title: str, headings: Iterable[str], rows: Iterable[list[str]]) -> Table:
    found = Table(title=title, title_justify="left")
    for k, heading in enumerate(headings):
        found.add_column(heading, justify="left" if heading in WORDS else "right", no_wrap=k == 0)
    for row in rows:
        found.add_row(*map(escape, row))
    return found


def metrics_table(summary: Summary, scene: Scene) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the metrics, as text."""
    headings = ["quantity", "mean", "min", "max", "range", "run min", "run max"]
    rows = []
    for label, name, scale, digits in _lines(scene, summary):
        found = summary.series[name]
        low, high = found.min, found.max
        spread = None if low is None or high is None else high - low
        values = [found.mean, low, high, spread, found.run.min, found.run.max]
        rows.append([label, *("" if value is None else f"{value * scale:.{digits}f}" for value in values)])
    return headings, rows


def _bag_words(bag: Path) -> str:
    files = [bag] if bag.is_file() else bag.glob("*.mcap")
    size_bytes = sum(path.stat().st_size for path in files)
    return f"bag: {bag}, {size_bytes / 1e6:.3g} MB (`subsoil bag info {bag}` says what takes the room)"


def _lines(scene: Scene, summary: Summary) -> list[tuple[str, str, float, int]]:
    """(label, column, scale, digits) of each row of the table whose column the run has."""
    shank, spring = scene.report.shank, scene.report.spring
    lines: list[tuple[str, str, float, int]] = [
        ("draft [N]", DRAFT, 1.0, 1),
        *((f"  {words} [N]", name, 1.0, 1) for name, words in draft_parts(scene).items()),
        ("spring force, compression + [N]", spring_element(spring).load, 1.0, 1),
        ("share angle [rad]", Body(shank).angle_rad, 1.0, 4),
        ("shank centre of mass, height [mm]", Body(shank).z_m, 1e3, 2),
    ]
    return [line for line in lines if line[1] in summary.series]


@dataclass(frozen=True)
class Result:
    """One result over the metrics window."""

    quantity: str
    value: float
    half_width: float | None  # of the 95 % interval; None where there is none
    unit: str

    def cells(self) -> list[str]:
        """Texts of the row: quantity, value, half-width, unit."""
        return [self.quantity, _rounded(self.value), _rounded(self.half_width), self.unit]


def results_of(summary: Summary, resolved: ResolvedScene) -> list[Result]:
    """The results that a run has; forces and moments are those of the soil on a tillage tool."""
    scene = resolved.scene
    tools = [name for name, tool in scene.tools.items() if tool.is_tillage]
    columns = {"draft": DRAFT}
    for name in tools:
        load, of = Wrench(name), f" on {name}" if len(tools) > 1 else ""
        columns[f"vertical force{of}, up +"] = load.force_z_newton
        columns[f"side force{of}, to the left +"] = load.force_y_newton
        columns[f"moment{of} about y"] = load.torque_y_newton_m
    columns["spring force, compression +"] = spring_element(scene.report.spring).load
    rows = {
        words: (path_of(column, "mean"), path_of(column, "stationarity", "mean_half_width"))
        for words, column in columns.items()
    }
    rows["mean power"] = ("loads.power.draft_watt.mean", "")
    rows["energy per loosened volume"] = ("loads.specific.energy_joule_per_m3", "")
    rows["loosened section"] = ("disturbance.area_m2", "disturbance.area_half_width_m2")
    found = flattened(summary.document())
    return [
        Result(words, found[path], found.get(width), unit_of_path(path))
        for words, (path, width) in rows.items()
        if found.get(path) is not None
    ]


def write_results_csv(results: Iterable[Result], path: Path) -> None:
    """One line for each result, numbers with all their digits."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(RESULT_HEADINGS)
        writer.writerows(astuple(result) for result in results)


def heading_rows(summary: Summary, resolved: ResolvedScene) -> list[tuple[str, str]]:
    """Soil, depth and mean speed of the first tillage tool, and radius of the particles."""
    scene, particles = resolved.scene, resolved.scene.particle_soil
    rows = [] if scene.soil is None else [("soil", summary.run.soil or _soil_words(scene))]
    tool = next((name for name, item in scene.tools.items() if item.is_tillage), None)
    if tool is not None:
        deep, mesh = summary.loads.tip_depth_m, load_tool_mesh(resolved.directory, scene, tool)
        rows.append(("depth", f"{_mm(deep.mean if deep else speed_and_depth(scene, tool, mesh)[1])} mm"))
        speed = summary.series[PlanarTool(tool).velocity_x_m_per_s].mean
        rows.append(("speed", f"{_text(speed, '.3g')} m/s"))
    if particles is not None:
        rows.append(("particle radius", particles.particles.radius_words()))
    if resolved.preset is not None:
        rows.append(("preset", resolved.preset))
    return rows


def _soil_words(scene: Scene) -> str:
    """A soil without a name."""
    if scene.wedge_soil is not None:
        file = scene.wedge_soil.file
        return "wedge model" if file is None else f"wedge model {Path(file).stem}"
    if scene.terrain_soil is not None:
        return "terrain"
    if scene.particle_soil is None:
        return "of another program"
    soil = scene.particle_soil
    return f"{soil.law.kind}, particles of {soil.particles.density_kg_per_m3:g} kg/m3"


def _rounded(value: float | None) -> str:
    """Four digits or more."""
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 1e3 else f"{value:.4g}"


UNSEEN_DRIFT = 0.1
"""Half-width of a trend, as a part of the mean, above which it is said that a drift may hide in it."""

HEADINGS = ("quantity", "unit", "ours", "reference", "band", "difference", "agrees", "source")
RESULT_HEADINGS = ("quantity", "value", "half_width", "unit")
WORDS = ("quantity", "unit", "agrees", "source")
"""Headings of columns that hold no numbers."""


@dataclass(frozen=True)
class ReferenceRow:
    """One quantity of a reference and of a run."""

    quantity: str  # dotted path in summary.json
    ours: float | None  # None: the run has no such quantity
    given: ReferenceValue

    @property
    def difference(self) -> float | None:
        """Ours less the reference's value, over that value; None where one is missing or the value is 0."""
        if self.ours is None or not self.given.value:
            return None
        return (self.ours - self.given.value) / abs(self.given.value)

    @property
    def agrees(self) -> str:
        """`yes`, `below` or `above` the band; `` without a band or a value of ours."""
        if self.ours is None or self.given.band is None:
            return ""
        low, high = self.given.band
        return "below" if self.ours < low else "above" if self.ours > high else "yes"

    def cells(self) -> list[str]:
        """Texts of the row, in the order of HEADINGS."""
        band = "" if self.given.band is None else " to ".join(f"{value:.4g}" for value in self.given.band)
        difference = "" if self.difference is None else f"{100.0 * self.difference:+.0f} %"
        return [
            self.quantity, self.given.unit, _number(self.ours), _number(self.given.value), band, difference,
            self.agrees, self.given.source,
        ]  # fmt: skip


def reference_rows(reference: Reference, summary: Document) -> list[ReferenceRow]:
    """A row for each value of the reference; summary: as summary.json holds it."""

    found = flattened(summary)

    def ours(quantity: str) -> float | None:
        value = found.get(quantity)
        return float(value) if isinstance(value, int | float) else None

    return [ReferenceRow(quantity, ours(quantity), given) for quantity, given in reference.values.items()]


def reference_lines(reference: Reference, summary: Document) -> list[str]:
    """The notes of a reference, and which of its quantities the run lacks."""
    lines = list(reference.notes)
    for row in reference_rows(reference, summary):
        if row.ours is None:
            near = difflib.get_close_matches(row.quantity, flattened(summary), n=1, cutoff=0.8)
            lines.append(f"this run has no {row.quantity}" + (f"; the nearest is {near[0]}" if near else ""))
    return lines


def write_reference_csv(rows: list[ReferenceRow], path: Path) -> None:
    """One line for each row, numbers with all their digits."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(
            ("quantity", "unit", "ours", "value", "low", "high", "difference", "agrees", "source")
        )
        for row in rows:
            given, (low, high) = row.given, row.given.band or (None, None)
            writer.writerow(
                (row.quantity, given.unit, row.ours, given.value, low, high, row.difference, row.agrees,
                 given.source)
            )  # fmt: skip


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _text(value: Number, digits: str, factor: float = 1.0) -> str:
    """A number times `factor`, formatted; one that is not finite is unknown."""
    return "unknown" if value is None else format(factor * value, digits)


def _mm(value_m: Number) -> str:
    return _text(value_m, ".0f", 1e3)


def summary_facts(summary: Summary) -> list[str]:
    """Notes on a run, line by line; a warning begins with WARNING or NOTE."""
    window, run, energy, particles = summary.window, summary.run, summary.energy, summary.particles
    if window.whole_run:
        span = f"the whole run, because no row of it lies in the window ({window.rule})"
    else:
        span = f"{window.start_s:.4g} to {window.end_s:.4g} s ({window.rule})"
    whole = f" ({run.whole_wall_s:.1f} s with start-up)" if run.whole_wall_s is not None else ""
    count = f"{particles.count} particles" if particles.count else "no particles"
    lines = [
        f"{'WARNING: ' if window.whole_run else ''}mean, min, max, range: {span}; run min, run max: "
        "everything recorded",
        f"{count}, {run.steps} steps, {run.wall_s:.1f} s wall time{whole}, real-time factor "
        f"{run.real_time_factor:.3g}",
        f"interface energy residual {_text(energy.residual_joule, '.3g')} J, "
        f"{_text(energy.residual_ratio, '.3g', 100.0)} % of the work done there",
    ]
    lines += _mechanism_lines(summary)
    lines += _load_lines(summary)
    if particles.lost_count:
        named = "; ".join(
            f"particle {lost.identity} at ({', '.join(f'{x:.3f}' for x in lost.position_m)}) m, "
            f"{lost.time_s:.4g} s"
            for lost in particles.first_lost
        )
        lines.append(
            f"WARNING: {particles.lost_count} particles left the domain, the first before "
            f"{particles.first_lost_s:.4g} s{f': {named}' if named else ''}"
        )
    if run.resumed_from is not None:
        lines.append(f"went on from {run.resumed_from.checkpoint}, whose record is in these numbers")
    if run.checkpoint is not None:
        newest = run.checkpoint
        lines.append(
            f"newest checkpoint: {newest.path}, at {newest.time_s:.6g} s, "
            f"{newest.size_bytes / 1e6:.3g} MB, written in {newest.write_s:.2g} s"
        )
    if run.stop_when is not None:
        lines.append(_stop_words(run.stop_when))
    if not run.complete:
        lines.append("The run ended before its last tick.")
    if summary.scene.allow:
        lines.append(f"WARNING: the scene overrides refusals, allow: {', '.join(summary.scene.allow)}")
    if summary.scene.note:
        lines.append(f"NOTE: {summary.scene.note}")
    return lines


def mean_words(found: KnownMean) -> str:
    """What a check of stop_when found, in a few words."""
    mean, half_width = found.mean, found.half_width
    if mean is None or half_width is None:
        return f"{found.metric}: {found.verdict}"
    interval = f"+- {100.0 * half_width / abs(mean):.3g} %" if mean else f"+- {half_width:.4g}"
    return f"{found.metric} {mean:.5g} {interval}, {found.verdict}"


def _stop_words(found: KnownMean) -> str:
    """Whether a run with stop_when has reached it, as a line."""
    wanted = f"{100.0 * found.relative_interval:g} % at a confidence of {found.confidence:g}"
    word = "reached" if found.reached else "WARNING: not reached"
    return (
        f"stop_when: {word} after {found.travel_m:.4g} m of travel: {mean_words(found)}; asked for are "
        f"{wanted} and no drift seen"
    )


def _mechanism_lines(summary: Summary) -> list[str]:
    """Residual of the machine's energy balance, and the number of parts of steps."""
    residual = summary.series.get(MECHANISM.energy_residual_joule)
    if residual is None or residual.run.min is None or residual.run.max is None:
        return []
    largest = max(abs(residual.run.min), abs(residual.run.max))
    count = summary.series[MECHANISM.part_count].run.max
    parts = f"; {count} parts of steps, for mechanism.tolerance" if count else ""
    return [f"mechanism: balance of energy open by {largest:.3g} J at most{parts}"]


def _load_lines(summary: Summary) -> list[str]:
    """Lines of the quantities that the run has."""
    lines = (
        *_extrapolated(summary),
        _folded(summary),
        _stationarity(summary),
        _vertical(summary),
        _power(summary),
        _dominant_frequency(summary),
        _failures(summary),
        _spring(summary),
        _disturbance(summary),
    )
    return [line for line in lines if line]


def _extrapolated(summary: Summary) -> list[str]:
    """Warnings of tools outside the range in which their wedge model was fitted."""
    return [
        f"WARNING: {words(tool, key, item.model_dump())}"
        for tool, items in (summary.loads.extrapolated or {}).items()
        for key, item in items.items()
    ]


def _folded(summary: Summary) -> str:
    """Warning that the soil folded the shank back, with the time; empty where it did not."""
    passed = summary.loads.past_dead_centre_s
    if passed is None:
        return ""
    return (
        f"WARNING: the soil folded the shank back: at {passed:.3f} s it passed the dead centre of its "
        "spring, and what follows is not the draft of a working tool"
    )


def _stationarity(summary: Summary) -> str:
    draft = summary.series.get(DRAFT)
    if draft is None:
        return ""
    steady = draft.stationarity
    if steady is None:
        return f"WARNING: draft: {_text(draft.mean, '.0f')} N; the window is too short for an interval"
    warning = "" if steady.verdict == "no drift seen" else "WARNING: "
    words = f"{warning}draft: {_text(draft.mean, '.0f')}"
    if steady.mean_half_width is not None:
        words += f" +- {steady.mean_half_width:.0f}"
    words += f" N (95 %, {_text(steady.effective_count, '.0f')} independent samples)"
    drift, half = steady.drift, steady.drift_half_width
    if drift is not None and half is not None:
        words += f", trend over the window {100.0 * drift:+.1f} +- {100.0 * half:.1f} %"
    words += f": {steady.verdict}"
    if not warning and half is not None and half > UNSEEN_DRIFT:
        words += f" (one of less than {100.0 * half:.0f} % would not show; a longer run shows it)"
    return words


def _vertical(summary: Summary) -> str:
    vertical, depth = summary.loads.vertical, summary.loads.tip_depth_m
    if vertical.weight_newton is None:
        return ""
    carried = {label: getattr(vertical, f"{key}_newton") for key, label in _CARRIERS.items()}
    parts = [f"{label} {_text(found.mean, '.0f')} N" for label, found in carried.items() if found is not None]
    words = (
        f"weight {vertical.weight_newton:.0f} N is carried by {', '.join(parts)}, rest "
        f"{_text(vertical.rest_newton, '.0f')} N (up is positive)"
    )
    if vertical.wheels_newton is not None:
        words += f"; least on the wheels {_text(vertical.wheels_newton.min, '.0f')} N"
    if depth is not None:
        words += f"; tip {_mm(depth.mean)} mm deep"
    return words


def _power(summary: Summary) -> str:
    draft, specific = summary.loads.power.get("draft_watt"), summary.loads.specific
    if draft is None:
        return ""
    words = f"power {_text(draft.mean, '.0f')} W"
    if specific.energy_joule_per_m is not None:
        words += f", {specific.energy_joule_per_m:.0f} J/m"
    if specific.energy_joule_per_m3 is not None:
        words += f", {1e-3 * specific.energy_joule_per_m3:.1f} kJ per cubic metre loosened"
    if specific.draft_newton_per_m is not None:
        words += f"; draft {1e-3 * specific.draft_newton_per_m:.1f} kN per metre of share"
    if specific.draft_pa is not None:
        words += f", {1e-3 * specific.draft_pa:.1f} kPa of loosened section"
    return words


def _dominant_frequency(summary: Summary) -> str:
    draft = summary.series.get(DRAFT)
    if draft is None or draft.spectrum is None:
        return ""
    found = draft.spectrum
    stands = "stands out of" if found.significant else "does not stand out of"
    return (
        f"draft is strongest at {_text(found.dominant_hz, '.2f')} Hz (resolved to "
        f"{_text(found.resolution_hz, '.2f')} Hz), which {stands} red noise (95 %)"
    )


def significance_words(found: Spectrum) -> str:
    """Significance of the dominant frequency of a spectrum."""
    if found.significant:
        return "stands out of red noise"
    if found.dominant == SLOWEST:
        return "is the slowest looked at: no dominant frequency seen"
    return "does not stand out of red noise"


def _failures(summary: Summary) -> str:
    found = summary.failure_cycles
    if found is None:
        return ""
    travel, time = found.travel_m, found.time_s
    words = (
        f"soil fails every {_mm(travel.mean)} +- {_mm(travel.half_width)} mm of "
        f"travel (deviation {_mm(travel.deviation)} mm), every {_text(time.mean, '.2f')} s "
        f"(deviation {_text(time.deviation, '.2f')} s): {found.count} cycles between peaks of the draft that "
        f"stand out by {_text(found.threshold_newton, '.0f')} N, one standard deviation; the draft rises in "
        f"{_text(found.loading_fraction, '.2f')} of the time"
    )
    if found.unloading_over_loading is not None:
        words += f" and falls {found.unloading_over_loading:.2f} times as fast as it rises"
    return words


def _spring(summary: Summary) -> str:
    found = summary.loads.rainflow
    if found is None:
        return ""
    return (
        f"spring: {_text(found.cycle_count, 'g')} load cycles, the largest of "
        f"{_text(found.max_range_newton, '.0f')} N; as harmful as "
        f"{_text(found.equivalent_range_newton, '.0f')} N once a second"
    )


def _disturbance(summary: Summary) -> str:
    found = summary.disturbance
    if found is None:
        return ""
    half = found.area_half_width_m2
    interval = "" if half is None else f" +- {1e4 * half:.0f}"
    return (
        f"soil: {_text(found.area_m2, '.0f', 1e4)}{interval} cm2 loosened "
        f"({_text(found.moved_fraction, '.1f', 100.0)} % of the bed moved by more than a radius), "
        f"{_mm(found.surface_width_m)} mm wide at the surface, "
        f"whose highest particle, perhaps on the tool, rose by {_mm(found.lift_max_m)} mm"
    )
