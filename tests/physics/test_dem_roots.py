"""The inverse root that the contact law uses instead of roots and quotients."""

import numpy as np
import pytest
from numba import njit

from subsoil_ros.contact_laws.inverse_root import inverse_root


@njit
def inverse_roots(x):
    """inverse_root of every number of `x` (n,)."""
    found = np.empty_like(x)
    for i in range(len(x)):
        found[i] = inverse_root(x[i])
    return found


@pytest.mark.parametrize(("kind", "lowest"), [(np.float64, 1e-300), (np.float32, 1e-36)])
def test_it_is_right_to_two_units_in_the_last_place(kind, lowest):
    """All mantissas and exponents, against the root of the hardware in a wider type."""
    exponents = np.random.default_rng(0).uniform(np.log(lowest), -np.log(lowest), 100_000)
    x = np.exp(exponents).astype(kind)
    exact = 1.0 / np.sqrt(x.astype(np.longdouble))
    assert np.abs(inverse_roots(x) / exact - 1.0).max() < 2.0 * np.finfo(kind).eps


def test_what_is_no_number_stays_none():
    """A state that is lost must not come out as a plausible force."""
    assert np.isnan(inverse_roots(np.array([np.nan]))).all()
