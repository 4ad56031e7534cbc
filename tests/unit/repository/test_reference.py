"""The generated parts of docs/ are those of the sources."""

from dev.reference import GENERATED, written_anew


def test_pages_are_current() -> None:
    """`python -m dev.reference` writes them anew."""
    pages = written_anew()
    stale = [page.name for page, text in pages.items() if page.read_text(encoding="utf-8") != text]
    assert not stale
    assert sum(text.count("<!-- generated: ") for text in pages.values()) == len(GENERATED)
