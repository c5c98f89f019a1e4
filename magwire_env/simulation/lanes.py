"""A number for every wire of a block, as one value that Numba compiles to vector instructions.

Inside a kernel a `Lanes` is used like a float: ``+ - * /``, comparisons (which give a mask), `where`, `sqrt`,
`minimum`; `load` and `store` move it from and to `LANES` neighbouring numbers of an array. Written as loops over the
lanes, the same kernel was five times slower: the compiler left half of the loops scalar, for the sign of an index, a
gather or a possible overlap it could not rule out.

No index is checked, as in all compiled code here. With ``NUMBA_BOUNDSCHECK=1`` in the environment every load, store,
gather, row and part is, as Numba's own indexing then is: an index out of range raises `IndexError`. Fuzzers run that
build.
"""

from __future__ import annotations

import math
import operator

from llvmlite import ir
from numba import njit
from numba.core import cgutils, codegen, config, types
from numba.core.errors import TypingError
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model
from numba.np.arrayobj import populate_array

__all__ = [
    "LANES", "absolute", "anywhere", "floor", "gather", "load", "maximum", "minimum", "part", "reciprocal", "rint",
    "row", "rsqrt", "sin_cos", "spread", "sqrt", "store", "where",
]  # fmt: skip


def _has_avx512() -> bool:
    """Whether kernels are compiled for a processor whose registers hold 8 numbers, and are 32."""
    features = codegen.get_host_cpu_features() if config.CPU_FEATURES is None else config.CPU_FEATURES
    return "+avx512f" in features


LANES = 16 if _has_avx512() else 4
"""Wires in a block: two registers' width with AVX-512. Elsewhere one register's, since 16 registers hold few values."""

_FAST = ("contract", "nsz", "arcp")
_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_FLOATS = ir.VectorType(ir.FloatType(), LANES)
_INTS = ir.VectorType(ir.IntType(64), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)


class _LanesType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Lanes{LANES}")


class _MaskType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Mask{LANES}")


lanes_type, mask_type = _LanesType(), _MaskType()


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, _DOUBLES)


@register_model(_MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, _BITS)


# --- operators --------------------------------------------------------------------------------------------------------


def _splat(builder, value, vector=_DOUBLES):
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)


def _constant(value: float):
    return ir.Constant(_DOUBLES, [value] * LANES)


def _as_lanes(context, builder, value, kind):
    if kind == lanes_type:
        return value
    return _splat(builder, context.cast(builder, value, kind, types.float64))


_PAIRS = ((lanes_type, lanes_type), (lanes_type, types.float64), (types.float64, lanes_type))


def _binary(op, result, build) -> None:
    @infer_global(op)
    class _(ConcreteTemplate):
        cases = [signature(result, *pair) for pair in _PAIRS]  # noqa: RUF012

    for pair in _PAIRS:

        @lower_builtin(op, *pair)
        def lower(context, builder, sig, args):
            a, b = (_as_lanes(context, builder, v, k) for v, k in zip(args, sig.args, strict=True))
            return build(builder, a, b)


_binary(operator.add, lanes_type, lambda builder, a, b: builder.fadd(a, b, flags=_FAST))
_binary(operator.sub, lanes_type, lambda builder, a, b: builder.fsub(a, b, flags=_FAST))
_binary(operator.mul, lanes_type, lambda builder, a, b: builder.fmul(a, b, flags=_FAST))
_binary(operator.truediv, lanes_type, lambda builder, a, b: builder.fdiv(a, b, flags=_FAST))
for _op, _sign in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _binary(_op, mask_type, lambda builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b))


@infer_global(operator.neg)
class _Neg(ConcreteTemplate):
    cases = [signature(lanes_type, lanes_type)]  # noqa: RUF012


@lower_builtin(operator.neg, lanes_type)
def _lower_neg(context, builder, sig, args):
    return builder.fneg(args[0])


def _logic(op, build) -> None:
    @infer_global(op)
    class _(ConcreteTemplate):
        cases = [signature(mask_type, mask_type, mask_type)]  # noqa: RUF012

    @lower_builtin(op, mask_type, mask_type)
    def lower(context, builder, sig, args):
        return build(builder, *args)


_logic(operator.and_, lambda builder, a, b: builder.and_(a, b))
_logic(operator.or_, lambda builder, a, b: builder.or_(a, b))


