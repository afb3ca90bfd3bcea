"""SDO transfers as bytes on the wire."""

from __future__ import annotations

import struct
from binascii import crc_hqx
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune_sim.aborts import AbortCode
from autotune_sim.sdo_block import BlockDownload, BlockUpload
from tests.node.support import Bench, Refused


def test_expedited_and_segmented_upload(bench: Bench) -> None:
    assert bench.upload(0x1000) == bytes.fromhex("92010200")
    assert bench.upload(0x1008) == b"autotune-sim"
    assert bench.upload(0x100A) == b"1.0.0"


def test_expedited_download(bench: Bench) -> None:
    bench.put(0x2100, 7, 31.5)
    assert bench.get(0x2100, 7) == 31.5
    assert bench.device.firmware.servo.parameters["feedforward.stiffness"] == 31.5


def test_segmented_download(bench: Bench) -> None:
    bench.request(struct.pack("<BHBI", 0x21, 0x2100, 9, 4))
    answer = bench.request(bytes((0x07,)) + struct.pack("<f", 0.25))
    assert answer[0] == 0x20
    assert bench.get(0x2100, 9) == 0.25


@pytest.mark.parametrize(
    ("request_bytes", "code"),
    [
        (struct.pack("<BHB", 0x40, 0x5FFF, 0), AbortCode.NO_OBJECT),
        (struct.pack("<BHB", 0x40, 0x1018, 9), AbortCode.NO_SUBINDEX),
        (struct.pack("<BHBI", 0x23, 0x1000, 0, 1), AbortCode.READ_ONLY),
        (struct.pack("<BHBH", 0x2B, 0x1005, 0, 1), AbortCode.TOO_SHORT),
        (struct.pack("<BHBI", 0x23, 0x1017, 0, 1), AbortCode.TOO_LONG),
        (struct.pack("<BHBI", 0x21, 0x2000, 1, 8), AbortCode.TOO_LONG),
        (struct.pack("<BHBI", 0x21, 0x2000, 1, 2), AbortCode.TOO_SHORT),
        (struct.pack("<BHBf", 0x23, 0x2000, 1, -1.0), AbortCode.TOO_LOW),
        (struct.pack("<BHBf", 0x23, 0x2000, 1, 1e9), AbortCode.TOO_HIGH),
        (struct.pack("<BHBf", 0x23, 0x2000, 1, float("nan")), AbortCode.RANGE),
        (struct.pack("<BHBb", 0x2F, 0x6060, 0, 7), AbortCode.RANGE),
        (struct.pack("<BHBI", 0x23, 0x1010, 1, 0x12345678), AbortCode.STORE),
        (struct.pack("<BHB", 0x40, 0x1003, 1), AbortCode.NO_DATA),
        (bytes((0xE0,)), AbortCode.COMMAND),
        (bytes((0x60,)), AbortCode.COMMAND),
        (struct.pack("<BHBB", 0xA4, 0x1008, 0, 0), AbortCode.BLOCK_SIZE),
        (struct.pack("<BHBB", 0xA4, 0x1008, 0, 128), AbortCode.BLOCK_SIZE),
    ],
)
def test_what_is_refused_and_why(bench: Bench, request_bytes: bytes, code: int) -> None:
    with pytest.raises(Refused) as refused:
        bench.request(request_bytes)
    assert refused.value.code == code


def test_toggle_that_does_not_alternate(bench: Bench) -> None:
    bench.request(struct.pack("<BHB", 0x40, 0x1008, 0))
    bench.request(b"\x60")
    with pytest.raises(Refused) as refused:
        bench.request(b"\x60")
    assert refused.value.code == AbortCode.TOGGLE


def test_an_abort_ends_the_transfer(bench: Bench) -> None:
    bench.request(struct.pack("<BHB", 0x40, 0x1008, 0))
    bench.send(0x605, struct.pack("<BHBI", 0x80, 0x1008, 0, 0x05040000))
    with pytest.raises(Refused) as refused:
        bench.request(b"\x60")
    assert refused.value.code == AbortCode.COMMAND


def test_a_refused_write_changes_nothing(bench: Bench) -> None:
    before = bench.get(0x2000, 1)
    with pytest.raises(Refused):
        bench.put(0x2000, 1, 1e9)
    assert bench.get(0x2000, 1) == before


