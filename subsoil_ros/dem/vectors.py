"""Eight numbers at a time in kernels, where the compiler alone would move them one by one.

A particle's vectors stand beside one another (dem.particles.ParticleRows), so its state comes with two loads
and its force and torque go with one store; a transposition turns eight such rows into rows of eight pairs.
Where vectors are narrower, the compiler splits them.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

LANES = 8


class Eight(types.Type):
    """LANES numbers of one type, as a value of a kernel."""

    def __init__(self, number: types.Float) -> None:
        self.number = number
        super().__init__(name=f"Eight({number})")


def _vector(number: types.Float, lanes: int = LANES) -> ir.VectorType:
    return ir.VectorType(ir.DoubleType() if number == types.float64 else ir.FloatType(), lanes)


@register_model(Eight)
class _EightModel(models.PrimitiveModel):
    def __init__(self, manager: Any, eight: Eight) -> None:
        super().__init__(manager, eight, _vector(eight.number))


def _place(context: Any, builder: Any, of_array: Any, array: Any, first: Any, lanes: int) -> Any:
    """Pointer to `lanes` numbers of an array from its number `first` on."""
    start = builder.gep(context.make_array(of_array)(context, builder, array).data, [first])
    return builder.bitcast(start, _vector(of_array.dtype, lanes).as_pointer())


def _shuffled(builder: Any, a: Any, b: Any, lanes: list[int]) -> Any:
    """Numbers of a, and from LANES of a on of b."""
    number = ir.IntType(32)
    chosen = ir.Constant(ir.VectorType(number, len(lanes)), [ir.Constant(number, lane) for lane in lanes])
    return builder.shuffle_vector(a, b, chosen)


@intrinsic
def load_eight(typing_context, array, first):
    """The numbers first to first + 7 of an array without gaps."""

    def build(context, builder, signature, arguments):
        place = _place(context, builder, signature.args[0], arguments[0], arguments[1], LANES)
        return builder.load(place, align=array.dtype.bitwidth // 8)

    return Eight(array.dtype)(array, first), build


@intrinsic
def store_eight(typing_context, array_out, first, eight):
    """Puts eight numbers to first to first + 7 of an array without gaps."""

    def build(context, builder, signature, arguments):
        place = _place(context, builder, signature.args[0], arguments[0], arguments[1], LANES)
        builder.store(arguments[2], place, align=array_out.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array_out, first, eight), build


@intrinsic
def eight_zeros(typing_context, array):
    """Eight zeros of the type of an array."""
    zeros = ir.Constant(_vector(array.dtype), [0.0] * LANES)
    return Eight(array.dtype)(array), lambda context, builder, signature, arguments: zeros


@intrinsic
def add_eight(typing_context, a, b):
    """a + b."""
    return a(a, b), lambda context, builder, signature, arguments: builder.fadd(*arguments)


@intrinsic
def seen_from(typing_context, place, motion, i, j):
    """What a pair needs of the rows of its particles i and j, as two eights:
    x_j - x_i, m_i, v_i - v_j, m_j and w_i, r_i, w_j, r_j."""
    number = motion.dtype

    def build(context, builder, signature, arguments):
        of_place, of_motion, index, _ = signature.args
        four, eight = (context.get_constant(index, lanes) for lanes in (4, LANES))
        one, other = (
            builder.load(_place(context, builder, of_place, arguments[0], builder.mul(k, four), 4), align=8)
            for k in arguments[2:]
        )
        apart = builder.fsub(other, one)
        if number != types.float64:
            apart = builder.fptrunc(apart, _vector(number, 4))
        one, other = (
            builder.load(
                _place(context, builder, of_motion, arguments[1], builder.mul(k, eight), LANES),
                align=number.bitwidth // 8,
            )
            for k in arguments[2:]
        )
        apart = _shuffled(builder, apart, apart, [0, 1, 2, 3, 0, 1, 2, 3])
        masses = _shuffled(builder, one, other, [7, 7, 7, 7, 15, 15, 15, 15])
        relative = builder.fsub(one, other)
        relative = _shuffled(builder, apart, relative, [0, 1, 2, 3, 8, 9, 10, 11])
        relative = _shuffled(builder, relative, masses, [0, 1, 2, 8, 4, 5, 6, 12])
        turning = _shuffled(builder, one, other, [3, 4, 5, 6, 11, 12, 13, 14])
        return context.make_tuple(builder, signature.return_type, (relative, turning))

    return types.UniTuple(Eight(number), 2)(place, motion, i, j), build


@intrinsic
def opposite(typing_context, on_i, on_j):
    """-a0, -a1, -a2 and b3, b4, b5: the force on the other particle, and its torque; then zeros of b."""

    def build(context, builder, signature, arguments):
        return _shuffled(builder, builder.fneg(arguments[0]), arguments[1], [0, 1, 2, 11, 12, 13, 14, 15])

    return on_i(on_i, on_j), build


@intrinsic
def transposed(typing_context, rows):
    """Number k of each of eight eights, for each k: eight eights."""

    def build(context, builder, signature, arguments):
        rows = cgutils.unpack_tuple(builder, arguments[0], LANES)
        for distance, low in (
            (1, [0, 8, 2, 10, 4, 12, 6, 14]),
            (2, [0, 1, 8, 9, 4, 5, 12, 13]),
            (4, [0, 1, 2, 3, 8, 9, 10, 11]),
        ):
            turned = list(rows)
            for k in range(LANES):
                if not k & distance:
                    other = k | distance
                    turned[k] = _shuffled(builder, rows[k], rows[other], low)
                    turned[other] = _shuffled(
                        builder, rows[k], rows[other], [lane + distance for lane in low]
                    )
            rows = turned
        return cgutils.pack_array(builder, rows)

    return rows(rows), build