def _call(builder, name, result, args):
    kind = ir.FunctionType(result, [a.type for a in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)


# --- functions --------------------------------------------------------------------------------------------------------


def _offset(context, builder, full, kind, index):
    """Where ``array[index]`` or ``array[i, j]`` begins, counted in numbers.

    The last axis of a block's array holds the lanes, so a missing last index means its first lane.
    """
    at = index[0]
    for axis in range(1, kind.ndim):
        size = builder.extract_value(full.shape, axis)
        if axis == kind.ndim - 1 and len(index) < kind.ndim:
            size = context.get_constant(types.intp, LANES)
        at = builder.mul(at, size)
        if axis < len(index):
            at = builder.add(at, index[axis])
    return at


def _check(context, builder, inside, what: str) -> None:
    """In the bounds-checked build, code that raises `IndexError` unless the bit `inside` is set."""
    with builder.if_then(builder.not_(inside), likely=False):
        context.call_conv.return_user_exc(builder, IndexError, (f"{what} outside of an array",))


def _check_index(context, builder, full, kind, index, what: str) -> None:
    """Every index in its axis, and all `LANES` numbers from there on inside the array."""
    inside = ir.Constant(ir.IntType(1), 1)
    for axis, i in enumerate(index):
        inside = builder.and_(inside, builder.icmp_unsigned("<", i, builder.extract_value(full.shape, axis)))
    end = builder.add(_offset(context, builder, full, kind, index), context.get_constant(types.intp, LANES))
    _check(context, builder, builder.and_(inside, builder.icmp_signed("<=", end, full.nitems)), what)


def _address(context, builder, array_type, array, index, what):
    full = context.make_array(array_type)(context, builder, value=array)
    if config.BOUNDSCHECK:
        _check_index(context, builder, full, array_type, index, what)
    at = _offset(context, builder, full, array_type, index)
    return builder.bitcast(builder.gep(full.data, [at]), _DOUBLES.as_pointer())


def _indices(name, array, count):
    """Number types for the indices; a block's array takes one fewer than it has axes, others may take them all."""
    if not max(1, array.ndim - 1) <= count <= array.ndim:
        raise TypingError(f"{name} got {count} indices for an array of {array.ndim} axes")
    return [types.intp] * count


@intrinsic
def load(typingctx, array, *index):
    """`LANES` neighbouring numbers of a contiguous array, from ``array[i]``, ``array[i, j]``, … on."""
    kinds = types.StarArgTuple.from_types(_indices("load", array, len(index)))

    def codegen(context, builder, sig, args):
        index = cgutils.unpack_tuple(builder, args[1])
        return builder.load(_address(context, builder, sig.args[0], args[0], index, "a load"), align=8)

    return lanes_type(array, kinds), codegen


@intrinsic
def store(typingctx, array, *rest):
    """``store(array, i, j, …, value)`` writes `LANES` neighbouring numbers of a contiguous array."""
    kinds = types.StarArgTuple.from_types([*_indices("store", array, len(rest) - 1), rest[-1]])

    def codegen(context, builder, sig, args):
        *index, value = cgutils.unpack_tuple(builder, args[1])
        value = _as_lanes(context, builder, value, list(sig.args[1])[-1])
        builder.store(value, _address(context, builder, sig.args[0], args[0], index, "a store"), align=8)
        return context.get_dummy_value()

    return types.void(array, kinds), codegen


def _borrowed(context, builder, kind, data, shape):
    """A view that owns nothing: Numba counts no references for it."""
    view = context.make_array(kind)(context, builder)
    size = context.get_constant(types.intp, 8)
    strides = [size]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    nobody = cgutils.get_null_value(view.meminfo.type)
    populate_array(view, data=data, shape=shape, strides=strides, itemsize=size, meminfo=nobody)
    return view._getvalue()


@intrinsic
def row(typingctx, array, i):
    """``array[i]`` of a contiguous float64 array of two axes or more, borrowed.

    An ordinary slice counts its references with atomic operations on one number; two threads at it waited for each
    other for a third of their time.
    """
    kind = types.Array(types.float64, array.ndim - 1, "C")

    def codegen(context, builder, sig, args):
        full = context.make_array(sig.args[0])(context, builder, value=args[0])
        if config.BOUNDSCHECK:
            first = builder.extract_value(full.shape, 0)
            _check(context, builder, builder.icmp_unsigned("<", args[1], first), "a row")
        shape = [builder.extract_value(full.shape, axis) for axis in range(1, sig.args[0].ndim)]
        size = shape[0]
        for length in shape[1:]:
            size = builder.mul(size, length)
        return _borrowed(context, builder, kind, builder.gep(full.data, [builder.mul(args[1], size)]), shape)

    return kind(array, types.intp), codegen


@intrinsic
def part(typingctx, array, first, count):
    """``array[first : first + count]`` of a contiguous float64 array, borrowed."""
    kind = types.Array(types.float64, array.ndim, "C")

    def codegen(context, builder, sig, args):
        full = context.make_array(sig.args[0])(context, builder, value=args[0])
        shape = [builder.extract_value(full.shape, axis) for axis in range(sig.args[0].ndim)]
        if config.BOUNDSCHECK:
            begins, ends = builder.icmp_signed(">=", args[1], args[1].type(0)), builder.add(args[1], args[2])
            counts = builder.icmp_signed(">=", args[2], args[2].type(0))
            inside = builder.and_(builder.and_(begins, counts), builder.icmp_signed("<=", ends, shape[0]))
            _check(context, builder, inside, "a part")
        at = args[1]
        for length in shape[1:]:
            at = builder.mul(at, length)
        return _borrowed(context, builder, kind, builder.gep(full.data, [at]), [args[2], *shape[1:]])

    return kind(array, types.intp, types.intp), codegen


@intrinsic
def spread(typingctx, value):
    """The same number in every lane."""

    def codegen(context, builder, sig, args):
        return _as_lanes(context, builder, args[0], sig.args[0])

    return lanes_type(types.float64), codegen


@intrinsic
def where(typingctx, mask, a, b):
    """`a` where the mask holds, else `b`."""

    def codegen(context, builder, sig, args):
        a, b = (_as_lanes(context, builder, v, k) for v, k in zip(args[1:], sig.args[1:], strict=True))
        return builder.select(args[0], a, b)

    return lanes_type(mask_type, a, b), codegen


@intrinsic
def anywhere(typingctx, mask):
    """Whether the mask holds in any lane."""

    def codegen(context, builder, sig, args):
        bits = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask_type), codegen


