"""Load cycles against the example of the standard and a constant amplitude."""

import csv
import math

import numpy as np
import pytest

from subsoil_ros.analysis.fatigue import load_cycles, write_cycles_csv

E1049_EXAMPLE = (-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0)
"""ASTM E1049-85, figure 6."""


def test_example_of_the_standard():
    """Ranges 3, 4, 6, 8, 9 with 0.5, 1.5, 0.5, 1.0, 0.5 cycles."""
    found = load_cycles(np.array(E1049_EXAMPLE), 1.0)
    counts = {
        size: float(found.count[found.range_newton == size].sum()) for size in (3.0, 4.0, 6.0, 8.0, 9.0)
    }
    assert counts == {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}
    assert found.count.sum() == 4.0
    assert found.max_range_newton == 9.0


def test_equivalent_range_of_a_constant_amplitude():
    """f cycles a second of range R do the damage of one a second of R f^(1/m)."""
    duration, hertz = 10.0, 2.0
    times = np.linspace(0.0, duration, 20_001)
    found = load_cycles(500.0 * np.cos(2.0 * math.pi * hertz * times), duration)
    assert found.count.sum() == hertz * duration  # half cycles from peak to peak
    assert found.equivalent_range_newton() == pytest.approx(1000.0 * hertz ** (1.0 / 5.0), rel=1e-9)
    assert found.equivalent_range_newton(3.0, hertz) == pytest.approx(1000.0, rel=1e-9)


def test_a_force_that_rests_has_no_cycles():
    """Nor damage."""
    found = load_cycles(np.full(50, 12.0), 1.0)
    assert (found.count.sum(), found.max_range_newton, found.equivalent_range_newton()) == (0.0, 0.0, 0.0)


def test_file_has_the_largest_first(tmp_path):
    """CSV with a heading, in falling order of range."""
    write_cycles_csv(load_cycles(np.array(E1049_EXAMPLE), 1.0), tmp_path / "cycles.csv")
    with (tmp_path / "cycles.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    ranges = [float(row["range_newton"]) for row in rows]
    assert ranges == sorted(ranges, reverse=True)
    assert ranges[0] == 9.0
