"""dev.mutants changes one line at a time, in code that a test can tell apart."""

from pathlib import Path

import pytest

from dev import mutants
from dev.mutants import Mutant, candidates, changed

TEXT = """\
@inner_kernel
def force(x: float | None, n):
    return 2 * x


def check(x, n):
    if not x < 1.5:
        raise ValueError(f"{x} is not {n + 1}")
    note(x)
    return x and n
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module of a repository."""
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    (tmp_path / "module.py").write_text(TEXT)
    return tmp_path / "module.py"


def test_each_place_that_can_change_gives_a_mutant(file):
    """Operators, constants, conditions and calls; no words of an error. Lines of a kernel are marked."""
    found = {(one.line, one.new, one.kernel) for one in candidates(file)}
    assert found == {
        (3, "return 3 * x", True),
        (7, "if x < 1.5:", False), (7, "if not x <= 1.5:", False),
        (7, "if not x < 1.6500000000000001:", False),
        (7, "if not (not x < 1.5):", False), (9, "pass", False), (10, "return x or n", False),
    }  # fmt: skip


def test_a_mutant_finds_its_line_after_others_moved(file):
    """The nearest line of that text changes, with its indentation; a line that is gone is an error."""
    file.write_text("# a line more\n" + TEXT)
    lines = changed(file.parent, Mutant("module.py", 9, "note(x)", "pass", False)).splitlines()
    assert lines == ["# a line more", *TEXT.replace("note(x)", "pass").splitlines()]
    with pytest.raises(ValueError, match="no line"):
        changed(file.parent, Mutant("module.py", 9, "tell(x)", "pass", False))
