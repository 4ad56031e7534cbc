"""`subsoil compare`: the verdict between two runs in words."""

import math

import pytest

from subsoil_ros.cli.compare import verdicts
from subsoil_ros.figures.comparison import Difference


@pytest.mark.parametrize(
    ("ratio", "half", "words"),
    [
        (0.915, 0.025, "b needs 6.0 to 11.0 % less draft than a: shown"),
        (1.10, 0.02, "b needs 8.0 to 12.0 % more draft than a: shown"),
        (1.00, 0.02, "b and a need the same draft to 2.0 %: shown"),
        (
            0.98,
            0.06,
            "b against a: not resolved, -8.0 to +4.0 % of draft; runs 4.0 times as long would resolve 3 %",
        ),
    ],
)  # fmt: skip
def test_the_verdict_follows_the_interval(ratio: float, half: float, words: str) -> None:
    """Of the difference of the means over shared times, as a part of the first."""
    found = [
        Difference("draft_newton", "mean", (900.0, 1.0)),
        Difference("draft_newton", "shared_mean", (1000.0, 1000.0 * ratio), (0.0, 1.0), (0.0, half)),
        Difference("tool.tine.force_z_newton", "shared_mean", (1.0, 2.0), (0.0, 0.1), (0.0, 0.1)),
    ]
    (line,) = verdicts(found, ["a", "b"])
    assert line.startswith(f"{words} (95 %")


def test_no_interval_no_verdict() -> None:
    """Runs that are too short have none."""
    short = Difference("draft_newton", "shared_mean", (1.0, 2.0), (math.nan, math.nan), (math.nan, math.nan))
    assert not list(verdicts([short], ["a", "b"]))
