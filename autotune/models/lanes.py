"""Several sets of parameters, or several runs, in one pass of a kernel: numbers that are vectors of eight.

A kernel that is given lanes in place of numbers is compiled for them by numba, from the same source: what it does with
a number it does with eight of them at a time, each with the roundings that it would have alone. Where numbers decide
which way a kernel goes, `where` chooses for each lane, and `anywhere` asks whether any lane goes that way.

`exp` is the routine of the C library (S. Nagy, ARM optimized routines, 2018) written for vectors: a table of 2^(i/128)
and a polynomial. All that is not in it (sin, cos, powers) is called lane by lane.
"""

from __future__ import annotations

import decimal
import math
import operator
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, ConcreteTemplate, infer_global
from numba.extending import intrinsic, models, register_model

from autotune.core.arrays import Floats

WIDTH = 8
_TABLE_BITS = 7
_TABLE = 1 << _TABLE_BITS


def filled(sets: Sequence[Floats]) -> Floats:
    """Eight sets of values of shape (places,), lane beside lane: shape (places, 8)."""
    return np.ascontiguousarray(np.array(sets).T)


def where(condition: Any, one: Any, other: Any) -> Any:
    """`one` in the lanes where the condition holds, `other` elsewhere; both are computed."""
    return one if condition else other


def anywhere(condition: Any) -> Any:
    """Whether the condition holds in any lane."""
    return condition


