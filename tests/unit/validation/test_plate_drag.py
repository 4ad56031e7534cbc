"""What the table of dragged plates reads off: the front of the moving soil, its width, a run by its name."""

import math

import numpy as np
import pytest

from validation.plate_drag import Look, Run, band, falls_to, judged, read_name

RUN = Run(0.63, 0.14, 0.005, 0.2, 10.0, 3.0, 1)


def test_name():
    """A file's name tells its run."""
    found = read_name(RUN.name)
    assert found == pytest.approx(RUN)
    assert found.speed_m_per_s == pytest.approx(0.2 * math.sqrt(9.81 * 0.14))


@pytest.mark.parametrize("angle_deg", [30.0, 45.0, 60.0])
def test_band(angle_deg):
    """A wedge that slides with the plate, over soil at rest: its front rises at the angle, and is sharp but
    for the reach of the means."""
    random = np.random.default_rng(0)
    before = random.uniform((0.0, 0.0, -0.2), (0.6, 0.1, 0.0), (40000, 3))
    way = 0.014
    moves = before[:, 0] < (before[:, 2] + RUN.depth_m) / math.tan(math.radians(angle_deg))
    after = before + np.where(moves[:, None], (way, 0.0, 0.0), 0.0)
    number = random.permutation(len(before))
    order = random.permutation(len(before))
    found = band(Look(-0.5 * way, number, before), Look(0.5 * way, number[order], after[order]), RUN)
    assert found[0] == pytest.approx(angle_deg, abs=2.0)
    assert found[1] < 4.0 * RUN.radius_m


def test_falls_to():
    """Along a ramp the levels are met where it has them; one that is not met is NaN."""
    x = np.linspace(0.0, 1.0, 2001)
    found = falls_to(x, 1.0 - 0.5 * x, (0.75, 0.6, 0.2), 0.01)
    assert found[:2] == pytest.approx([0.5, 0.8], abs=0.01)
    assert math.isnan(found[2])


def test_judged(tmp_path):
    """A drag that rises and falls over 0.4 depths: its wavelength, octave and travel between failures."""
    travel = np.arange(1, 601) * 0.02 * RUN.depth_m
    wave = np.sin(2.0 * math.pi * travel / (0.4 * RUN.depth_m))
    noise = np.random.default_rng(1).normal(0.0, 0.02, len(travel))
    rows = [
        f"{x},{100.0 + 20.0 * value},0.0,{50.0 if k % 5 == 0 else math.nan},0.02"
        for k, (x, value) in enumerate(zip(travel, wave + noise, strict=True))
    ]
    path = tmp_path / f"{RUN.name}.csv"
    path.write_text("travel_m,drag_newton,lift_newton,band_deg,band_width_m\n" + "\n".join(rows) + "\n")
    found = judged(path)
    assert found.strongest == pytest.approx(0.4, rel=0.1)
    assert found.stands_out
    assert found.octaves[2] == pytest.approx(0.2 / math.sqrt(2.0), rel=0.05)  # 0.25 to 0.5 depths
    assert found.travel == pytest.approx(0.4, rel=0.05)
    assert found.travel_scatter < 0.1
    assert found.band_deg == pytest.approx(50.0)
    assert found.deviation == pytest.approx(0.2 / math.sqrt(2.0), rel=0.05)
