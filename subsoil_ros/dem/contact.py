"""The contact of a scene's law: for particle-particle, particle-wall and particle-tool.

These functions call the `kernel.py` of the law, which the type of its NamedTuple of numbers selects. numba
caches such a call on disk and compiles it to the same code as a direct one.
"""

import functools
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numba.extending import overload

from ..contact_laws.base import NO, SPRINGS, YES, ContactLaw, ContactState
from ..contact_laws.registry import contact_laws
from ..contact_laws.springs import like
from ..scene.pair_laws import layer_soils, pair_values
from ..scene.soil import Soil
from .compiled import inner_kernel


def law_features(soil: Soil, *, book: bool = False, periodic: np.ndarray = NO) -> Any:
    """ContactLaw.features of a soil, all layers together; periodic: see Features."""
    values = [value for layer in layer_soils(soil) for value in pair_values(layer)]

    def given(yes: bool) -> np.ndarray:
        return YES if yes else NO

    own = {name: given(yes) for name, yes in soil.law.own_features(values).items()}
    return soil.law.features(
        tangential=given(any(v.tangential_stiffness + v.tangential_damping > 0.0 for v in values)),
        rolling=given(any(v.rolling_friction * v.tangential_stiffness > 0.0 for v in values)),
        book=given(book),
        sizes=given(soil.particles.sizes is not None),
        materials=given(soil.layers is not None),
        periodic=periodic,
        **own,
    )


def soil_laws(soil: Soil) -> tuple[Any, Any, Any]:
    """Law's numbers for particle-particle, particle-wall and particle-tool; equal spheres of one material."""
    pair, boundary = pair_values(soil)
    radius = soil.particles.mean_volume_radius_m
    at_tool = boundary.stiffened(soil.tool_stiffness_factor)
    return (
        soil.law.numbers_of(pair, 0.5 * radius),
        soil.law.numbers_of(boundary, radius),
        soil.law.numbers_of(at_tool, radius),
    )


def history_parity(law: ContactLaw) -> np.ndarray:
    """(components,) 1 for each number kept of a contact, -1 if it changes its sign when seen from j."""
    return np.array([-1.0] * SPRINGS + [float(sign) for sign in law.kept.values()])


def kernel_of(numbers: type, name: str) -> Callable[..., Any]:
    """Function `name` of the kernel.py beside the module in which a law's class of numbers stands."""
    function = getattr(import_module(numbers.__module__.rpartition(".")[0] + ".kernel"), name)
    return getattr(function, "py_func", function)


_by_law = functools.partial(
    overload, jit_options={"forceinline": True, "error_model": "numpy", "fastmath": {"contract"}}
)
_plainly = functools.partial(overload, jit_options={"forceinline": True, "error_model": "numpy"})


def contact(overlap, motion, state, step, law, features):
    """Force and torque of one contact in reach, and its new state.

    overlap [m] is negative across a gap. motion: ContactMotion. state: ContactState a step before.
    Returns force on i [N], torque of rolling friction on i [N m], ContactState, and sinks [J] in the order
    of ContactLaw.sinks.
    """
    return kernel_of(type(law), "contact")(overlap, motion, state, step, law, features)


@_by_law(contact)
def _contact(overlap, motion, state, step, law, features):
    return kernel_of(law.instance_class, "contact")


def normal_potential(overlap, state, law, features):
    """Energy of the elastic normal force [J], zero out of reach; its derivative is the force."""
    return kernel_of(type(law), "normal_potential")(overlap, state, law, features)


@_plainly(normal_potential)
def _normal_potential(overlap, state, law, features):
    return kernel_of(law.instance_class, "normal_potential")


def spring_energy(overlap, state, law):
    """Energy in the tangential and rolling springs [J]; lost when a contact separates."""
    return kernel_of(type(law), "spring_energy")(overlap, state, law)


@_plainly(spring_energy)
def _spring_energy(overlap, state, law):
    return kernel_of(law.instance_class, "spring_energy")


