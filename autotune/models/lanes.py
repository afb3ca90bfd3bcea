"""Several sets of parameters, or several runs, in one pass of a kernel: numbers that are vectors of eight.

A kernel that is given lanes in place of numbers is compiled for them by numba, from the same source: what it does with
a number it does with eight of them at a time, each with the roundings that it would have alone (but for those of
`lane_functions`). Where numbers decide which way a kernel goes, `where` chooses for each lane, and `anywhere` asks
whether any lane goes that way.

Their exponential, powers, sine and cosine are in `lane_functions`.
"""

from __future__ import annotations

import math
import operator
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
from autotune.models.lane_functions import WIDTH as WIDTH
from autotune.models.lane_functions import (
    any_lane,
    cosine,
    each,
    exponential,
    library,
    power,
    sine,
    vector,
)

LINE = 64
"""Bytes of a line of the processor's cache: a vector of eight numbers fills one, or is in two of them."""


def room_for(count: int) -> Floats:
    """Room for values lane beside lane, shape (count, 8), every eight of them in one line of the cache."""
    room = np.empty((count + 1) * WIDTH)
    first = -room.ctypes.data % LINE // room.itemsize
    return room[first : first + count * WIDTH].reshape(count, WIDTH)


def zeros_for(count: int) -> Floats:
    """`room_for` values that are 0 until they are known."""
    room = room_for(count)
    room[:] = 0.0
    return room


def filled(sets: Sequence[Floats]) -> Floats:
    """Eight sets of values of shape (places,), lane beside lane: shape (places, 8)."""
    table = room_for(len(sets[0]))
    table[:] = np.array(sets).T
    return table


def beside_or_one(values: Sequence[Floats]) -> Floats:
    """Long values of shape (n,), one for all lanes, (1, n), or one for each, lane beside lane: shape (n, 8).

    Lanes beyond the last have its values. A pass that reads eight rows from eight places waits for memory at half of
    its ticks; here all that it reads at a time is in one line of the cache.
    """
    if len(values) == 1:
        return np.ascontiguousarray(values[0])[None]
    result = room_for(len(values[0]))
    for lane in range(WIDTH):
        result[:, lane] = values[min(lane, len(values) - 1)]
    return result


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
    """An array of lanes: `rows` a row for each, or one for all; `table` lane beside lane; `either` that or one."""

    def __init__(self, form: str) -> None:
        self.form = form
        super().__init__(name=f"LanePlaces({form})")


lanes, mask = Lanes(), Mask()
rows, table, either = Places("rows"), Places("table"), Places("either")
_double, _bits = ir.DoubleType(), ir.VectorType(ir.IntType(1), WIDTH)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, vector)


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


def _spread(builder: Any, number: Any) -> Any:
    """A number in every lane."""
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [ir.Constant(ir.IntType(32), 0)] * WIDTH)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zeros)


