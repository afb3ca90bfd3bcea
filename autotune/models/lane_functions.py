"""Functions of vectors of eight numbers, as instructions of the processor: e^x, x^y, sin and cos.

`exponential` is the routine of the C library (S. Nagy, ARM optimized routines, 2018) written for vectors: a table of
2^(i/128) and a polynomial. Sine, cosine and logarithm are those of fdlibm (Sun Microsystems, 1993) with a remainder of
π/2 by fused multiplications [cody-1980]; x^y is e^(y·log x). They differ from the C library's by the last digit; what
they do not reach (angles beyond `FARTHEST`, powers of what is negative or no number) is asked of it lane by lane.
"""

from __future__ import annotations

import decimal
import math
import struct
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils

WIDTH = 8
_TABLE_BITS = 7
_TABLE = 1 << _TABLE_BITS
FARTHEST = 1e8
"""Angle up to which the remainder of π/2 is exact to 1e-16."""

_double, _word = ir.DoubleType(), ir.IntType(64)
vector, _words = (ir.VectorType(t, WIDTH) for t in (_double, _word))


def each(value: float) -> Any:
    return ir.Constant(vector, [ir.Constant(_double, value)] * WIDTH)


def _each_word(value: int) -> Any:
    return ir.Constant(_words, [ir.Constant(_word, value)] * WIDTH)


def library(builder: Any, name: str, count: int) -> Any:
    kind = ir.FunctionType(vector, [vector] * count)
    return cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")


def one_by_one(builder: Any, name: str, *given: Any) -> Any:
    """A function of the C library, called for each lane that is not given the same as the one before it."""
    kind = ir.FunctionType(_double, [_double] * len(given))
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    result = ir.Constant(vector, ir.Undefined)
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


def any_lane(builder: Any, condition: Any) -> Any:
    word = ir.IntType(WIDTH)
    return builder.icmp_unsigned("!=", builder.bitcast(condition, word), ir.Constant(word, 0))


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


def _looked_up(builder: Any, at: Any) -> tuple[Any, Any]:
    """What the table of powers of two has at eight places, T and H: read as pairs, half as many reads."""
    pair = ir.VectorType(_word, 2)
    words = [
        ir.Constant(pair, [ir.Constant(_word, word) for word in both])
        for both in zip(_REST, _HEAD, strict=True)
    ]
    table = cgutils.global_constant(builder, "exp_table", ir.Constant(ir.ArrayType(pair, _TABLE), words))
    table.align = 16
    found = []
    for lane in range(WIDTH):
        index = builder.extract_element(at, ir.Constant(ir.IntType(32), lane))
        found.append(builder.load(builder.gep(table, [ir.Constant(_word, 0), index]), align=16))
    rest, head = (
        [_shuffled(builder, found[i], found[i + 1], [part, part + 2]) for i in range(0, WIDTH, 2)]
        for part in (0, 1)
    )
    return _one_after_another(builder, rest), _one_after_another(builder, head)


def _shuffled(builder: Any, one: Any, other: Any, places: list[int]) -> Any:
    """Numbers of two vectors, by their places in both together."""
    chosen = [ir.Constant(ir.IntType(32), place) for place in places]
    return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(ir.IntType(32), len(places)), chosen))


def _one_after_another(builder: Any, parts: list[Any]) -> Any:
    """One vector of several."""
    while len(parts) > 1:
        places = list(range(2 * parts[0].type.count))
        parts = [_shuffled(builder, parts[i], parts[i + 1], places) for i in range(0, len(parts), 2)]
    return parts[0]


def exponential(b: Any, x: Any) -> Any:
    """e^x: 0 below -708, infinite from 709 on, which the library is at -745 and 709.8."""
    fused = library(b, "fmuladd", 3)

    def add(one: Any, two: Any, three: Any) -> Any:
        return b.call(fused, [one, two, three])

    inside = b.and_(b.fcmp_ordered(">=", x, each(_LOWEST)), b.fcmp_ordered("<=", x, each(_HIGHEST)))
    near = b.select(inside, x, each(0.0))
    shifted = b.fadd(b.fmul(each(_INVERSE), near), each(_SHIFT))
    whole = b.bitcast(shifted, _words)
    steps = b.fsub(shifted, each(_SHIFT))
    r = add(steps, each(_NEGATIVE_LOW), add(steps, each(_NEGATIVE_HIGH), near))
    at = b.and_(whole, _each_word(_TABLE - 1))
    rest, head = _looked_up(b, at)
    tail = b.bitcast(rest, vector)
    head = b.add(head, b.shl(whole, _each_word(52 - _TABLE_BITS)))
    scale = b.bitcast(head, vector)
    square = b.fmul(r, r)
    total = add(square, add(r, each(_C3), each(_C2)), b.fadd(tail, r))
    total = add(b.fmul(square, square), add(r, each(_C5), each(_C4)), total)
    result = add(scale, total, scale)
    beyond = b.select(b.fcmp_ordered(">", x, each(0.0)), each(math.inf), each(0.0))
    beyond = b.select(b.fcmp_unordered("uno", x, x), x, beyond)
    return b.select(inside, result, beyond)


