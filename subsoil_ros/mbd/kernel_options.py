"""How kernels of the mechanism are compiled: cached on disk, IEEE division, no fast-math.

Kernels have no reference counts (`_nrt=False`): counting, a locked instruction for every array of model,
state and workspace at every call, took two thirds of the time. So a kernel allocates no array, and copies
one with linear.copy.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])

kernel = njit(cache=True, error_model="numpy", _nrt=False)

inner_kernel = njit(error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""A kernel that only other kernels call: without the wrapper for Python it compiles much faster. Not cached:
it is part of its callers, which are."""

part_of_kernel = njit(
    error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, inline="always"
)
"""The same, written into its callers before they are compiled: for short functions, and for those of a step
that are called in one place (advance.py). Not for all layers of a step: as one function they compile in less
time, but run a fifth slower."""


def named(function: Function, name: str) -> Function:
    """Give a function that is made anew in each call of another one a name of its own, before it is compiled.

    Compiled code finds a function by its name, its types and a number that counts up in each process. Two
    functions of one name would be taken for one another where kernels from the cache, compiled in another
    process, meet those of this one.
    """
    function.__qualname__ = name
    return function


NO, YES = np.bool_(False), np.bool_(True)
"""Flags that a kernel passes to another. False and True are of two types to numba, which would compile a
variant of the other kernel for each."""
