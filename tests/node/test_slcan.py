"""The adapter's protocol."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune_sim.slcan import SlcanAdapter


class Bus:
    def __init__(self) -> None:
        self.frames: list[tuple[int, bytes]] = []
        self.adapter = SlcanAdapter(lambda cob_id, data: self.frames.append((cob_id, data)), lambda: 12.345)

    def say(self, text: bytes) -> bytes:
        self.adapter.output.clear()
        self.adapter.feed(text)
        return bytes(self.adapter.output)


@pytest.fixture
def bus() -> Bus:
    return Bus()


@pytest.fixture
def opened(bus: Bus) -> Bus:
    assert bus.say(b"C\rS8\r") == b"\r\r"
    assert bus.say(b"O\r") == b"\r"
    return bus


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (b"\r", b"\r"),
        (b"V\r", b"V1013\r"),
        (b"N\r", b"NA402\r"),
        (b"F\r", b"\a"),  # only with the channel open
        (b"O\r", b"\a"),  # no bit rate yet
        (b"S9\r", b"\a"),
        (b"S\r", b"\a"),
        (b"Z1\r", b"\r"),
        (b"Z2\r", b"\a"),
        (b"s0014\r", b"\r"),
        (b"t1230\r", b"\a"),
        (b"x\r", b"\a"),
        (b"\xff\xfe\r", b"\a"),
    ],
)
def test_closed(bus: Bus, command: bytes, answer: bytes) -> None:
    assert bus.say(command) == answer


@pytest.mark.parametrize(
    ("command", "answer", "frames"),
    [
        (b"t1232AABB\r", b"z\r", [(0x123, b"\xaa\xbb")]),
        (b"t0800\r", b"z\r", [(0x80, b"")]),
        (b"t7FF80102030405060708\r", b"z\r", [(0x7FF, bytes(range(1, 9)))]),
        (b"t1232aabb\r", b"z\r", [(0x123, b"\xaa\xbb")]),
        (b"T2FFFFFFF0\r", b"\a", []),
        (b"T012345671\r", b"\a", []),
        (b"T0123456712A\r", b"Z\r", []),
        (b"r1230\r", b"z\r", []),
        (b"R012345670\r", b"Z\r", []),
        (b"t8000\r", b"\a", []),
        (b"t1239\r", b"\a", []),
        (b"t1232AAB\r", b"\a", []),
        (b"t1232AABBCC\r", b"\a", []),
        (b"t12G0\r", b"\a", []),
        (b"S8\r", b"\a", []),
        (b"O\r", b"\a", []),
        (b"F\r", b"F00\r", []),
        (b"C\r", b"\r", []),
    ],
)
def test_open(opened: Bus, command: bytes, answer: bytes, frames: list[tuple[int, bytes]]) -> None:
    assert opened.say(command) == answer
    assert opened.frames == frames


def test_listens_only(bus: Bus) -> None:
    assert bus.say(b"S8\rL\r") == b"\r"
    assert bus.say(b"t1230\r") == b"\a"
    bus.adapter.transmit(0x181, b"\x01")
    assert bytes(bus.adapter.output) == b"\at181101\r"


def test_another_bit_rate_than_the_bus(bus: Bus) -> None:
    assert bus.say(b"S6\rO\r") == b"\r"
    assert bus.say(b"t1230\r") == b"\a"
    assert bus.frames == []
    assert bus.say(b"F\r") == b"F80\r"
    assert bus.say(b"F\r") == b"F00\r"
    bus.adapter.transmit(0x181, b"")
    assert b"t181" not in bus.adapter.output


def test_bit_timing_registers(bus: Bus) -> None:
    assert bus.say(b"s0014\rO\r") == b"\r"  # 8 MHz, 8 quanta: 1 Mbit/s
    assert bus.say(b"t0800\r") == b"z\r"


def test_frames_to_the_host_with_time_stamps(bus: Bus) -> None:
    bus.say(b"S8\rZ1\rO\r")
    bus.adapter.output.clear()
    bus.adapter.transmit(0x185, b"\x12\xab")
    assert bytes(bus.adapter.output) == b"t185212AB%04X\r" % 12345


def test_nothing_reaches_a_closed_channel(bus: Bus) -> None:
    bus.adapter.transmit(0x185, b"\x12")
    assert not bus.adapter.output


def test_opening_throws_away_what_is_stale(opened: Bus) -> None:
    opened.adapter.transmit(0x185, b"\x12")
    flushed = []
    opened.adapter.flush = lambda: flushed.append(True)
    opened.adapter.feed(b"C\rO\r")
    assert bytes(opened.adapter.output) == b"\r"
    assert flushed == [True]


def test_a_host_that_does_not_read_loses_frames_only(opened: Bus) -> None:
    for _ in range(20_000):
        opened.adapter.transmit(0x185, bytes(8))
    assert len(opened.adapter.output) < 300_000
    assert opened.say(b"F\r") == b"F01\r"


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8))), st.integers(1, 9))
def test_frames_in_any_pieces(frames: list[tuple[int, bytes]], size: int) -> None:
    bus = Bus()
    bus.say(b"S8\rO\r")
    text = b"".join(b"t%03X%d%s\r" % (i, len(d), d.hex().encode()) for i, d in frames)
    for start in range(0, len(text), size):
        bus.adapter.feed(text[start : start + size])
    assert bus.frames == frames


@given(st.binary(max_size=200))
def test_no_input_brings_it_down(data: bytes) -> None:
    bus = Bus()
    bus.say(b"S8\rO\r")
    bus.adapter.feed(data)
    bus.adapter.feed(b"\r")
    bus.adapter.feed(b"C\rS8\rO\r")
    bus.frames.clear()
    assert bus.say(b"t0800\r") == b"z\r"
    assert bus.frames == [(0x80, b"")]
