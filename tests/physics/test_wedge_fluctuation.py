"""Wedges that vary: their mean, their spectrum, and that a fit finds them again."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.experiments.fluctuation import (
    SAMPLE_M,
    Fluctuation,
    Wedges,
    bearing_ends,
    bearing_power,
    ends_over_deviation,
    fit_wedges,
    mean_logarithm,
    octave_power,
    variance_of_means,
    without_trend,
)
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.soil_file import read_soil_file
from subsoil_ros.messages import ToolWrenches
from subsoil_ros.wedge.failure_wedge import bearing, block_sizes, mean_bearing

CONFIG = Path(__file__).parents[2] / "config"


def resistance(wedges: Wedges, travel_m: float) -> np.ndarray:
    """What the soil bears along `travel_m`, (n,) SAMPLE_M apart, over its peak: the sum over its blocks."""
    count = int(4.0 * travel_m / wedges.length_m) + 10
    at = np.arange(0.0, travel_m, SAMPLE_M)
    sigma = np.sqrt(np.log1p(wedges.length_variation**2))
    found = np.zeros(len(at))
    for number, size in enumerate(block_sizes(wedges.blocks)):
        random = np.random.default_rng([0, number])
        length = wedges.length_m * np.exp(sigma * random.standard_normal(count) - 0.5 * sigma**2)
        ends = np.cumsum(length) - random.random() * wedges.length_m
        which = np.searchsorted(ends, at, side="right")
        phase = 1.0 - (ends[which] - at) / length[which]
        found += size * bearing(phase, wedges.drop, wedges.gradual)
    return found


WEDGES = (
    Wedges(1.0, False, 0.6, 1.0, 0.08), Wedges(1.0, True, 0.9, 0.15, 0.1), Wedges(2.0, True, 0.9, 1.0, 0.08),
    Wedges(3.4, False, 0.5, 0.3, 0.2),
)  # fmt: skip


@pytest.mark.parametrize("wedges", WEDGES)
def test_the_spectrum_is_that_of_blocks_laid_end_to_end(wedges):
    """Powers by octave of 2 km of random blocks in windows of 5 m, and their mean."""
    window = 5.0
    along = resistance(wedges, 2000.0)
    assert along.mean() == pytest.approx(mean_bearing(wedges.drop, wedges.gradual), rel=0.02)
    count = round(window / SAMPLE_M)
    parts = along[: len(along) // count * count].reshape(-1, count) / along.mean()
    found = np.mean([octave_power(without_trend(part), 0.015) for part in parts], axis=0)
    assert_allclose(bearing_power(wedges, 0.015, window), found, rtol=0.09, atol=2e-3 * found.sum())


@pytest.mark.parametrize("wedges", WEDGES)
def test_the_range_is_that_of_blocks_laid_end_to_end(wedges):
    """Between the quantiles of 2 km, over the deviation."""
    assert bearing_ends(wedges) == pytest.approx(ends_over_deviation(resistance(wedges, 2000.0)), rel=0.02)


def test_many_blocks_are_normal():
    """Power goes as one over their number, and the ends are those of a normal variable; those of one block
    are those of an even variable or of its square."""
    assert bearing_ends(Wedges(1.0, False, 0.05, 0.5, 0.1)) == pytest.approx(0.49 * np.sqrt(12.0), rel=0.01)
    square = np.linspace(0.0, 1.0, 100_001) ** 2
    assert_allclose(bearing_ends(Wedges(1.0, True, 0.9, 0.5, 0.1)), ends_over_deviation(square), rtol=0.01)
    one, many = (Wedges(blocks, False, 0.8, 0.5, 0.1) for blocks in (1.0, 40.0))
    assert_allclose(bearing_power(many, 0.015, 5.0), bearing_power(one, 0.015, 5.0) / 40.0, rtol=1e-9)
    assert bearing_ends(many) == pytest.approx(2.326, rel=0.02)


def test_even_wedges_are_a_saw_tooth():
    """Variance drop^2 / 12, lines of drop^2 / (2 pi^2 k^2) at k / length (Fourier), ends 0.49 drop."""
    drop, length = 0.3, 0.1
    even = Wedges(1.0, False, drop, 0.0, length)
    about = without_trend(resistance(even, 10.0))
    assert np.var(about) == pytest.approx(drop**2 / 12.0, rel=0.01)
    assert bearing_ends(even) == pytest.approx(0.49 * np.sqrt(12.0), rel=5e-3)
    assert ends_over_deviation(about) == pytest.approx(0.49 * np.sqrt(12.0), rel=0.02)
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


def test_a_logarithm_of_few_waves_is_too_small_on_average():
    """Of 400 windows of 5 m: mean logarithms of the powers against mean_logarithm."""
    window = 5.0
    along = resistance(WEDGES[3], 400.0 * window)
    parts = along.reshape(400, -1)
    powers = np.array([octave_power(without_trend(part), 0.015) for part in parts])
    found = np.log(powers).mean(axis=0) - np.log(powers.mean(axis=0))
    expected = mean_logarithm(0.015, window, 1)
    assert_allclose(mean_logarithm(0.015, window, 2), 0.5 * expected, rtol=0.1)
    assert expected[-1] < -0.1
    assert_allclose(found, expected, atol=0.25 * abs(expected[-1]))


@pytest.mark.parametrize("gradual", [False, True])
def test_wedges_that_are_known_are_found(gradual):
    """From their powers and ranges at three depths, the length going with the depth; a tenth of the force is
    inertia."""
    known, window, size, inertia = Wedges(1.0, gradual, 0.8, 0.7, 0.6), 5.0, 0.11, 0.1
    depths = [0.15, 0.2, 0.3]
    pulls = []
    for depth in depths:
        there = known._replace(blocks=(depth / size) ** 2, length_m=0.6 * depth)
        bears = mean_bearing(there.drop, gradual)
        power = bearing_power(there, 0.015, window) * (bears / (bears + inertia)) ** 2
        power *= np.exp(mean_logarithm(0.015, window, 1))
        pulls.append(Fluctuation(depth, power, bearing_ends(there), inertia))
    found, found_size, cost = fit_wedges(pulls, gradual, depths, 0.015, window)
    assert cost < 0.1
    assert_allclose([found.length_variation, found.length_m], [0.7, 0.6], rtol=0.1)
    assert_allclose([found.drop, found_size], [0.8, size], rtol=0.1)


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

    simulate(RunSettings(scene), sink=Sink())
    found = np.mean(drafts[len(drafts) // 4 :])
    assert found == pytest.approx(point["draft_newton"][0], rel=0.1)  # 3 m: its own scatter is 3 %
