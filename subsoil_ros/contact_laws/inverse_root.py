"""1 / sqrt(x) by multiplications alone.

Roots and quotients keep a core's one divider busy for longer than all else in a contact takes. A seed from
the number's bits (half the exponent, negated) is right to 3.5 %, and each Newton step squares the
error: 4e-2, 2e-3, 5e-6, 3e-11, 2e-21.
"""

from numba import njit, types
from numba.extending import intrinsic, overload

_SEEDS = {types.float64: (types.int64, 0x5FE6EB50C7B537A9), types.float32: (types.int32, 0x5F3759DF)}
"""Integer type of the same width, and the number that makes the seed best (C. Lomont 2003, Fast inverse
square root; for 64 bits M. Robertson 2012)."""


@intrinsic
def _seed(typing_context, x):
    """1 / sqrt(x) to 3.5 %, x > 0 and normal."""
    integer, magic = _SEEDS[x]

    def build(context, builder, signature, arguments):
        bits = builder.bitcast(arguments[0], context.get_value_type(integer))
        halved = builder.lshr(bits, context.get_constant(integer, 1))
        seed = builder.sub(context.get_constant(integer, magic), halved)
        return builder.bitcast(seed, context.get_value_type(x))

    return x(x), build


def _newton_steps(x: float) -> int:
    """Number of Newton steps until the error is round-off."""
    raise NotImplementedError("compiled code only")


@overload(_newton_steps, inline="always")
def _newton_steps_of_type(x):
    if x == types.float32:
        return lambda x: 3
    return lambda x: 4


@njit(cache=True, forceinline=True, error_model="numpy", fastmath={"contract"})
def inverse_root(x):
    """1 / sqrt(x) to two units in the last place; x > 0 and normal, float64 or float32."""
    half = type(x)(0.5)
    halved, root = half * x, _seed(x)
    for _ in range(_newton_steps(x)):
        root += root * (half - halved * root * root)
    return root
