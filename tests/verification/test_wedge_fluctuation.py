"""Wedges that vary: their mean, their spectrum, and that a fit finds them again."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.api.simulate import simulate
from subsoil_ros.experiments.calibration.fluctuation import (
    SAMPLE_M,
    Wedges,
    bearing_power,
    fit_wedges,
    octave_power,
    variance_of_means,
    without_trend,
)
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.soil_file import read_soil_file
from subsoil_ros.messages import ToolWrenches

CONFIG = Path(__file__).parents[2] / "config"


def bearing(wedges: Wedges, travel_m: float) -> np.ndarray:
    """What the soil bears along `travel_m`, (n,) SAMPLE_M apart, over the peak of a mean wedge."""
    count = int(4.0 * travel_m / wedges.length_m) + 10
    random = np.random.default_rng(0).standard_normal((2, count))
    sigma = np.sqrt(np.log1p(np.array([wedges.variation, wedges.length_variation]) ** 2))[:, None]
    strength, length = np.exp(sigma * random - 0.5 * sigma**2)
    ends = np.cumsum(wedges.length_m * length)
    at = np.arange(0.0, min(travel_m, ends[-1]), SAMPLE_M)
    which = np.searchsorted(ends, at, side="right")
    phase = 1.0 - (ends[which] - at) / (wedges.length_m * length[which])
    return strength[which] * (1.0 - wedges.drop * (1.0 - phase))


@pytest.mark.parametrize(
    "wedges", [Wedges(0.6, 0.1, 1.0, 0.08), Wedges(0.3, 0.3, 0.3, 0.2), Wedges(0.9, 0.01, 0.15, 0.1)]
)
def test_the_spectrum_is_that_of_wedges_laid_end_to_end(wedges):
    """Powers by octave of 2 km of random wedges in windows of 5 m, and their mean, 1 - drop / 2."""
    window = 5.0
    along = bearing(wedges, 2000.0)
    assert along.mean() == pytest.approx(1.0 - 0.5 * wedges.drop, rel=0.02)
    count = round(window / SAMPLE_M)
    parts = along[: len(along) // count * count].reshape(-1, count) / along.mean()
    found = np.mean([octave_power(without_trend(part), 0.015) for part in parts], axis=0)
    assert_allclose(bearing_power(wedges, 0.015, window), found, rtol=0.12, atol=2e-3 * found.sum())


def test_even_wedges_are_a_saw_tooth():
    """Variance drop^2 / 12 and lines of drop^2 / (2 pi^2 k^2) at k / length (Fourier)."""
    drop, length = 0.3, 0.1
    about = without_trend(bearing(Wedges(drop, 0.0, 0.0, length), 10.0))
    assert np.var(about) == pytest.approx(drop**2 / 12.0, rel=0.01)
    # octaves from 0.035 m on: k = 2 in the first, k = 1 in the second
    power = octave_power(about, 0.035)
    assert_allclose(power[:2], drop**2 / (2.0 * np.pi**2) / np.array([4.0, 1.0]), rtol=0.02)
    assert_allclose(power[2:], 0.0, atol=1e-4 * drop**2)


def test_means_of_a_noise_vary_as_one_over_their_length():
    """Variance over the number of samples."""
    noise = np.random.default_rng(1).normal(0.0, 2.0, 400_000)
    for length in (0.1, 0.3):
        found = variance_of_means(noise, length)
        assert found == pytest.approx(4.0 * SAMPLE_M / length, rel=0.1)


def test_wedges_that_are_known_are_found():
    """From their powers at two depths, the length going with the depth."""
    known, window = Wedges(0.5, 0.15, 0.7, 0.6), 5.0
    scales = np.array([0.15, 0.3])
    powers = [bearing_power(known._replace(length_m=0.6 * scale), 0.015, window) for scale in scales]
    found, cost = fit_wedges(powers, scales, np.ones(2), 0.015, window)
    assert cost < 1e-2
    assert_allclose([found.drop, found.length_variation, found.length_m], [0.5, 0.7, 0.6], rtol=0.15)
    assert found.variation == pytest.approx(0.15, abs=0.05)


def test_the_shipped_wedge_of_loam_draws_what_particles_do():
    """field_tine, 0.20 m deep at 1 m/s: not fitted, but in the file's report with the particles' draft."""
    file = CONFIG / "soils" / "loam_wedge.yaml"
    soil = {"model": "wedge", "file": str(file)}
    scene = load_scene("field_tine", {"soil": soil, "tools.tine.path.speed_x_m_per_s.value": 1.0})
    point = next(
        point
        for point in read_soil_file(file).report["points"]
        if (point["depth_m"], point["speed_m_per_s"], point["tilt_rad"]) == (0.2, 1.0, 0.0)
    )
    assert not point["used_in_fit"]
    drafts: list[float] = []

    class Sink:
        def write(self, record):
            if isinstance(record, ToolWrenches) and record.tick >= 0:
                drafts.append(-record.tools[0].force_x_newton)

    simulate(scene, sink=Sink())
    found = np.mean(drafts[len(drafts) // 4 :])
    assert found == pytest.approx(point["draft_newton"][0], rel=0.1)  # 3 m: its own scatter is 3 %
