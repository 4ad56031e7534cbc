"""What is computed of the curves of element tests, and the verb `soil-test`, without running particles."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import subsoil_ros.experiments.strength_tests as strength
from subsoil_ros.cli.main import main
from subsoil_ros.experiments.element_tests import PlaneStrain, Strength, fit_strength

K_P = math.tan(math.radians(45.0 + 16.0)) ** 2


def curve(least_pa: float) -> PlaneStrain:
    """A peak of phi = 32 degrees and c = 1.5 kPa at a strain of 0.03, then 0.7 of it."""
    strain = np.linspace(0.0, 0.15, 2000)
    peak = K_P * least_pa + 2.0 * 1500.0 * math.sqrt(K_P)
    rise = np.clip(strain / 0.03, 0.0, 1.0) - 0.3 * np.clip(strain / 0.03 - 2.0, 0.0, 1.0)
    least = np.full_like(strain, least_pa)
    return PlaneStrain(strain, peak * rise, least, np.zeros_like(strain), least_pa, 1500.0)


def test_strength_from_peaks():
    """Peaks on a line give its cohesion and angle, whatever follows them."""
    found = fit_strength(*zip(*(curve(least).peak_pa() for least in (1e3, 2e3, 4e3)), strict=True))
    assert_allclose(found, (1500.0, 32.0), rtol=1e-9)


def test_critical_state_is_the_end():
    """The mean of the last part of the strain."""
    one = curve(2e3)
    assert_allclose(one.critical_pa(), (2e3, 0.7 * one.peak_pa()[1]), rtol=1e-9)


def test_how_well_the_least_stress_was_held():
    """The largest deviation of a mean over half a per cent of strain: one of 4 % on a half of that is 2 %."""
    one = curve(2e3)
    least = one.least_pa.copy()
    least[1000 : 1000 + 33] *= 1.04  # of 67 rows in half a per cent
    assert_allclose(one._replace(least_pa=least).held_to, 0.04 * 33 / 67, rtol=1e-9)


def test_a_test_that_is_shorter_than_what_is_averaged():
    """Few rows, and less strain than a mean is over: still one least and one greatest stress."""
    short = curve(2e3)._replace(
        **{
            key: getattr(curve(2e3), key)[1:20]
            for key in ("strain", "greatest_pa", "least_pa", "volume_strain")
        }
    )
    least, greatest = short.smoothed()
    assert len(least) == len(greatest) == 1
    assert_allclose(least, 2e3)
    assert short.peak_strain() == short.strain[-1]


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["mechanism_only"], "has no soil of particles"),
        (["tine"], "soil.bed.kind: 'grid' given; the cell of a test is a tile"),
    ],
)
def test_a_scene_without_a_cell_is_refused(words, complaint, capsys):
    """One message and exit status 2."""
    assert main(["soil-test", *words]) == 2
    assert complaint in " ".join(capsys.readouterr().err.split())


def test_results_are_printed(monkeypatch, capsys):
    """Each with its unit; a column that stands has no angle."""
    found = strength.SoilStrength(1450.0, (1e4, 32.0), (3e3, 29.5), 9600.0, 2.6e6, 90.0)
    found = found._replace(peak=Strength(*found.peak), critical=Strength(*found.critical))
    monkeypatch.setattr(strength, "measure_strength", lambda *_: found)
    assert main(["soil-test", "field_tine"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    for words in (
        "density 1450 kg/m3", "peak c = 10.00 kPa, phi = 32.0 deg", "critical state c = 3.00 kPa, phi = 29.5",
        "tensile strength 9.6 kPa", "confined modulus 2.6 MPa", "angle of repose a column stands",
    ):  # fmt: skip
        assert words in shown
