"""The verdict between tools in words, with the table it rests on and what must be known to believe it."""

import math
from collections.abc import Iterator, Sequence

from ..analysis.columns import DRAFT
from ..analysis.intervals import NO_SCATTER, Interval, t_quantile
from ..figures.comparison import Difference
from ..yaml_document import Document
from .run_cache import CachedRun
from .tool_comparison import QUANTITIES, Side

RESOLVED = 0.03
"""Part of the first mean that a verdict is asked to resolve: less decides no choice between two tools."""

MOST_FIELDS = 1000
"""Most fields that a verdict proposes."""


def quantity_rows(found: Sequence[Difference], labels: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the printed table of quantities."""
    headings = ["quantity", *labels]
    for label in labels[1:]:
        headings += [f"{label} - {labels[0]}", "in %"]
    rows = []
    for item in found:
        words, factor = QUANTITIES[item.column]
        row = [words, *(_number(factor * value) for value in item.values)]
        for place in range(1, len(labels)):
            difference, part = item.against_first(place)
            row.append(Interval(difference, item.half_widths[place], 0).scaled(factor).text("+.4g"))
            row.append(Interval(part, item.part_half_widths[place], 0).scaled(100.0).text("+.1f"))
        rows.append(row)
    return headings, rows


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g}"


def meaning(fields: int, alike: Sequence[str] = ()) -> str:
    """What +- in the table means, and what was given to all sides."""
    told = (
        f"+-: 95 % interval of the mean difference over {fields} fields, Student's t on equal seeds"
        if fields > 1
        else "+-: 95 % interval of the difference within these runs, from the scatter along them. One field "
        "is one sample of the soil, and what another would change is not in it: scenes with --seeds 3 tell"
    )
    given = f". All have the finest particles and the largest field of any of them: {', '.join(alike)}"
    return told + given if alike else told


def cautions(sides: Sequence[Side]) -> Iterator[str]:
    """What a reader must know of the runs before the table is believed."""
    soils = [_soil(side.first) for side in sides]
    if len(sides[0].runs) == 2:
        yield "two fields: their interval is 12.7 times its standard error, that of three 4.3: --seeds 3"
    if {side.first.scene.get("preset") for side in sides} & {"standard", "coarse"}:
        yield (
            "drafts of the presets standard and coarse err by up to 15 %, vertical forces by up to 9 % of "
            "the draft, otherwise for each tool and soil: smaller differences may be theirs"
        )
    if any(soil.get("model") == "wedge" for soil in soils):
        yield (
            "drafts of a wedge model err by up to 7 % in loam and 16 % in bonded loam, otherwise for each "
            "rake, depth and speed: smaller differences may be its own; confirm them with --preset standard"
        )
    for side, soil in zip(sides, soils, strict=True):
        yield from _cautions_of(side)
        unlike = [f"soil.{key}" for key in sorted({*soil, *soils[0]}) if soil.get(key) != soils[0].get(key)]
        if unlike:
            yield (
                f"{side.label} and {sides[0].label} differ in {', '.join(unlike)}: part of the difference "
                "may be theirs; --set gives both scenes the same, as soil.particles.radius_m=0.012"
            )


def _soil(run: CachedRun) -> Document:
    """The soil of a run, without its window, on which little depends."""
    return {key: value for key, value in (run.scene.get("soil") or {}).items() if key != "window"}


def _cautions_of(side: Side) -> Iterator[str]:
    summaries = [run.summary for run in side.runs.values()]
    judged = [item.get("series", {}).get(DRAFT, {}).get("stationarity") or {} for item in summaries]
    drifts = [item["drift"] or math.inf for item in judged if item.get("verdict") == "drifts"]
    most = max(drifts, key=abs, default=0.0)
    for words, places in (
        (
            "no row lies in its metrics window, so its mean, min and max are of the whole run (the rule of "
            "the window: its summary.json)",
            sum(item["window"].get("whole_run") is True for item in summaries),
        ),
        (
            "left the range in which its wedge model was fitted (loads.extrapolated in its summary.json)",
            sum(bool(item.get("loads", {}).get("extrapolated")) for item in summaries),
        ),
        ("ended before its last tick", sum(item["run"].get("complete") is False for item in summaries)),
        (
            f"its draft drifts, by {100.0 * most:+.0f} % over the window: a longer run has another mean",
            len(drifts),
        ),
        (
            "too short to see whether its draft drifts",
            sum(item.get("verdict", "too short") == "too short" for item in judged),
        ),
    ):
        if places:
            where = f" ({places} of {len(summaries)} fields)" if len(summaries) > 1 else ""
            yield f"{side.label}: {words}{where}"


def verdicts(found: Sequence[Difference], labels: Sequence[str], fields: int = 1) -> Iterator[str]:
    """What the intervals of the draft's means say about each further source, in words."""
    item = next((item for item in found if item.column == DRAFT and item.part_half_widths), None)
    for place in range(1, len(labels) if item is not None else 0):
        assert item is not None
        part, half = item.against_first(place)[1], item.part_half_widths[place]
        who, first = labels[place], labels[0]
        shown = "shown" if fields > 1 else "shown in this field"
        if math.isnan(part) or math.isnan(half) or half < NO_SCATTER:
            yield (
                f"{who} against {first}: no verdict, as no interval is known: the runs are too short, or "
                "nothing scatters in them; use longer runs, or scenes and --seeds 3"
            )
            continue
        low, high = 100.0 * (abs(part) - half), 100.0 * (abs(part) + half)
        if low > 0.0:
            word = "less" if part < 0.0 else "more"
            told = f"{who} needs {low:.1f} to {high:.1f} % {word} draft than {first}: {shown}"
        elif half <= RESOLVED:
            told = f"{who} and {first} need the same draft to {high:.1f} %: {shown}"
        else:
            ends = f"{100.0 * (part - half):+.1f} to {100.0 * (part + half):+.1f} % of draft"
            told = f"{who} against {first}: not resolved, {ends}; {_enough(half, fields)} would resolve "
            told += f"a difference of {100.0 * RESOLVED:.0f} %"
        sample = "another soil.bed.seed is another field"
        yield f"{told} (95 %, {f'over {fields} fields' if fields > 1 else sample})"


def _enough(half: float, fields: int) -> str:
    """How much more would narrow a half-width to RESOLVED: longer runs of one field, or more fields."""
    if fields == 1:
        return f"runs {(half / RESOLVED) ** 2:.1f} times as long"
    scatter = half * math.sqrt(fields) / t_quantile(fields - 1)
    more = range(fields + 1, MOST_FIELDS + 1)
    count = next((n for n in more if t_quantile(n - 1) * scatter / math.sqrt(n) <= RESOLVED), None)
    return f"more than {MOST_FIELDS} fields" if count is None else f"some {count} fields in all"