def reach(touch, law, features):
    """Distance of two centres, or of a centre and a wall, up to which they act on each other [m].

    touch [m]: the distance at which they touch.
    """
    return kernel_of(type(law), "reach")(touch, law, features)


@_plainly(reach)
def _reach(touch, law, features):
    return kernel_of(law.instance_class, "reach")


def at_size(law, radius, mass):
    """Numbers at the reduced radius [m] and mass [kg] of a pair, from those at 1 m and 1 kg."""
    return kernel_of(type(law), "at_size")(law, radius, mass)


@_plainly(at_size)
def _at_size(law, radius, mass):
    return kernel_of(law.instance_class, "at_size")


def compiled_expression(name: str, arguments: str, result: str, **scope: object) -> Callable[..., Any]:
    """Compile a function of one expression: numba needs the length of a tuple, which each law has its own."""
    exec(f"def {name}({arguments}):\n    return {result}", scope)
    return scope[name]  # type: ignore[return-value]


def numbers_like(number, law):
    """The numbers of a law in the floating-point type of `number`."""
    return type(law)(*(like(number, item) for item in law))


@_plainly(numbers_like)
def _numbers_like(number, law):
    items = ", ".join(f"like(number, law[{k}])" for k in range(len(law)))
    return compiled_expression(
        "numbers_like", "number, law", f"cls({items})", cls=law.instance_class, like=like
    )


def numbers_at(array, start, stride, law):
    """A NamedTuple of the class of `law`, out of every stride-th number of `array` (n,) from `start` on."""
    return type(law)(*(array[start + k * stride] for k in range(len(law))))


@_plainly(numbers_at)
def _numbers_at(array, start, stride, law):
    items = ", ".join(f"array[start + {k} * stride]" for k in range(len(law)))
    return compiled_expression(
        "numbers_at", "array, start, stride, law", f"cls({items})", cls=law.instance_class
    )


def _own_count(numbers: type) -> int:
    return next(len(law.kept) for law in contact_laws().values() if law.numbers is numbers)


def components(law):
    """Count of the numbers kept of a contact: springs, and the law's own."""
    return SPRINGS + _own_count(type(law))


@overload(components, inline="always")
def _components(law):
    count = SPRINGS + _own_count(law.instance_class)
    return lambda law: count


def own_at(array, start, stride, factor, law):
    """`factor` times the law's own numbers of a contact, every stride-th of `array` (n,) from `start` on."""
    return tuple(factor * array[start + k * stride] for k in range(_own_count(type(law))))


@_plainly(own_at)
def _own_at(array, start, stride, factor, law):
    count = _own_count(law.instance_class)
    items = "".join(f"factor * array[start + {k} * stride], " for k in range(count))
    return compiled_expression("own_at", "array, start, stride, factor, law", f"({items})")


def put_own(own, factor, array, start, stride):
    """`factor` times `own` into every stride-th place of `array` (n,) from `start` on."""
    for k in range(len(own)):
        array[start + k * stride] = factor * own[k]


@_plainly(put_own)
def _put_own(own, factor, array, start, stride):
    return (lambda own, factor, array, start, stride: None) if len(own) == 0 else put_own


@inner_kernel(forceinline=True)
def state_at(array, start, stride, law):
    """ContactState in every stride-th place of `array` (n,) from `start` on."""
    at, one = start + 3 * stride, like(array[start], 1.0)
    return ContactState(
        (array[start], array[start + stride], array[start + 2 * stride]),
        (array[at], array[at + stride], array[at + 2 * stride]),
        own_at(array, at + 3 * stride, stride, one, law),
    )


@inner_kernel(forceinline=True)
def put_state(state, acts, array, start, stride):
    """`state` to where state_at reads it, the law's own numbers times `acts`."""
    at = start + 3 * stride
    array[start], array[start + stride], array[start + 2 * stride] = state.shear
    array[at], array[at + stride], array[at + 2 * stride] = state.rolling
    put_own(state.own, acts, array, at + 3 * stride, stride)
