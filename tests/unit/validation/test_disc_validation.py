"""What is computed in validation.disc, without running particles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from validation import disc


def row(angle: float, tilt: float, draft: float, side: float, vertical: float = 5.0) -> disc.Row:
    """A disc whose means are known to 1 N."""
    return disc.Row(angle, tilt, (draft, 1.0), (side, 1.0), (vertical, 1.0), 0.7, 10.0)


@pytest.mark.parametrize("angle", [30.0, -30.0])
def test_a_disc_leans_back_and_pushes_soil_to_the_side_of_its_angle(angle):
    """The face ahead looks up by the tilt; of opposite angles one disc is the other's mirror image."""
    axis = disc.rotation(angle, 20.0).apply((0.0, 1.0, 0.0))
    face = axis * np.sign(axis[0])
    assert_allclose(face[2], np.sin(np.radians(20.0)))
    assert_allclose(np.arctan2(-face[1], face[0]), np.sign(angle) * np.radians(90.0 - 30.0))
    mirrored = disc.rotation(-angle, 20.0).apply((0.0, 1.0, 0.0))
    assert_allclose(mirrored * (1.0, -1.0, 1.0), -axis, atol=1e-12)


def test_trends_are_judged_by_their_intervals():
    """Held, contradicted and not resolved, each where the numbers say so."""
    good = [row(45, 0, 20, 10), row(-45, 0, 20.5, -10), row(45, 15, 25, 7)]
    assert {verdict for _, verdict in disc.verdicts(good)} == {"holds"}
    assert len(list(disc.verdicts(good))) == 3 + 3 + 2
    wrong = dict(disc.verdicts([row(45, 0, 20, -10), row(45, 15, 15, -9.5)]))
    assert sorted(wrong.values()) == ["CONTRADICTED"] * 3 + ["not resolved"]
    apart = dict(disc.verdicts([row(45, 0, 20, 10), row(-45, 0, 20, -4)]))
    assert list(apart.values()).count("CONTRADICTED") == 1


def test_the_angle_of_least_draft():
    """Of the draft, and of that over the width of cut, a chord of the disc times the sine of its angle."""
    rows = [row(15, 0, 10, 5), row(45, 0, 20, 5), row(60, 0, 40, 5)]
    assert "disc angle of 15 degrees, per width of cut at 45" in next(iter(disc.least(rows)))
    assert_allclose(rows[1].cut_m, 2.0 * np.sqrt(0.1**2 - 0.04**2) * np.sin(np.radians(45.0)))


@pytest.mark.parametrize(
    "arguments", [["--angles-deg", "0"], ["--tilts-deg", "-5"], ["--metres", "0.5"], ["--radius-mm", "0"]]
)
def test_arguments_out_of_range_are_refused(arguments, capsys):
    """With one message and exit status 2."""
    with pytest.raises(SystemExit) as caught:
        disc.main(arguments)
    assert caught.value.code == 2
    assert f"{arguments[0]}: " in capsys.readouterr().err
