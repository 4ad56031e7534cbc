"""Questions about Features, for kernels and others; in kernels the answers are constants."""

from collections.abc import Callable
from typing import Any

from numba.extending import overload

Question = Callable[[Any], bool]


def asked_in_kernels(question: Question) -> Question:
    """Let kernels call `question`, whose only argument is named `features`."""
    # not inline="always": numba-cuda fails where an operator is inlined so
    overload(question, jit_options={"forceinline": True})(lambda features: question)
    return question


@asked_in_kernels
def has_tangential(features):
    """Whether contacts resist sliding."""
    return features.tangential.ndim == 2


@asked_in_kernels
def has_rolling(features):
    """Whether contacts resist rolling."""
    return features.rolling.ndim == 2


@asked_in_kernels
def books_energy(features):
    """Whether every energy sink is booked."""
    return features.book.ndim == 2


@asked_in_kernels
def has_sizes(features):
    """Whether radii differ."""
    return features.sizes.ndim == 2


@asked_in_kernels
def has_materials(features):
    """Whether laws or densities differ."""
    return features.materials.ndim == 2


@asked_in_kernels
def is_unlike(features):
    """Whether each pair of particles has numbers of its own."""
    return features.sizes.ndim == 2 or features.materials.ndim == 2


@asked_in_kernels
def is_periodic(features):
    """Whether the soil repeats itself in y only."""
    return features.periodic.ndim == 2


@asked_in_kernels
def is_endless(features):
    """Whether it repeats itself along x, y and z."""
    return features.periodic.ndim == 3
