"""The fdcanusb line: checksums as moteus has them, any frame there and back, nothing that loses its place."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune_drivers.moteus.line import LONGEST_FRAME, LineReader, crc8, encode, padded

FRAME = st.binary(max_size=LONGEST_FRAME)
FUZZED_BYTES = 1_000_000
GOOD = b"rcv 00000100 21000a2f010000003f0000000000000000"


def checked(line: bytes) -> bytes:
    text = line + b" "
    return text + b"*%02X" % crc8(text)


def read(data: bytes, demands: bool = False) -> list[tuple[str, int, bytes]]:
    reader = LineReader()
    reader.demands_checksums = demands
    return [line[:3] for line in reader.feed(data)]


@given(st.binary(max_size=200))
def test_the_checksum_is_that_of_the_moteus_package(data: bytes) -> None:
    fdcanusb = pytest.importorskip("moteus.fdcanusb_device", reason="the moteus package is not installed")
    assert crc8(data) == fdcanusb._compute_crc8(data)


@given(FRAME, st.integers(0, 0x7F), st.booleans())
def test_a_command_says_what_the_moteus_package_would_say(data: bytes, node: int, check: bool) -> None:
    fdcanusb = pytest.importorskip("moteus.fdcanusb_device", reason="the moteus package is not installed")
    line = encode(0x8000 | node, data, check).rstrip(b"\n")
    content, had, right = fdcanusb._strip_and_validate_checksum(line)
    assert (had, right) == (check, check)
    words = content.split(b" ")
    assert words[:2] == [b"can", b"send"]
    assert int(words[2], 16) == 0x8000 | node
    sent = bytes.fromhex(words[3].decode()) if len(words) > 3 else b""
    assert sent[: len(data)] == data
    assert set(sent[len(data) :]) <= {0x50}


@given(FRAME)
def test_padding_gives_lengths_that_can_fd_has(data: bytes) -> None:
    assert len(padded(data)) in {*range(9), 12, 16, 20, 24, 32, 48, 64}
    assert padded(data).startswith(data)
    with pytest.raises(ValueError, match="65"):
        padded(bytes(65))


@given(
    FRAME,
    st.integers(0, 0x1FFFFFFF),
    st.booleans(),
    st.integers(0, 200),
    st.sampled_from(["", " E B F", " eBF t123 f2"]),
)
def test_a_frame_is_read_whatever_its_flags_and_however_it_is_cut(
    data: bytes, identifier: int, check: bool, cut: int, flags: str
) -> None:
    line = b"rcv %x %s%s" % (identifier, data.hex().encode(), flags.encode())
    text = (checked(line) if check else line) + b"\r\n"
    reader = LineReader()
    found = [*reader.feed(text[:cut]), *reader.feed(text[cut:])]
    assert [(line.kind, line.identifier, line.data, line.checked) for line in found] == [
        ("rcv", identifier, data, check)
    ]
    assert reader.garbled == 0


@given(st.integers(0, len(checked(GOOD)) - 1), st.integers(1, 255))
def test_a_changed_byte_is_seen_by_the_checksum(at: int, change: int) -> None:
    line = bytearray(checked(GOOD))
    line[at] ^= change
    changed = bytes(line)
    same = changed.upper().replace(b" ", b"") == checked(GOOD).upper().replace(b" ", b"")
    found = read(changed + b"\n", demands=True)
    # CRC-8 misses no change of a single byte; hexadecimal letters may change their case in the checksum
    assert same or all(
        frame[2] == bytes.fromhex(GOOD.split()[2].decode()) for frame in found if frame[0] == "rcv"
    )


def test_lines_without_checksum_are_not_believed_where_one_is_demanded() -> None:
    assert read(GOOD + b"\nOK\n", demands=True) == []
    assert [kind for kind, *_ in read(checked(GOOD) + b"\n" + checked(b"OK") + b"\n", demands=True)] == [
        "rcv",
        "OK",
    ]


@pytest.mark.parametrize(
    "garbage", [b"rcv 100 210", b"\x00\xff*", b"OK rcv 100 ", b"ERR ", b"rcv 100 2100 ", b"*AB"]
)
@pytest.mark.parametrize("demands", [True, False])
def test_a_half_line_does_not_take_the_next_frame_with_it(garbage: bytes, demands: bool) -> None:
    good = checked(GOOD) if demands else GOOD
    frames = [frame for frame in read(garbage + good + b"\r\n", demands) if frame[0] == "rcv"]
    assert frames == [("rcv", 0x100, bytes.fromhex(GOOD.split()[2].decode()))]


def mutated(chance: random.Random) -> bytes:
    """Garbage of every sort: noise, half lines, changed lines, lines without an end."""
    sort = chance.randrange(4)
    if sort == 0:
        return chance.randbytes(chance.randrange(1, 600))
    line = bytearray(checked(GOOD) + b"\r\n")
    if sort == 1:
        return bytes(line[: chance.randrange(1, len(line))])
    if sort == 2:
        line[chance.randrange(len(line))] = chance.randrange(256)
        return bytes(line)
    return bytes(line[chance.randrange(1, len(line)) :]) + chance.randbytes(3) * chance.randrange(1, 300)


def test_a_million_fuzzed_bytes_and_the_next_good_frame_is_always_found() -> None:
    chance = random.Random(20)
    reader = LineReader()
    reader.demands_checksums = True
    fuzzed = number = 0
    while fuzzed < FUZZED_BYTES:
        garbage = mutated(chance)
        payload = b"\x21\x00" + number.to_bytes(4, "little")
        frame = checked(b"rcv 100 " + payload.hex().encode()) + b"\r\n"
        found = reader.feed(garbage + frame)
        assert ("rcv", 0x100, payload) in [line[:3] for line in found], garbage
        fuzzed += len(garbage)
        number += 1
    assert number > 1000