def _number_to_lanes(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return _spread(builder, context.cast(builder, value, given, types.float64))


def _answer_to_lanes(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    number = builder.uitofp(value, _double)
    return builder.fcmp_ordered("!=", _spread(builder, number), each(0.0))


lower_cast(types.Float, Lanes)(_number_to_lanes)
lower_cast(types.Integer, Lanes)(_number_to_lanes)
lower_cast(types.Boolean, Mask)(_answer_to_lanes)


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
        _lowered(key, (lanes,), lambda b, x, name=name: b.call(library(b, name, 1), [x]))
    _typed(float, signature(lanes, lanes))
    _lowered(float, (lanes,), lambda b, x: x)
    _typed(math.copysign, signature(lanes, lanes, lanes))
    _lowered(math.copysign, (lanes, lanes), lambda b, x, y: b.call(library(b, "copysign", 2), [x, y]))
    extremes: dict[Any, str] = {min: "<", max: ">"}
    for key, sign in extremes.items():  # as numba has them: the first, unless the second is beyond it
        _typed(key, signature(lanes, lanes, lanes))
        _lowered(key, (lanes, lanes), lambda b, x, y, s=sign: b.select(b.fcmp_ordered(s, y, x), y, x))
    for key, body in {math.sin: sine, math.cos: cosine, math.exp: exponential}.items():
        _typed(key, signature(lanes, lanes))
        _lowered(key, (lanes,), body)
    for key in (operator.pow, operator.ipow):
        _typed(key, signature(lanes, lanes, lanes))
        _lowered(key, (lanes, lanes), power)


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
    _lowered(anywhere, (mask,), any_lane)


def _align_stack(builder: Any) -> None:
    """Makes the compiler begin the routine's stack at a line of the cache.

    A kernel keeps far more vectors than the processor has registers for. Nothing on its stack asks for more than 16
    bytes by itself, so that three of four vectors would lie across two lines, and take twice as long to write and read.
    An empty instruction that is given the place of an aligned vector cannot be left out, and costs nothing.
    """
    with builder.goto_entry_block():
        place = builder.alloca(vector)
        place.align = LINE
    builder.asm(ir.FunctionType(ir.VoidType(), [vector.as_pointer()]), "", "r", [place], True)


def _viewed(values: Any, kind: Places) -> Any:
    """What numba makes of an array that is to be read as lanes."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array = context.make_array(sig.args[0])(context, builder, args[0])
        _align_stack(builder)
        out = cgutils.create_struct_proxy(kind)(context, builder)
        height, width = cgutils.unpack_tuple(builder, array.shape)
        single = builder.icmp_signed("==", height, ir.Constant(height.type, 1))
        count = {rows: width, table: height, either: builder.select(single, width, height)}[kind]
        out.data, out.count = array.data, count
        out.apart = builder.select(single, ir.Constant(width.type, 0), width)
        return out._getvalue()

    return signature(kind, values), lower


@intrinsic  # type: ignore[untyped-decorator]
def along(typingctx: Any, values: Any) -> Any:
    """Values of shape (8, n), a row for each lane, or (1, n), one for all."""
    return _viewed(values, rows)


@intrinsic  # type: ignore[untyped-decorator]
def shared_or_beside(typingctx: Any, values: Any) -> Any:
    """Values of shape (n, 8), lane beside lane, or (1, n), one for all."""
    return _viewed(values, either)


@intrinsic  # type: ignore[untyped-decorator]
def side_by_side(typingctx: Any, values: Any) -> Any:
    """Values of shape (n, 8), lane beside lane."""
    return _viewed(values, table)


def _address(builder: Any, kind: Places, array: Any, at: Any, lane: int = 0) -> Any:
    if kind is not rows:
        at = builder.mul(at, ir.Constant(at.type, WIDTH))
    else:
        at = builder.add(at, builder.mul(array.apart, ir.Constant(at.type, lane)))
    return builder.gep(array.data, [at])


def _load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0]
    array = cgutils.create_struct_proxy(kind)(context, builder, args[0])
    if kind is table:
        return _beside(builder, array, args[1])
    alike = builder.icmp_signed("==", array.apart, ir.Constant(array.apart.type, 0))
    with builder.if_else(alike) as (one_for_all, one_for_each):
        with one_for_all:
            same = _spread(builder, builder.load(builder.gep(array.data, [args[1]])))
            spread = builder.block
        with one_for_each:
            own = _beside(builder, array, args[1]) if kind is either else _gathered(builder, array, args[1])
            gathered = builder.block
    result = builder.phi(vector)
    result.add_incoming(same, spread)
    result.add_incoming(own, gathered)
    return result


def _beside(builder: Any, array: Any, at: Any) -> Any:
    """The lanes at a place of an array that has them beside each other."""
    return builder.load(builder.bitcast(_address(builder, table, array, at), vector.as_pointer()), align=8)


def _gathered(builder: Any, array: Any, at: Any) -> Any:
    """The same where each has a row of its own."""
    own = ir.Constant(vector, ir.Undefined)
    for lane in range(WIDTH):
        one = builder.load(_address(builder, rows, array, at, lane))
        own = builder.insert_element(own, one, ir.Constant(ir.IntType(32), lane))
    return own


def _store(context: Any, builder: Any, sig: Any, args: Any) -> None:
    kind = sig.args[0]
    array = cgutils.create_struct_proxy(kind)(context, builder, args[0])
    if kind is table:
        address = builder.bitcast(_address(builder, kind, array, args[1]), vector.as_pointer())
        builder.store(args[2], address, align=8)
        return
    for lane in range(WIDTH):
        one = builder.extract_element(args[2], ir.Constant(ir.IntType(32), lane))
        builder.store(one, _address(builder, kind, array, args[1], lane))


def _count(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return cgutils.create_struct_proxy(sig.args[0])(context, builder, args[0]).count


def _arrays() -> None:
    for kind in (rows, table, either):
        _typed(operator.getitem, signature(lanes, kind, types.intp))
        lower_builtin(operator.getitem, kind, types.intp)(_load)
        _typed(len, signature(types.intp, kind))
        lower_builtin(len, kind)(_count)
    for kind in (rows, table):
        _typed(operator.setitem, signature(types.none, kind, types.intp, lanes))
        lower_builtin(operator.setitem, kind, types.intp, lanes)(_store)


_arithmetic()
_functions()
_choices()
_arrays()
