"""A comparison of tools as one self-contained web page: verdict, warnings, table and curves."""

import base64
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from .._version import __version__
from .plotting import page_template


def write_page(
    path: Path,
    labels: Sequence[str],
    verdicts: Sequence[str],
    warnings: Sequence[str],
    table: tuple[list[str], list[list[str]]] | None,
    meaning: str,
    curves: Path,
    tops: Sequence[Sequence[tuple[str, str]]] = (),
) -> None:
    """Write the page. table: headings and rows; meaning: of +- in it; curves: a picture, which goes inside;
    tops: of each run, what it was made with, as run_results.heading_rows.

    Raises:
        OSError: it cannot be written.
    """
    headings, rows = table or ([], [])
    words = [dict(top) for top in tops]
    made = {name: [top.get(name, "") for top in words] for name in dict.fromkeys(chain(*words))}
    text = page_template("comparison.html.jinja").render(
        title=" against ".join([*labels[1:], labels[0]]),
        labels=labels,
        made=made,
        verdicts=verdicts,
        warnings=warnings,
        headings=headings,
        rows=rows,
        meaning=meaning,
        curves=base64.b64encode(curves.read_bytes()).decode("ascii"),
        version=__version__,
    )
    path.write_text(text, encoding="utf-8")
