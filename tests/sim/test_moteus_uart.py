"""The simulated controller's serial line and frames: garbage never stops it, and the next command is obeyed."""

from __future__ import annotations

import random
import struct
import termios

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.paths import config_directory
from autotune_sim.memory import Memory
from autotune_sim.moteus_device import MoteusDevice
from autotune_sim.moteus_frames import (
    FLOAT,
    INT8,
    INT16,
    INT32,
    Read,
    Stream,
    Write,
    decode,
    encode,
    head,
    subframes,
)
from autotune_sim.moteus_uart import SPEED, UartServer, crc8
from autotune_sim.presets import preset
from autotune_sim.servo import Servo

FUZZED_BYTES = 200_000


def checked(line: bytes) -> bytes:
    return line + b" *%02X\n" % crc8(line + b" ")


def uart(speed: int = SPEED) -> tuple[UartServer, list[tuple[int, bytes]]]:
    frames: list[tuple[int, bytes]] = []
    return UartServer(lambda *frame: frames.append(frame), lambda: speed), frames


def device() -> tuple[MoteusDevice, list[tuple[int, bytes]]]:
    sent: list[tuple[int, bytes]] = []
    eds = config_directory() / "eds" / "autotune-sim.eds"
    made = MoteusDevice(
        Servo(preset("frictionless")),
        eds,
        1,
        lambda *frame: sent.append(frame),
        Memory(None, lambda _: None),
        lambda _: None,
    )
    made.poll(0.0)
    return made, sent


def test_commands_are_acknowledged_and_delivered() -> None:
    line, frames = uart()
    line.feed(b"can send 8001 1100\r\ncan send 8002 50 bF\n")
    assert frames == [(0x8001, b"\x11\x00"), (0x8002, b"\x50")]
    assert bytes(line.output) == b"OK\r\nOK\r\n"
    line.transmit(0x100, b"\x21\x00\x0a")
    assert bytes(line.output).endswith(b"rcv 00000100 21000a\r\n")


def test_after_the_first_checksum_every_line_needs_one() -> None:
    line, frames = uart()
    line.feed(checked(b"can send 8001 1100"))
    line.feed(b"can send 8001 1100\n")
    assert len(frames) == 1
    answers = bytes(line.output).split(b"\r\n")
    assert answers[0].startswith(b"OK *")
    assert answers[1].startswith(b"ERR checksum *")
    line.reset()
    line.feed(b"can send 8001 1100\n")
    assert bytes(line.output) == b"OK\r\n"


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        (b"can send", b"ERR unknown command"),
        (b"can send 8001 1", b"ERR malformed data"),
        (b"can send xyz 11", b"ERR malformed data"),
        (b"hello", b"ERR unknown command"),
    ],
)
def test_what_is_no_command_is_refused(text: bytes, answer: bytes) -> None:
    line, frames = uart()
    line.feed(text + b"\n")
    assert bytes(line.output) == answer + b"\r\n"
    assert frames == []


def test_a_wrong_speed_is_garbage_both_ways() -> None:
    line, frames = uart(termios.B115200)
    line.feed(b"can send 8001 1100\n")
    assert frames == []
    assert line.output
    assert not any(byte in b"OKERcan \r\n" for byte in line.output)


def test_fuzzed_lines_never_stop_the_controller() -> None:
    chance = random.Random(7)
    made, sent = device()
    made.poll(1.0)
    line = UartServer(lambda cob_id, data: made.receive(cob_id, data, 1.0), lambda: SPEED)
    query = checked(b"can send 8001 1100")
    line.feed(query)
    fuzzed = 0
    while fuzzed < FUZZED_BYTES:
        noise = chance.randbytes(chance.randrange(1, 300))
        frame = bytes((chance.randrange(0x52),)) + chance.randbytes(chance.randrange(64))
        for text in (noise + b"\n", checked(b"can send 8001 " + frame.hex().encode())):
            line.feed(text)
            fuzzed += len(text)
        sent.clear()
        line.feed(checked(b"can send 8001 010000") + query)
        assert [reply for _, reply in sent][-1][:2] == b"\x21\x00"
        line.output.clear()


@given(st.binary(max_size=64))
def test_any_bytes_are_read_as_far_as_they_make_sense(data: bytes) -> None:
    for subframe in subframes(data):
        assert isinstance(subframe, Write | Read | Stream)
        if isinstance(subframe, Read) and subframe.number > 1000:
            break


@given(
    st.sampled_from(["position", "torque", "time", "scale"]),
    st.sampled_from([INT8, INT16, INT32]),
    st.floats(-0.9, 0.9),
)
def test_values_come_back_within_a_step(kind: str, form: int, value: float) -> None:
    packer = struct.Struct(("<b", "<h", "<i")[form])
    step = abs(decode(kind, form, 1))
    assert decode(kind, form, packer.unpack(encode(kind, form, value))[0]) == pytest.approx(value, abs=step)


@given(st.integers(1, 20), st.integers(0, 0x300))
def test_reads_say_which_registers(number: int, start: int) -> None:
    (found,) = subframes(head(0x10, FLOAT, start, number))
    assert found == Read(FLOAT, start, number)
