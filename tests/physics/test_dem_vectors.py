"""Vectors of eight numbers against plain Python, and the rows of particles that they are loaded from."""

import copy

import numpy as np
import pytest
from numba import njit, typeof

from subsoil_ros.dem import vectors
from subsoil_ros.dem.blocks import line_rows
from subsoil_ros.dem.particles import Particles
from tests.physics import plain_vectors

VECTORS = ("position", "velocity", "angular_velocity", "force", "torque")


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


def _particles(count: int) -> Particles:
    p = Particles.at_rest(np.arange(3.0 * count).reshape(count, 3), np.arange(count, dtype=np.int32), float)
    p.angular_velocity[:], p.torque[:] = p.position + 100.0, p.position + 200.0
    return p


@pytest.mark.parametrize("count", [0, 1, 2, 9])
def test_kernels_see_the_rows_of_any_number_of_particles(count: int) -> None:
    """The same types, so that code bound for one count is right for another; the numbers of the views."""
    p, of_two = _particles(count), _particles(2)
    assert typeof(p.kinematics) == typeof(of_two.kinematics)
    assert typeof(p.loads) == typeof(of_two.loads)
    for rows, view in zip((*p.kinematics, *p.loads), (getattr(p, name) for name in VECTORS), strict=True):
        np.testing.assert_array_equal(rows[:, :3], view)
        assert np.shares_memory(rows, view) or count == 0


def test_a_vector_of_particles_is_written_not_replaced() -> None:
    """Views and rows cannot part, nor in a copy."""
    p = _particles(3)
    with pytest.raises(AttributeError, match="write into it"):
        p.velocity = np.zeros((3, 3))
    again = copy.deepcopy(p)
    again.torque[1] = 7.0
    np.testing.assert_array_equal(again.loads.torque[1, :3], 7.0)
    assert p.torque[1, 0] == 203.0
