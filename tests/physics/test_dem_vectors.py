"""Vectors of eight numbers against plain Python."""

import numpy as np
import pytest
from numba import njit

from subsoil_ros.dem import vectors
from subsoil_ros.dem.blocks import line_rows
from tests.physics import plain_vectors


@njit
def _in_kernel(place, motion, i, j, out):
    a, b = vectors.seen_from(place, motion, i, j)
    vectors.store_eight(out, 0, a)
    vectors.store_eight(out, 8, b)
    vectors.store_eight(out, 16, vectors.opposite(a, b))
    vectors.store_eight(out, 24, vectors.add_eight(a, vectors.load_eight(motion, 8 * j)))
    vectors.store_eight(out, 32, vectors.eight_zeros(out))
    rows = vectors.transposed((a, b, a, b, b, a, b, vectors.load_eight(motion, 8 * i)))
    vectors.store_eight(out, 40, rows[0])
    vectors.store_eight(out, 48, rows[3])
    vectors.store_eight(out, 56, rows[7])


def _plain(place, motion, i, j):
    of = plain_vectors
    a, b = of.seen_from(place, motion, i, j)
    rows = of.transposed((a, b, a, b, b, a, b, motion[i]))
    return np.concatenate(
        (a, b, of.opposite(a, b), a + motion[j], np.zeros(8), rows[0], rows[3], rows[7]), dtype=motion.dtype
    )


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_they_are_those_of_plain_python(kind: type) -> None:
    """Every number, bit for bit; no row crosses a line of the cache."""
    numbers = np.random.default_rng(1)
    place, motion = line_rows(9, 4, np.float64), line_rows(9, 8, kind)
    place[:], motion[:] = numbers.normal(size=place.shape), numbers.normal(size=motion.shape)
    assert place.ctypes.data % 64 == motion.ctypes.data % 64 == 0
    out = np.empty(64, kind)
    for i, j in ((0, 8), (5, 2)):
        _in_kernel(place, motion, i, j, out)
        np.testing.assert_array_equal(out, _plain(place, motion, i, j))