class Lanes(types.Type):
    """Eight numbers; a number beside them is in every lane."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        return Conversion.safe if isinstance(other, (types.Float, types.Integer)) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        return self if isinstance(other, (types.Float, types.Integer)) else None


class Mask(types.Type):
    """Eight answers, yes or no."""

    def __init__(self) -> None:
        super().__init__(name="LaneMask")

    def unify(self, typingctx: Any, other: Any) -> Any:
        return self if other == types.boolean else None


class Places(types.Type):
    """An array of lanes: `rows` a row for each, or one for all, `table` lane beside lane."""

    def __init__(self, form: str) -> None:
        self.form = form
        super().__init__(name=f"LanePlaces({form})")


lanes, mask = Lanes(), Mask()
rows, table = Places("rows"), Places("table")
_double, _word = ir.DoubleType(), ir.IntType(64)
_vector, _words, _bits = (ir.VectorType(t, WIDTH) for t in (_double, _word, ir.IntType(1)))


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _vector)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _bits)


@register_model(Places)
class _PlacesModel(models.StructModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        members = [
            ("data", numba.types.CPointer(numba.types.float64)),
            ("count", types.intp),
            ("apart", types.intp),
        ]
        super().__init__(manager, kind, members)


def _each(value: float) -> Any:
    return ir.Constant(_vector, [ir.Constant(_double, value)] * WIDTH)


def _each_word(value: int) -> Any:
    return ir.Constant(_words, [ir.Constant(_word, value)] * WIDTH)


def _spread(builder: Any, number: Any) -> Any:
    """A number in every lane."""
    first = builder.insert_element(ir.Constant(_vector, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [ir.Constant(ir.IntType(32), 0)] * WIDTH)
    return builder.shuffle_vector(first, ir.Constant(_vector, ir.Undefined), zeros)


def _number_to_lanes(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return _spread(builder, context.cast(builder, value, given, types.float64))


def _answer_to_lanes(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    number = builder.uitofp(value, _double)
    return builder.fcmp_ordered("!=", _spread(builder, number), _each(0.0))


lower_cast(types.Float, Lanes)(_number_to_lanes)
lower_cast(types.Integer, Lanes)(_number_to_lanes)
lower_cast(types.Boolean, Mask)(_answer_to_lanes)


def _library(builder: Any, name: str, count: int) -> Any:
    kind = ir.FunctionType(_vector, [_vector] * count)
    return cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")


def _typed(key: Any, *cases: Any) -> None:
    """Tells numba which lanes an operation or function takes."""

    class Template(ConcreteTemplate):  # type: ignore[misc]
        pass

    Template.key, Template.cases = key, list(cases)
    infer_global(key)(Template)


def _lowered(key: Any, kinds: tuple[Any, ...], body: Callable[..., Any]) -> None:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return body(builder, *args)

    lower_builtin(key, *kinds)(lower)


def _arithmetic() -> None:
    two = signature(lanes, lanes, lanes)
    binary = {
        (operator.add, operator.iadd): "fadd",
        (operator.sub, operator.isub): "fsub",
        (operator.mul, operator.imul): "fmul",
        (operator.truediv, operator.itruediv): "fdiv",
    }
    for keys, name in binary.items():
        for key in keys:
            _typed(key, two)
            _lowered(key, (lanes, lanes), lambda b, x, y, name=name: getattr(b, name)(x, y))
    _typed(operator.neg, signature(lanes, lanes))
    _lowered(operator.neg, (lanes,), lambda b, x: b.fneg(x))
    for test, sign in {
        operator.lt: "<", operator.le: "<=", operator.gt: ">", operator.ge: ">=", operator.eq: "==",
        operator.ne: "!=",
    }.items():  # fmt: skip
        _typed(test, signature(mask, lanes, lanes))
        compare = "fcmp_unordered" if sign == "!=" else "fcmp_ordered"
        _lowered(test, (lanes, lanes), lambda b, x, y, s=sign, c=compare: getattr(b, c)(s, x, y))
    _typed(operator.and_, signature(mask, mask, mask))
    _lowered(operator.and_, (mask, mask), lambda b, x, y: b.and_(x, y))


def _functions() -> None:
    plain: dict[Any, str] = {abs: "fabs", math.sqrt: "sqrt", math.floor: "floor"}
    for key, name in plain.items():
        _typed(key, signature(lanes, lanes))
        _lowered(key, (lanes,), lambda b, x, name=name: b.call(_library(b, name, 1), [x]))
    _typed(float, signature(lanes, lanes))
    _lowered(float, (lanes,), lambda b, x: x)
    _typed(math.copysign, signature(lanes, lanes, lanes))
    _lowered(math.copysign, (lanes, lanes), lambda b, x, y: b.call(_library(b, "copysign", 2), [x, y]))
    extremes: dict[Any, str] = {min: "<", max: ">"}
    for key, sign in extremes.items():  # as numba has them: the first, unless the second is beyond it
        _typed(key, signature(lanes, lanes, lanes))
        _lowered(key, (lanes, lanes), lambda b, x, y, s=sign: b.select(b.fcmp_ordered(s, y, x), y, x))
    for key in (math.sin, math.cos):
        _typed(key, signature(lanes, lanes))
        _lowered(key, (lanes,), lambda b, x, name=key.__name__: _one_by_one(b, name, x))
    for key in (operator.pow, operator.ipow):
        _typed(key, signature(lanes, lanes, lanes))
        _lowered(key, (lanes, lanes), lambda b, x, y: _one_by_one(b, "pow", x, y))
    _typed(math.exp, signature(lanes, lanes))
    _lowered(math.exp, (lanes,), _exponential)


def _one_by_one(builder: Any, name: str, *given: Any) -> Any:
    """A function of the C library, called for each lane that is not given the same as the one before it."""
    kind = ir.FunctionType(_double, [_double] * len(given))
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    result = ir.Constant(_vector, ir.Undefined)
    before: list[Any] = []
    value: Any = None
    for lane in range(WIDTH):
        at = ir.Constant(ir.IntType(32), lane)
        arguments = [builder.extract_element(x, at) for x in given]
        if before:
            value = _unless_same(builder, function, arguments, before, value)
        else:
            value = builder.call(function, arguments)
        before = arguments
        result = builder.insert_element(result, value, at)
    return result


def _unless_same(builder: Any, function: Any, arguments: list[Any], before: list[Any], known: Any) -> Any:
    """The value of a function; `known` where its arguments are those of before."""
    differs = ir.Constant(ir.IntType(1), 0)
    for one, other in zip(arguments, before, strict=True):
        differs = builder.or_(differs, builder.fcmp_unordered("!=", one, other))
    begun = builder.block
    with builder.if_then(differs):
        fresh = builder.call(function, arguments)
        called = builder.block
    value = builder.phi(_double)
    value.add_incoming(known, begun)
    value.add_incoming(fresh, called)
    return value


def _powers_of_two() -> tuple[list[int], list[int]]:
    """2^(i/128) = H·(1 + T): the bits of T, and those of H less i/128 in the exponent's place."""
    rest, head = [], []
    with decimal.localcontext() as exact:
        exact.prec = 60
        for i in range(_TABLE):
            power = decimal.Decimal(2) ** (decimal.Decimal(i) / _TABLE)
            near = float(power)
            tail = float(power / decimal.Decimal(near) - 1)
            rest.append(_bits_of(tail))
            head.append((_bits_of(near) - (i << (52 - _TABLE_BITS))) % 2**64)
    return rest, head


