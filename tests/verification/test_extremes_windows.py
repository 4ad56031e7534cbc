"""Windows at the extremes: the quick cases of validation/extremes.md end as it says."""

from pathlib import Path

import pytest

from validation import windows
from validation.cases import Case

CASES = [case for case in windows.CASES if not case.long]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.key} {case.title}")
def test_the_case_ends_as_it_must(case: Case, tmp_path: Path) -> None:
    """A right answer, a refusal or a stop with a named cause; each case checks its own figures."""
    case.run(tmp_path)