def _sum(b: Any, x: Any, *coefficients: float) -> Any:
    """A polynomial of x, its highest coefficient first."""
    fused, total = library(b, "fmuladd", 3), each(coefficients[0])
    for coefficient in coefficients[1:]:
        total = b.call(fused, [total, x, each(coefficient)])
    return total


def _unless(b: Any, beyond: Any, value: Any, otherwise: Callable[[], Any]) -> Any:
    """The value; where a condition holds in any lane, what is found `otherwise` in all of them."""
    begun = b.block
    with b.if_then(any_lane(b, beyond), likely=False):
        other = otherwise()
        ended = b.block
    found = b.phi(vector)
    found.add_incoming(value, begun)
    found.add_incoming(other, ended)
    return found


_HALF_TURN = math.pi / 2.0, float.fromhex("0x1.1a62633145c07p-54")
"""π/2 in two numbers."""
_SINE = (
    1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06,
    -1.98412698298579493134e-04, 8.33333333332248946124e-03, -1.66666666666666324348e-01,
)  # fmt: skip
_COSINE = (
    -1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07,
    2.48015872894767294178e-05, -1.38888888888741095749e-03, 4.16666666666666019037e-02,
)  # fmt: skip


def _quarter(b: Any, x: Any, quarters: int) -> Any:
    """sin(x + quarters·π/2)."""
    fused = library(b, "fma", 3)
    shifted = b.fadd(b.fmul(x, each(2.0 / math.pi)), each(_SHIFT))
    turns = b.fsub(shifted, each(_SHIFT))
    back = b.fneg(turns)
    near = b.call(fused, [back, each(_HALF_TURN[1]), b.call(fused, [back, each(_HALF_TURN[0]), x])])
    square = b.fmul(near, near)
    sine = b.fadd(near, b.fmul(b.fmul(near, square), _sum(b, square, *_SINE)))
    rest = b.fmul(b.fmul(square, square), _sum(b, square, *_COSINE))
    cosine = b.fadd(b.fsub(each(1.0), b.fmul(each(0.5), square)), rest)
    number = b.add(b.bitcast(shifted, _words), _each_word(quarters))
    odd = b.icmp_unsigned("!=", b.and_(number, _each_word(1)), _each_word(0))
    sign = b.shl(b.and_(number, _each_word(2)), _each_word(62))
    found = b.bitcast(b.select(odd, cosine, sine), _words)
    return b.bitcast(b.xor(found, sign), vector)


def _angular(name: str, quarters: int) -> Callable[[Any, Any], Any]:
    def lowered(b: Any, x: Any) -> Any:
        size = b.call(library(b, "fabs", 1), [x])
        beyond = b.fcmp_unordered(">", size, each(FARTHEST))
        return _unless(b, beyond, _quarter(b, x, quarters), lambda: one_by_one(b, name, x))

    return lowered


sine, cosine = _angular("sin", 0), _angular("cos", 1)

_LOGARITHM = (
    1.479819860511658591e-01, 1.531383769920937332e-01, 1.818357216161805012e-01, 2.222219843214978396e-01,
    2.857142874366239149e-01, 3.999999999940941908e-01, 6.666666666666735130e-01,
)  # fmt: skip
_LN_2 = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_ROOT_OF_HALF = 0x3FE6A09E667F3BCD
"""Bits of √½."""


def _logarithm(b: Any, x: Any) -> Any:
    """Natural logarithm of what is normal and above 0: x = 2^k·(1 + f), log(1 + f) of f/(2 + f)."""
    bits = b.bitcast(x, _words)
    power = b.ashr(b.sub(bits, _each_word(_ROOT_OF_HALF)), _each_word(52))
    f = b.fsub(b.bitcast(b.sub(bits, b.shl(power, _each_word(52))), vector), each(1.0))
    k = b.fsub(b.bitcast(b.add(power, b.bitcast(each(_SHIFT), _words)), vector), each(_SHIFT))
    s = b.fdiv(f, b.fadd(each(2.0), f))
    square, half = b.fmul(s, s), b.fmul(b.fmul(each(0.5), f), f)
    rest = b.fmul(square, _sum(b, square, *_LOGARITHM))
    small = b.fadd(b.fmul(s, b.fadd(half, rest)), b.fmul(k, each(_LN_2[1])))
    return b.fsub(b.fmul(k, each(_LN_2[0])), b.fsub(b.fsub(half, small), f))


def power(b: Any, x: Any, y: Any) -> Any:
    """x^y; of 0 too, by the sign of y."""
    zero = b.fcmp_ordered("==", x, each(0.0))
    usual = b.and_(b.fcmp_ordered(">=", x, each(2.0**-1022)), b.fcmp_ordered("<", x, each(math.inf)))
    usual = b.and_(b.or_(usual, zero), b.fcmp_ordered("<", b.call(library(b, "fabs", 1), [y]), each(1e300)))
    one = b.select(zero, each(1.0), x)
    found = exponential(b, b.fmul(y, _logarithm(b, one)))
    of_zero = b.select(b.fcmp_ordered(">", y, each(0.0)), each(0.0), each(math.inf))
    of_zero = b.select(b.fcmp_ordered("==", y, each(0.0)), each(1.0), of_zero)
    found = b.select(zero, of_zero, found)
    return _unless(b, b.not_(usual), found, lambda: one_by_one(b, "pow", x, y))
