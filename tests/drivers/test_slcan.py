"""The slcan adapter: every byte sequence is survived, every whole frame is found."""

from __future__ import annotations

import os
import pty
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass

import can
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autotune.core.errors import LinkError
from autotune_drivers.canopen.frames import BusLink, Frame
from autotune_drivers.canopen.slcan import SlcanBus, SlcanLink, encode

frames = st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8))


@dataclass
class Adapter:
    """The far end of a pseudo-terminal, with a bus on the near one."""

    master: int
    bus: SlcanBus

    def receive(self, data: bytes, wanted: int) -> list[Frame]:
        """Feeds bytes to the bus; the frames that it finds."""
        found: list[Frame] = []
        while data:
            data = data[os.write(self.master, data[:1000]) :]
            found += self.bus.receive_frames(0.2)
        end = time.monotonic() + 1.0
        while len(found) < wanted and time.monotonic() < end:
            found += self.bus.receive_frames(0.05)
        return found


@pytest.fixture(scope="module")
def adapter() -> Iterator[Adapter]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    bus = SlcanBus(os.ttyname(slave), 1000000)
    yield Adapter(master, bus)
    bus.shutdown()
    os.close(slave)
    os.close(master)


def test_opens_at_the_bit_rate_asked_for() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    bus = SlcanBus(os.ttyname(slave), 500000)
    sent = b""
    while not sent.endswith(b"O\rO\r"):
        sent += os.read(master, 1000)
    bus.shutdown()
    os.close(slave)
    os.close(master)
    assert b"S6\r" in sent
    assert sent.index(b"S6\r") < sent.index(b"O\r")


def test_encodes_as_lawicel_says() -> None:
    assert encode(0x605, bytes.fromhex("40001000000000ab")) == b"t605840001000000000AB\r"
    assert encode(0x80, b"") == b"t0800\r"


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(frames, min_size=1, max_size=20))
def test_frames_arrive_in_order(adapter: Adapter, sent: list[Frame]) -> None:
    data = b"".join(encode(*frame) for frame in sent)
    assert adapter.receive(data, len(sent)) == sent


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.one_of(st.binary(max_size=40), frames), max_size=15), frames)
def test_the_next_whole_frame_after_garbage_is_found(
    adapter: Adapter, pieces: list[bytes | Frame], last: Frame
) -> None:
    data = b"".join(piece if isinstance(piece, bytes) else encode(*piece) for piece in pieces)
    found = adapter.receive(data + b"\r" + encode(*last), 1)
    while found and found[-1] != last and (more := adapter.bus.receive_frames(0.05)):
        found += more
    assert found[-1] == last
    assert all(0 <= number <= 0x7FF and len(content) <= 8 for number, content in found)


def test_time_stamps_acknowledgements_and_bells_are_no_frames(adapter: Adapter) -> None:
    errors, answers = adapter.bus.errors, adapter.bus.answers
    data = b"z\r\at0851A0\rt0852AABB1234\r\rT000000051AA\rr0851\r"
    assert adapter.receive(data, 2) == [(0x085, b"\xa0"), (0x085, b"\xaa\xbb")]
    assert adapter.bus.errors == errors + 1
    assert adapter.bus.answers == answers + 2


def test_frames_in_pieces_are_put_together(adapter: Adapter) -> None:
    os.write(adapter.master, b"t0852A")
    assert adapter.bus.receive_frames(0.1) == []
    os.write(adapter.master, b"ABB\rt08")
    assert adapter.bus.receive_frames(0.1) == [(0x085, b"\xaa\xbb")]
    os.write(adapter.master, b"50\r")
    assert adapter.bus.receive_frames(0.1) == [(0x085, b"")]


def test_is_still_a_python_can_bus(adapter: Adapter) -> None:
    os.write(adapter.master, encode(0x185, b"\1\2") + encode(0x285, b"\3"))
    messages = [adapter.bus.recv(1.0), adapter.bus.recv(1.0)]
    assert [(m.arbitration_id, bytes(m.data)) for m in messages if m] == [(0x185, b"\1\2"), (0x285, b"\3")]
    assert adapter.bus.recv(0.01) is None


def test_sends_all_frames_at_once() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    bus = SlcanBus(os.ttyname(slave), 1000000)
    sent = b""
    bus.send_frames((0x205, b"\x0f\0"), (0x80, b""))
    while not sent.endswith(b"t0800\r"):
        sent += os.read(master, 1000)
    assert sent.endswith(b"O\rt20520F00\rt0800\r")
    bus.shutdown()
    os.close(slave)
    os.close(master)


def test_a_hang_up_is_an_error_in_words() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    link = SlcanLink(SlcanBus(name, 1000000), name, os.dup(slave))
    os.close(slave)
    os.close(master)
    with pytest.raises(LinkError, match="unplugged"):
        link.receive(0.1)
    with pytest.raises(LinkError, match="unplugged"):
        link.send((0x80, b""))
    link.close()
    link.close()


def test_any_python_can_bus_is_a_link() -> None:
    ours = BusLink(can.Bus(interface="virtual", channel="autotune-test"), "virtual")
    with can.Bus(interface="virtual", channel="autotune-test") as other:
        ours.send((0x605, b"\1"), (0x80, b""))
        received = [other.recv(1.0), other.recv(1.0)]
        assert [(m.arbitration_id, bytes(m.data)) for m in received if m] == [(0x605, b"\1"), (0x80, b"")]
        other.send(can.Message(arbitration_id=0x585, data=b"\2", is_extended_id=False))
        other.send(can.Message(arbitration_id=0x12345, data=b"\2", is_extended_id=True))
        assert ours.receive(1.0) == [(0x585, b"\2")]
    assert ours.receive(0.0) == []
    ours.close()
    ours.close()


@pytest.mark.parametrize(
    "line",
    [
        b"t-800",  # no sign is a digit
        b"t+8000",
        b"t 800",
        b"tFFF0",  # beyond eleven bits
        b"t1852AABB0",  # a digit too many
        b"t1853AABB0C0",
        b"t1852AAB",
        b"t1859" + b"00" * 9,
    ],
)
def test_a_line_that_has_gained_or_lost_a_digit_is_no_frame(adapter: Adapter, line: bytes) -> None:
    """Anything that is nearly a frame would be a wrong measurement."""
    assert adapter.receive(line + b"\r" + encode(0x185, b"\x01"), 1) == [(0x185, b"\x01")]