def _extremum(sign: str):
    def typed(typingctx, a, b):
        def codegen(context, builder, sig, args):
            a, b = (_as_lanes(context, builder, v, k) for v, k in zip(args, sig.args, strict=True))
            return builder.select(builder.fcmp_ordered(sign, a, b), a, b)

        return lanes_type(a, b), codegen

    return typed


minimum = intrinsic(_extremum("<"))
maximum = intrinsic(_extremum(">"))


def _llvm(name: str):
    def typed(typingctx, x):
        def codegen(context, builder, sig, args):
            return _call(builder, f"llvm.{name}.v{LANES}f64", _DOUBLES, args)

        return lanes_type(lanes_type), codegen

    return typed


floor = intrinsic(_llvm("floor"))
rint = intrinsic(_llvm("rint"))
absolute = intrinsic(_llvm("fabs"))


@intrinsic
def gather(typingctx, array, index, offset):
    """``array[index + offset]``, `index` a whole number a lane."""

    def codegen(context, builder, sig, args):
        full = context.make_array(sig.args[0])(context, builder, value=args[0])
        data = full.data
        if config.BOUNDSCHECK:
            at = builder.add(builder.fptosi(args[1], _INTS), _splat(builder, args[2], _INTS))
            inside = builder.icmp_unsigned("<", at, _splat(builder, full.nitems, _INTS))
            bits = builder.bitcast(inside, ir.IntType(LANES))
            every = builder.icmp_unsigned("==", bits, ir.Constant(bits.type, (1 << LANES) - 1))
            _check(context, builder, every, "a gather")
        first = builder.ptrtoint(builder.gep(data, [args[2]]), ir.IntType(64))
        shift = ir.Constant(_INTS, [3] * LANES)
        where_to = builder.shl(builder.fptosi(args[1], _INTS), shift)
        address = builder.inttoptr(
            builder.add(where_to, _splat(builder, first, _INTS)), ir.VectorType(ir.DoubleType().as_pointer(), LANES)
        )
        every = ir.Constant(_BITS, [1] * LANES)
        align = ir.Constant(ir.IntType(32), 8)
        name = f"llvm.masked.gather.v{LANES}f64.v{LANES}p0"
        return _call(builder, name, _DOUBLES, [address, align, every, ir.Constant(_DOUBLES, ir.Undefined)])

    return lanes_type(array, lanes_type, types.intp), codegen


