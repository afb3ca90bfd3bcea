"""Multiplex frames: any value there and back within its step, and the moteus package reads the same."""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune_drivers.moteus.multiplex import (
    ACCELERATION,
    CURRENT,
    INTEGER,
    KINDS,
    POSITION,
    SCALE,
    TEMPERATURE,
    TIME,
    TORQUE,
    VELOCITY,
    VOLTAGE,
    Form,
    Kind,
    decode_value,
    encode_value,
    parse,
    read,
    reply_head,
    stream_data,
    stream_poll,
    varuint,
    write,
)

RAW = ("<b", "<h", "<i", "<f")
HIGHEST = (127, 32767, 2147483647)
SCALED = [POSITION, VELOCITY, ACCELERATION, TORQUE, CURRENT, VOLTAGE, TEMPERATURE, TIME, SCALE]
FORMS = st.sampled_from(Form)
FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False)
REGISTERS = st.sampled_from([*KINDS, 0x000, 0x00F, 0x120])


def back(kind: Kind, form: Form, value: float) -> float:
    return decode_value(kind, form, struct.unpack(RAW[form], encode_value(kind, form, value))[0])


@given(st.sampled_from(SCALED), st.sampled_from([Form.INT8, Form.INT16, Form.INT32]), st.floats(-1.0, 1.0))
def test_a_value_comes_back_within_half_a_step(kind: Kind, form: Form, share: float) -> None:
    value = share * kind[form] * HIGHEST[form]
    assert back(kind, form, value) == pytest.approx(value, abs=0.5 * kind[form] * (1 + 1e-6))


@given(st.sampled_from(SCALED), FORMS)
def test_what_does_not_fit_is_limited_and_nan_stays_nan(kind: Kind, form: Form) -> None:
    assert math.isnan(back(kind, form, math.nan))
    if form is not Form.FLOAT:
        assert back(kind, form, 1e12) == pytest.approx(kind[form] * HIGHEST[form])
        assert back(kind, form, -1e12) == pytest.approx(-kind[form] * HIGHEST[form])


@given(FLOATS, st.integers(-128, 127))
def test_floats_and_whole_numbers_are_exact(value: float, whole: int) -> None:
    assert back(POSITION, Form.FLOAT, value) == value
    assert back(INTEGER, Form.INT8, max(whole, -127)) == max(whole, -127)


@given(st.integers(0, 0xFFFFFFFF))
def test_varuints_are_those_of_the_moteus_package(value: int) -> None:
    multiplex = pytest.importorskip("moteus.multiplex", reason="the moteus package is not installed")
    assert multiplex.read_varuint(0, varuint(value)) == (value, len(varuint(value)))


@given(FORMS, REGISTERS, st.lists(FLOATS.filter(lambda v: abs(v) < 100), min_size=1, max_size=8))
def test_the_moteus_package_reads_what_we_write(form: Form, register: int, values: Sequence[float]) -> None:
    multiplex = pytest.importorskip("moteus.multiplex", reason="the moteus package is not installed")
    protocol = pytest.importorskip("moteus.protocol", reason="the moteus package is not installed")
    frame = write(form, register, values) + read(form, register, len(values))
    found = protocol.parse_registers(frame)
    assert list(found.query) == [(register + k, form) for k in range(len(values))]
    assert not found.errors
    raw = [s.value for s in multiplex.parse_frame(frame) if s.type is multiplex.SubframeType.WRITE]
    kinds = [KINDS.get(register + k, INTEGER) for k in range(len(values))]
    expected = [encode_value(kind, form, value) for kind, value in zip(kinds, values, strict=True)]
    assert [struct.pack(RAW[form], value) for value in raw] == expected


@given(FORMS, st.sampled_from(list(KINDS)), st.floats(-1.0, 1.0))
def test_we_read_what_the_moteus_package_writes(form: Form, register: int, share: float) -> None:
    protocol = pytest.importorskip("moteus.protocol", reason="the moteus package is not installed")
    multiplex = pytest.importorskip("moteus.multiplex", reason="the moteus package is not installed")
    kind = KINDS[register]
    step = kind[form] if form is not Form.FLOAT else 0.0
    value = share * (100 * step or 1.0)
    buffer = io.BytesIO(reply_head(form, register))
    buffer.seek(0, io.SEEK_END)
    writer = protocol.Writer(buffer)
    writer.write_mapped(value, *kind, form)
    assert parse(buffer.getvalue()).values[register] == pytest.approx(value, abs=step + 1e-7)
    assert multiplex.INT8 == Form.INT8


@given(st.binary(max_size=64))
def test_any_bytes_are_read_as_far_as_they_make_sense(data: bytes) -> None:
    reply = parse(data)
    assert all(isinstance(value, int | float) for value in reply.values.values())


@given(st.binary(max_size=20), FORMS, st.integers(0, 0x200), st.lists(FLOATS, min_size=1, max_size=5))
def test_what_was_understood_stays_when_the_rest_is_garbage(
    garbage: bytes, form: Form, register: int, values: Sequence[float]
) -> None:
    data = reply_head(Form.FLOAT, register, len(values)) + struct.pack(f"<{len(values)}f", *values)
    found = parse(data + b"\x3f" + garbage).values
    assert [found[register + k] for k in range(len(values))] == list(values)


def test_errors_and_the_stream_are_told_apart() -> None:
    reply = parse(b"\x21\x00\x0a" + b"\x31\x38\x01" + b"\x43\x01\x07\x03abc" + b"\x50\x50")
    assert reply.values == {0: 10}
    assert reply.errors == {0x38: 1}
    assert (reply.stream, reply.packet) == (b"abc", 7)
    assert parse(b"\x41\x01\x02OK") == ({}, {}, b"OK", None)


def test_the_example_of_the_manual() -> None:
    """`can send 8001 01000a07206000200150ff140400130d` and its answer, value by value."""
    frame = (
        write(Form.INT8, 0x000, [10])
        + write(Form.INT16, 0x020, [0.0096, 0.072, -1.76])
        + read(Form.INT16, 0x000, 4)
        + read(Form.INT8, 0x00D, 3)
    )
    assert frame.hex() == "01000a07206000200150ff140400130d"
    values = parse(bytes.fromhex("2404000a005000000170ff230d181400")).values
    assert values[0x000] == 10
    assert values[0x001] == pytest.approx(0.008)
    assert values[0x002] == pytest.approx(0.064)
    assert values[0x003] == pytest.approx(-1.44)
    assert (values[0x00D], values[0x00E], values[0x00F]) == (12.0, 20.0, 0)


@given(st.binary(max_size=61))
def test_the_stream_is_framed_as_the_moteus_package_frames_it(data: bytes) -> None:
    multiplex = pytest.importorskip("moteus.multiplex", reason="the moteus package is not installed")
    (sent,) = multiplex.parse_frame(stream_data(data))
    assert (sent.channel, sent.data) == (1, data)
    (poll,) = multiplex.parse_frame(stream_poll(48))
    assert poll.data == b"\x30"
    (flow,) = multiplex.parse_frame(stream_poll(48, 200))
    assert (flow.packet_number, flow.data) == (200, b"\x30")
