"""Soil at the extremes: the quick cases of validation/extremes.md end as it says."""

from pathlib import Path

import pytest

from validation import beds, laws, plastic_and_bonded, steps, tools
from validation.cases import Case

CASES = [
    case for part in (steps, laws, tools, beds, plastic_and_bonded) for case in part.CASES if not case.long
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.key} {case.title}")
def test_the_case_ends_as_it_must(case: Case, tmp_path: Path) -> None:
    """A right answer, a refusal or a stop with a named cause; each case checks its own figures."""
    case.run(tmp_path)