def _bits_of(value: float) -> int:
    return int(struct.unpack("<Q", struct.pack("<d", value))[0])


_REST, _HEAD = _powers_of_two()
_SHIFT = float.fromhex("0x1.8p52")
_INVERSE = float.fromhex("0x1.71547652b82fep0") * _TABLE
_NEGATIVE_HIGH, _NEGATIVE_LOW = (
    float.fromhex("-0x1.62e42fefa0000p-8"),
    float.fromhex("-0x1.cf79abc9e3b39p-47"),
)
_C2, _C3, _C4, _C5 = (
    float.fromhex(text)
    for text in (
        "0x1.ffffffffffdbdp-2",
        "0x1.555555555543cp-3",
        "0x1.55555cf172b91p-5",
        "0x1.1111167a4d017p-7",
    )
)
_LOWEST, _HIGHEST = -708.0, 709.0


def _looked_up(builder: Any, words: list[int], name: str, at: Any) -> Any:
    """Words of a table, as a vector."""
    kind = ir.ArrayType(_word, _TABLE)
    table = cgutils.global_constant(builder, name, ir.Constant(kind, words))
    result = ir.Constant(_words, ir.Undefined)
    for lane in range(WIDTH):
        place = ir.Constant(ir.IntType(32), lane)
        index = builder.extract_element(at, place)
        found = builder.load(builder.gep(table, [ir.Constant(_word, 0), index]))
        result = builder.insert_element(result, found, place)
    return result


def _exponential(b: Any, x: Any) -> Any:
    """e^x: 0 below -708, infinite from 709 on, which the library is at -745 and 709.8."""
    fused = _library(b, "fmuladd", 3)

    def add(one: Any, two: Any, three: Any) -> Any:
        return b.call(fused, [one, two, three])

    inside = b.and_(b.fcmp_ordered(">=", x, _each(_LOWEST)), b.fcmp_ordered("<=", x, _each(_HIGHEST)))
    near = b.select(inside, x, _each(0.0))
    shifted = b.fadd(b.fmul(_each(_INVERSE), near), _each(_SHIFT))
    whole = b.bitcast(shifted, _words)
    steps = b.fsub(shifted, _each(_SHIFT))
    r = add(steps, _each(_NEGATIVE_LOW), add(steps, _each(_NEGATIVE_HIGH), near))
    at = b.and_(whole, _each_word(_TABLE - 1))
    tail = b.bitcast(_looked_up(b, _REST, "exp_rest", at), _vector)
    head = b.add(_looked_up(b, _HEAD, "exp_head", at), b.shl(whole, _each_word(52 - _TABLE_BITS)))
    scale = b.bitcast(head, _vector)
    square = b.fmul(r, r)
    total = add(square, add(r, _each(_C3), _each(_C2)), b.fadd(tail, r))
    total = add(b.fmul(square, square), add(r, _each(_C5), _each(_C4)), total)
    result = add(scale, total, scale)
    beyond = b.select(b.fcmp_ordered(">", x, _each(0.0)), _each(math.inf), _each(0.0))
    beyond = b.select(b.fcmp_unordered("uno", x, x), x, beyond)
    return b.select(inside, result, beyond)


