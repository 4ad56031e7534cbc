"""Tables and figure of REPORT.md, from kept runs in seconds: `python -m validation.measured all`."""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from . import blade_points, plate_points
from .plate_points import Point

HERE = Path(__file__).parent
BEGIN, END = "<!-- results -->\n", "<!-- end of results -->\n"
BAND = 0.30


def points() -> list[Point]:
    """Of all sets with bands."""
    return [
        *blade_points.points(),
        *plate_points.pavlov(),
        *plate_points.kruger(),
        *plate_points.li(),
    ]


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3g}"


def errors(found: Sequence[Point]) -> Iterator[str]:
    """One row a set: points, points that agree, mean absolute errors of particles and closed forms."""
    yield "| set | judged | agree | particles | closed forms |"
    yield "|---|---|---|---|---|"
    for name, group in itertools.groupby(found, lambda point: point.set):
        own = list(group)
        judged = [point for point in own if point.agrees is not None]
        same = [point for point in own if point.forms and not math.isnan(point.predicted)]
        words = [
            f"{form} {_mean_off([(p.forms[form], p.measured) for p in same])}"
            for form in (same[0].forms if same else ())
        ]
        off = _mean_off([(p.predicted, p.measured) for p in same or own if not math.isnan(p.predicted)])
        agree = sum(bool(point.agrees) for point in judged)
        yield f"| {name} | {len(judged)} | {agree} | {off} | {', '.join(words) or 'none'} |"


def _mean_off(pairs: Iterable[tuple[float, float]]) -> str:
    off = [abs(found / measured - 1.0) for found, measured in pairs]
    return f"{np.mean(off):.1%}" if off else "-"


def rows(found: Sequence[Point]) -> Iterator[str]:
    """One row a point."""
    yield "| set | what | measured | particles | over measured | agrees | closed forms over measured |"
    yield "|---|---|---|---|---|---|---|"
    for point in found:
        words = [f"{name} {value / point.measured:.2f}" for name, value in point.forms.items()]
        verdict = {None: "reported", True: "yes", False: "no"}[point.agrees]
        yield (
            f"| {point.set} | {point.what} | {_number(point.measured)} | {_number(point.predicted)} "
            f"| {_number(point.predicted / point.measured)} | {verdict} | {', '.join(words) or 'none'} |"
        )


def tables() -> str:
    """The part of REPORT.md between BEGIN and END."""
    found = points()
    both = plate_points.pavlov("critical_29")
    lines = [
        *errors(found),
        "",
        *blade_points.verdict(),
        "",
        *rows(found),
        "",
        "Growth with the size of particles, b of $p_0 (1 + b\\, r/D)$, plate of 80 mm: "
        f"{_number(plate_points.grain_of_discs())}. Shift of the depth between particles of 6 and of 2.5 mm "
        "at sinkages of 10, 15 and 20 mm: "
        + ", ".join(_number(1e3 * plate_points.effective_depth_m(at)) for at in (0.010, 0.015, 0.020))
        + " mm; the difference of their diameters is 7 mm.",
        "",
        "Round plates, if the angle of repose is that of the critical state (`critical_29`), over measured: "
        + ", ".join(f"{point.what} {_number(point.predicted / point.measured)}" for point in both)
        + ".",
        "",
        "| changed, of the round plates in `repose_29` | plate | kPa at 10 mm, times | at 20 mm, times |",
        "|---|---|---|---|",
        *(
            f"| {changed} | {1e3 * diameter:g} mm | {first:.2f} | {second:.2f} |"
            for changed, diameter, (first, second) in plate_points.one_at_a_time()
        ),
        "",
        "| shipped soil | 200 mm plate at 50 mm, kPa | soils of half to twice its cohesion, kPa |",
        "|---|---|---|",
        *(
            f"| `{soil}` | {_number(kpa)} | {low:.0f} to {high:.0f} |"
            for soil, kpa, low, high in plate_points.wong()
        ),
    ]
    return "\n".join(lines) + "\n"


def draw(found: Sequence[Point], path: Path) -> None:
    """Predicted over measured, each in its own unit (N, kPa, kPa/cm, percent of the level plate's stress)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5, 6.0), layout="constrained")
    axes = figure.add_subplot()
    ends = np.array((1.0, 4000.0))
    axes.plot(ends, ends, color="0.3", linewidth=1.0)
    axes.fill_between(ends, ends * (1.0 - BAND), ends * (1.0 + BAND), color="0.9", label="within 30 %")
    for number, (name, group) in enumerate(itertools.groupby(found, lambda point: point.set)):
        scale = 100.0 if name == "Li et al." else 1.0
        own = [point for point in group if not math.isnan(point.predicted)]
        x = [scale * abs(point.measured) for point in own]
        axes.plot(x, [scale * abs(p.predicted) for p in own], "o", color=f"C{number}", label=name)
        forms = [(p.measured, value) for p in own for value in p.forms.values()]
        if forms:
            axes.plot(*zip(*forms, strict=True), "x", color=f"C{number}", alpha=0.5, markersize=5)
    axes.set(xscale="log", yscale="log", xlim=ends, ylim=ends, xlabel="measured", ylabel="predicted")
    axes.legend(title="particles; crosses: closed forms", fontsize="small")
    figure.savefig(path, dpi=110, metadata={"Software": None})


def write() -> None:
    """The tables into REPORT.md, and its figure."""
    page = HERE / "REPORT.md"
    text = page.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    page.write_text(f"{before}{BEGIN}\n{tables()}\n{END}{after}", encoding="utf-8")
    draw(points(), HERE / "measured.png")
