"""Tables that the verbs print."""

from collections.abc import Iterable

from rich.table import Column, Table


def table(title: str, headings: Iterable[str] = (), words: int = 1) -> Table:
    """Return a table without lines, to which rows are added.

    headings: of its columns; without any it has rows alone. words: how many of its first columns hold words,
    which stand to the left; the others hold numbers.
    """
    columns = [Column(text, justify="left" if k < words else "right") for k, text in enumerate(headings)]
    return Table(
        *columns, title=title, title_justify="left", title_style="bold", show_header=bool(columns), box=None
    )