@infer_global(where)
class _Where(AbstractTemplate):  # type: ignore[misc]
    def generic(self, args: Any, kws: Any) -> Any:
        if len(args) == 3 and args[0] == types.boolean:
            return signature(types.float64, types.boolean, types.float64, types.float64)
        return signature(lanes, mask, lanes, lanes) if args[0] == mask else None


@infer_global(anywhere)
class _Anywhere(ConcreteTemplate):  # type: ignore[misc]
    key = anywhere
    cases = [signature(types.boolean, types.boolean), signature(types.boolean, mask)]  # noqa: RUF012


def _choices() -> None:
    for kinds in ((types.boolean, types.float64, types.float64), (mask, lanes, lanes)):
        _lowered(where, kinds, lambda b, condition, one, other: b.select(condition, one, other))
    _lowered(anywhere, (types.boolean,), lambda b, condition: condition)
    _lowered(anywhere, (mask,), _any_lane)


def _any_lane(builder: Any, condition: Any) -> Any:
    word = ir.IntType(WIDTH)
    return builder.icmp_unsigned("!=", builder.bitcast(condition, word), ir.Constant(word, 0))


def _viewed(values: Any, kind: Places) -> Any:
    """What numba makes of an array that is to be read as lanes."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array = context.make_array(sig.args[0])(context, builder, args[0])
        out = cgutils.create_struct_proxy(kind)(context, builder)
        height, width = cgutils.unpack_tuple(builder, array.shape)
        out.data, out.count = array.data, width if kind is rows else height
        single = builder.icmp_signed("==", height, ir.Constant(height.type, 1))
        out.apart = builder.select(single, ir.Constant(width.type, 0), width)
        return out._getvalue()

    return signature(kind, values), lower


@intrinsic  # type: ignore[untyped-decorator]
def along(typingctx: Any, values: Any) -> Any:
    """Values of shape (8, n), a row for each lane, or (1, n), one for all."""
    return _viewed(values, rows)


@intrinsic  # type: ignore[untyped-decorator]
def side_by_side(typingctx: Any, values: Any) -> Any:
    """Values of shape (n, 8), lane beside lane."""
    return _viewed(values, table)


def _address(builder: Any, kind: Places, array: Any, at: Any, lane: int = 0) -> Any:
    if kind is table:
        at = builder.mul(at, ir.Constant(at.type, WIDTH))
    else:
        at = builder.add(at, builder.mul(array.apart, ir.Constant(at.type, lane)))
    return builder.gep(array.data, [at])


def _load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0]
    array = cgutils.create_struct_proxy(kind)(context, builder, args[0])
    if kind is table:
        address = builder.bitcast(_address(builder, kind, array, args[1]), _vector.as_pointer())
        return builder.load(address, align=8)
    result = ir.Constant(_vector, ir.Undefined)
    for lane in range(WIDTH):
        one = builder.load(_address(builder, kind, array, args[1], lane))
        result = builder.insert_element(result, one, ir.Constant(ir.IntType(32), lane))
    return result


def _store(context: Any, builder: Any, sig: Any, args: Any) -> None:
    kind = sig.args[0]
    array = cgutils.create_struct_proxy(kind)(context, builder, args[0])
    if kind is table:
        address = builder.bitcast(_address(builder, kind, array, args[1]), _vector.as_pointer())
        builder.store(args[2], address, align=8)
        return
    for lane in range(WIDTH):
        one = builder.extract_element(args[2], ir.Constant(ir.IntType(32), lane))
        builder.store(one, _address(builder, kind, array, args[1], lane))


def _count(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return cgutils.create_struct_proxy(sig.args[0])(context, builder, args[0]).count


def _arrays() -> None:
    for kind in (rows, table):
        _typed(operator.getitem, signature(lanes, kind, types.intp))
        lower_builtin(operator.getitem, kind, types.intp)(_load)
        _typed(len, signature(types.intp, kind))
        lower_builtin(len, kind)(_count)
        _typed(operator.setitem, signature(types.none, kind, types.intp, lanes))
        lower_builtin(operator.setitem, kind, types.intp, lanes)(_store)


_arithmetic()
_functions()
_choices()
_arrays()
