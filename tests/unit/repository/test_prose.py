"""Words that pages, docstrings, comments and messages avoid, and how long the guide may be."""

import re
from pathlib import Path

from dev.reference import BLOCK
from tests.system.test_documentation import PAGES

ROOT = Path(__file__).parents[3]
FOLDERS = ("subsoil_ros", "benchmarks", "dev", "examples", "reproduction", "tests", "validation")
SOURCES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
SCENES = sorted((ROOT / "config").rglob("*.yaml"))
AVOIDED = re.compile(
    "|".join(
        r"\b" + words.replace(" ", r"\s+")
        for words in (
            "(?:no|some|every)body", "for who has", "text is no number", "is taken no notice",
            "passes for a result", "cannot be told by", "turn round from", "a wish that comes",
        )
    ),
    re.IGNORECASE,
)  # fmt: skip
"""Turns of phrase that readers have to read twice."""

MOST_WORDS = 20_000


def avoided(text: str) -> list[str]:
    return [match[0] for match in AVOIDED.finditer(text)]


def test_plain_words():
    """No page, source or scene has one of the turns of phrase that are avoided."""
    paths = [path for path in (*PAGES, *SOURCES, *SCENES) if path != Path(__file__)]
    found = {str(path.relative_to(ROOT)): avoided(path.read_text()) for path in paths}
    assert {path: words for path, words in found.items() if words} == {}


def test_plain_words_are_told_from_others():
    assert avoided("Nobody knows what passes\nfor a result.") == ["Nobody", "passes\nfor a result"]
    assert avoided("No body touches the soil; a rigid body does.") == []


def prose(text: str) -> str:
    """A page without what is generated, code, formulas, targets of links and the bars of tables."""
    text = BLOCK.sub("", text)
    text = re.sub(r"(?ms)^ *```.*?^ *```$|\$\$.*?\$\$|<!--.*?-->", "", text)
    return re.sub(r"\]\([^)]*\)|\|", " ", re.sub(r"\$[^$\n]+\$", "x", text))


def test_length_of_the_guide():
    """The pages of docs/, without decisions and what they include, can be read in an afternoon."""
    pages = [prose(page.read_text()) for page in (ROOT / "docs").glob("*.md")]
    assert sum(len(re.findall(r"\S*\w\S*", page)) for page in pages) <= MOST_WORDS
    assert prose("Pull $F$ on | [a](x.md).\n```bash\nls\n```\n").split() == ["Pull", "x", "on", "[a", "."]


def test_quoted_messages_exist():
    """Each message that the page of troubles quotes is one of the package."""
    joined = re.compile(r'"\s*\n\s*f?"')
    package = "".join(joined.sub("", path.read_text()) for path in SOURCES if "subsoil_ros" in path.parts)
    rows = re.findall(r"^\| (`[^|]*`) \|", (ROOT / "docs/troubleshooting.md").read_text(), re.MULTILINE)
    quoted = [words for row in rows for words in re.findall(r"`([^`]+)`", row)]
    assert len(quoted) > 10
    assert [words for words in quoted if words not in package] == []
