"""What verbs print and write: tables, lines on standard error, files."""

import sys
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console
from rich.table import Column, Table

from ..errors import InputError


def say(line: str) -> None:
    """Print one line on standard error."""
    print(line, file=sys.stderr, flush=True)


def stdout_console(width: int = 140, *, highlight: bool = False) -> Console:
    """Standard output, as wide as the terminal, or `width` where it is none."""
    return Console(width=None if sys.stdout.isatty() else width, highlight=highlight)


def print_line(console: Console, text: str) -> None:
    """Print text as it is, not broken into lines."""
    console.print(text, soft_wrap=True, markup=False)


def table(title: str, headings: Iterable[str] = (), words: int = 1) -> Table:
    """Return a table without lines, to which rows are added.

    headings: of its columns; without any it has rows alone. words: how many of its first columns hold words,
    which stand to the left; the others hold numbers.
    """
    columns = [
        Column(text, justify="left" if k < words else "right", overflow="fold")
        for k, text in enumerate(headings)
    ]
    return Table(
        *columns, title=title, title_justify="left", title_style="bold", show_header=bool(columns), box=None
    )


def write_out(text: str, out: Path | None) -> None:
    """Write the output of a verb to the file of its `--out`, or to standard output.

    Raises:
        InputError: the file cannot be written.
    """
    if out is None:
        sys.stdout.write(text)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be written ({error.strerror}); name a file that can"
        ) from error
    print(f"written to {out}")