def _estimate(context, builder, name, x):
    """The processor's 14-bit estimate of 1/x or 1/√x, by halves of 8 lanes; None where it has none."""
    if "+avx512f" not in str(context.codegen().magic_tuple()) or LANES % 8:
        return None
    eight = ir.VectorType(ir.DoubleType(), 8)
    undefined, every = ir.Constant(eight, ir.Undefined), ir.Constant(ir.IntType(8), -1)
    parts = []
    for first in range(0, LANES, 8):
        numbers = ir.Constant(ir.VectorType(ir.IntType(32), 8), list(range(first, first + 8)))
        part = builder.shuffle_vector(x, ir.Constant(_DOUBLES, ir.Undefined), numbers)
        parts.append(_call(builder, f"llvm.x86.avx512.{name}.pd.512", eight, [part, undefined, every]))
    while len(parts) > 1:
        width = parts[0].type.count * 2
        numbers = ir.Constant(ir.VectorType(ir.IntType(32), width), list(range(width)))
        parts = [builder.shuffle_vector(a, b, numbers) for a, b in zip(parts[::2], parts[1::2], strict=True)]
    return parts[0]


@intrinsic
def rsqrt(typingctx, x):
    """1/√x to rounding, for x in [1e-37, 1e37].

    From the processor's estimate, or one in single precision, by Newton steps.
    """

    def codegen(context, builder, sig, args):
        x, steps = args[0], 2
        y = _estimate(context, builder, "rsqrt14", x)
        if y is None:
            root = _call(builder, f"llvm.sqrt.v{LANES}f32", _FLOATS, [builder.fptrunc(x, _FLOATS)])
            one = ir.Constant(_FLOATS, [1.0] * LANES)
            y = builder.fpext(builder.fdiv(one, root, flags=_FAST), _DOUBLES)
        for _ in range(steps):
            xy = builder.fmul(x, y, flags=_FAST)
            rest = builder.fsub(
                _constant(0.5), builder.fmul(builder.fmul(_constant(0.5), xy, flags=_FAST), y, flags=_FAST), flags=_FAST
            )
            y = builder.fadd(y, builder.fmul(y, rest, flags=_FAST), flags=_FAST)
        return y

    return lanes_type(lanes_type), codegen


@intrinsic
def reciprocal(typingctx, x):
    """1/x to rounding, for |x| in [1e-37, 1e37]."""

    def codegen(context, builder, sig, args):
        x = args[0]
        y = _estimate(context, builder, "rcp14", x)
        if y is None:
            return builder.fdiv(_constant(1.0), x, flags=_FAST)
        for _ in range(2):
            rest = builder.fsub(_constant(1.0), builder.fmul(x, y, flags=_FAST), flags=_FAST)
            y = builder.fadd(y, builder.fmul(y, rest, flags=_FAST), flags=_FAST)
        return y

    return lanes_type(lanes_type), codegen


@njit(error_model="numpy", forceinline=True)
def sin_cos(angle):
    """By Taylor series on a quarter of the wrapped angle, then doubled twice: no library call, error below 4e-16."""
    x = 0.25 * (angle - 2.0 * math.pi * rint(angle * (0.5 / math.pi)))
    z = x * x
    s = x * (
        1.0 + z * (-1 / 6 + z * (1 / 120 + z * (-1 / 5040 + z * (1 / 362880 + z * (
            -1 / 39916800 + z * (1 / 6227020800 - z * (1 / 1307674368000)))))))
    )  # fmt: skip
    vers = z * (
        1 / 2 + z * (-1 / 24 + z * (1 / 720 + z * (-1 / 40320 + z * (1 / 3628800 + z * (
            -1 / 479001600 + z * (1 / 87178291200))))))
    )  # fmt: skip
    for _ in range(2):
        s, vers = 2.0 * s * (1.0 - vers), 2.0 * vers * (2.0 - vers)
    return s, 1.0 - vers


@njit(error_model="numpy", forceinline=True)
def sqrt(x):
    """√x to rounding, for x in [1e-36, 1e37], and 0 for 0: a third of the processor's own square root."""
    return x * rsqrt(maximum(x, 1e-36))