def test_no_answer_while_stopped(bench: Bench) -> None:
    bench.nmt(2)
    bench.send(0x605, struct.pack("<BHBI", 0x40, 0x1000, 0, 0))
    assert bench.take(0x585) == []


def test_block_upload_over_the_bench(bench: Bench) -> None:
    answer = bench.request(struct.pack("<BHBBB", 0xA4, 0x1008, 0, 1, 0))
    assert answer[0] == 0xC6
    assert struct.unpack_from("<I", answer, 4)[0] == 12
    first = bench.request(b"\xa3")
    assert first[0] == 1
    second = bench.request(bytes((0xA2, 1, 1)))
    assert second[0] == 0x81
    end = bench.request(bytes((0xA2, 1, 1)))
    assert (first[1:] + second[1:])[:12] == b"autotune-sim"
    assert end[0] == 0xC1 | 2 << 2
    assert end[1] | end[2] << 8 == crc_hqx(b"autotune-sim", 0)
    bench.send(0x605, b"\xa1" + bytes(7))
    assert bench.take(0x585) == []


@given(st.integers(0, 3000), st.integers(1, 127), st.integers(0, 2**32))
def test_block_upload_survives_lost_segments(length: int, size: int, seed: int) -> None:
    random = Random(seed)
    content = random.randbytes(length)
    server = BlockUpload(content, size, True)
    received = b""
    frames = server.answer(b"\xa3")
    done = False
    while not done:
        kept = random.randint(0, len(frames)) if random.random() < 0.3 else len(frames)
        for frame in frames[:kept]:
            received += frame[1:]
            done = bool(frame[0] & 0x80)
        frames = server.answer(bytes((0xA2, kept, size)))
    end = frames[0]
    received = received[: len(received) - (end[0] >> 2 & 7)]
    assert received == content
    assert end[1] | end[2] << 8 == crc_hqx(content, 0)
    server.answer(b"\xa1")
    assert server.finished


@given(st.binary(min_size=1, max_size=2000))
def test_block_download_takes_what_is_sent(content: bytes) -> None:
    server = BlockDownload(len(content), True, True)
    parts = [content[start : start + 7] for start in range(0, len(content), 7)]
    for position, part in enumerate(parts):
        last = 0x80 if position == len(parts) - 1 else 0
        answer = server.segment(bytes((position % 127 + 1 | last,)) + part.ljust(7, b"\0"))
        due = last or position % 127 == 126
        assert (answer is not None) == bool(due)
    unused = -len(content) % 7
    crc = crc_hqx(content, 0)
    assert server.end(bytes((0xC1 | unused << 2, crc & 255, crc >> 8))) == content


def test_block_download_of_a_parameter(bench: Bench) -> None:
    answer = bench.request(struct.pack("<BHBI", 0xC6, 0x2100, 7, 4))
    assert answer[0] == 0xA4
    data = struct.pack("<f", 40.0)
    bench.request(b"\x81" + data)
    crc = crc_hqx(data, 0)
    assert bench.request(bytes((0xC1 | 3 << 2, crc & 255, crc >> 8)))[0] == 0xA1
    assert bench.get(0x2100, 7) == 40.0


def test_block_download_with_a_wrong_crc_changes_nothing(bench: Bench) -> None:
    before = bench.get(0x2100, 7)
    bench.request(struct.pack("<BHBI", 0xC6, 0x2100, 7, 4))
    bench.request(b"\x81" + struct.pack("<f", 40.0))
    with pytest.raises(Refused) as refused:
        bench.request(bytes((0xC1 | 3 << 2, 1, 2)))
    assert refused.value.code == AbortCode.CRC
    assert bench.get(0x2100, 7) == before


@given(st.lists(st.binary(min_size=8, max_size=8), max_size=30))
def test_no_request_brings_the_server_down(requests: list[bytes]) -> None:
    bench = BENCH
    for request in requests:
        bench.send(0x605, request)
    bench.frames.clear()
    bench.wait(0.4, 0.1)
    bench.send(0x605, b"\x80" + bytes(7))
    assert bench.upload(0x1000) == bytes.fromhex("92010200")


BENCH = Bench()
