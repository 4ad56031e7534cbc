"""Pages name only files, folders and modules that are there."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.test_documentation import PAGES

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "subsoil_ros"
MADE = {"build", "install", "log", "runs", "site"}
"""Folders of the repository that hold what is made."""

QUOTED = re.compile(r"`([\w./-]+)`|(?<![\w/.-])(\w[\w./-]*/[\w-]+\.py)\b(?! \(new\))")
"""Words in backticks, and paths of Python files wherever they stand, but not those that a reader makes."""

PLACEHOLDER = re.compile(r"\b[A-Z]{3,}\b")
MODULE = re.compile(r"(?:^:::|<!-- design:) (subsoil_ros(?:\.\w+)+)", re.MULTILINE)


def paths_named(text: str) -> Iterator[str]:
    """Words that are paths of the repository or of the package."""
    for quoted, written in QUOTED.findall(text):
        word = quoted or written
        first, slash, _ = word.partition("/")
        placeholder = PLACEHOLDER.search(word) and not word.endswith(".md")
        in_folder = slash and first and ((PACKAGE / first).is_dir() or (ROOT / first).is_dir())
        if not placeholder and first not in MADE and (in_folder or quoted.endswith(".py")):
            yield word


def is_there(word: str, page: Path) -> bool:
    """Seen from the repository, the package or the page; a name without a folder may be anywhere in them."""
    if any((folder / word).exists() for folder in (ROOT, PACKAGE, page.parent)):
        return True
    return "/" not in word and any(
        path.name == word
        for folder in ("subsoil_ros", "tests", "dev", "examples", "validation", "benchmarks", "reproduction")
        for path in (ROOT / folder).rglob("*.py")
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_named_files_exist(page: Path) -> None:
    """A file that was moved or renamed takes its name in the pages along."""
    assert [word for word in paths_named(page.read_text()) if not is_there(word, page)] == []


def test_paths_are_told_from_other_words() -> None:
    """Topics, keys, patterns and results of runs are no paths; a file that is not there is one."""
    text = "`soil/points` `runs/first/bag` `config/presets/MATERIAL.yaml` `and/or` `dem/nowhere.py` `gone.py`"
    assert list(paths_named(text)) == ["dem/nowhere.py", "gone.py"]
    assert not any(is_there(word, ROOT / "README.md") for word in paths_named(text))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_named_modules_exist(page: Path) -> None:
    """Modules whose interface or whose design a page shows; what follows a module is a name in it."""
    for dotted in MODULE.findall(page.read_text()):
        parts = dotted.split(".")
        module = next(
            (n for n in range(len(parts), 1, -1) if (ROOT / Path(*parts[:n])).with_suffix(".py").is_file()), 0
        )
        source = (ROOT / Path(*parts[:module])).with_suffix(".py") if module else PACKAGE / "__init__.py"
        assert all(name in source.read_text() for name in parts[module or 1 :]), dotted
