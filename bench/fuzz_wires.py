"""Fuzzing what comes over a wire, and names of what is on it; the judges are written from the protocols."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from autotune_drivers.canopen.data_sheet import parse_data_sheet
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.slcan import SlcanBus
from autotune_drivers.moteus.line import LineReader
from autotune_drivers.moteus.multiplex import parse as parse_frame
from autotune_drivers.url import parse_link
from bench.fuzz_judging import refused, require


def read_eds(data: bytes, folder: Path) -> bool:
    failed, sheet = refused(lambda: parse_data_sheet(data, "some.eds"))
    if failed:
        return False
    for (index, sub), entry in sheet.objects.items():
        require(0 <= index <= 0xFFFF and 0 <= sub <= 0xFF, f"object {index:x}:{sub:x}")
        require(entry.access in ("ro", "wo", "rw", "rwr", "rww", "const"), f"access {entry.access!r}")
    for number in (sheet.vendor, sheet.product, sheet.revision):
        require(number is None or 0 <= number < 2**32, f"identity {number}")
    require(len(sheet.remarks) <= 20, "remarks without end")
    return True


_SLCAN = re.compile(rb"t([0-7][0-9A-Fa-f]{2})([0-8])((?:[0-9A-Fa-f]{2})*)([0-9A-Fa-f]{4})?")


def _slcan_strict(line: bytes) -> tuple[int, bytes] | None:
    """As Lawicel writes it: data of the length said, and perhaps a time stamp of four digits."""
    match = _SLCAN.fullmatch(line.rpartition(b"\a")[2])
    if match is None:
        return None
    data = match[3] + (match[4] or b"")
    length = 2 * int(match[2])
    return (
        (int(match[1], 16), bytes.fromhex(data[:length].decode()))
        if len(data) in (length, length + 4)
        else None
    )


def read_slcan(data: bytes, folder: Path) -> bool:
    bus: Any = object.__new__(SlcanBus)
    bus.answers = bus.errors = bus.garbled = 0
    bus._heads = {}
    some = False
    for line in data.split(b"\r"):
        frame = bus._decode(line)
        if frame is not None:
            some = True
            require(frame == _slcan_strict(line), f"{line!r} became the frame {frame}")
    return some


_RCV = re.compile(rb"rcv ([0-9A-Fa-f]{1,8})(?: ((?:[0-9A-Fa-f]{2})*))?(?: [EeBbFfRr]+| [tf]-?[0-9]+| )*")


def _crc(data: bytes) -> int:
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ 0x197 if crc & 0x80 else crc << 1
    return crc


def read_moteus_line(data: bytes, folder: Path) -> bool:
    reader, strict = LineReader(), data[:1] > b"m"
    reader.demands_checksums = strict
    half = len(data) // 2
    lines = reader.feed(data[:half]) + reader.feed(data[half:])
    texts = re.split(rb"[\r\n]", data)
    for line in lines:
        if line.kind == "rcv":
            require(any(_means(text, line, strict) for text in texts), f"nobody sent {line}")
    return bool(lines)


def _means(text: bytes, line: Any, strict: bool) -> bool:
    """Whether the text ends in a frame that says what the line says."""
    for start in (at.start() for at in re.finditer(rb"rcv ", text)):
        part = text[start:]
        checked = re.fullmatch(rb"(.*)\*([0-9A-Fa-f]{2})", part, re.DOTALL)
        if checked is not None and int(checked[2], 16) != _crc(checked[1]):
            continue
        if strict and checked is None:
            continue
        match = _RCV.fullmatch((checked[1] if checked else part).strip(b" "))
        if (
            match
            and int(match[1], 16) == line.identifier
            and bytes.fromhex((match[2] or b"").decode()) == line.data
        ):
            return True
    return False


def read_moteus_frame(data: bytes, folder: Path) -> bool:
    reply = parse_frame(data)
    require(len(reply.values) <= len(data), "more registers than bytes")
    require(all(0 <= register < 2**36 for register in reply.values), "a register without a number")
    return bool(reply.values)


class _Answers:
    """A wire on which a node says what stands in the input, whatever it is asked."""

    def __init__(self, frames: list[bytes], again: bool) -> None:
        self.frames, self.again, self.asked, self.at = frames, again, 0, 0
        self.handler: Callable[[bytes], None] = lambda data: None

    def on(self, identifier: int, handler: Callable[[bytes], None]) -> None:
        self.handler = handler

    def send(self, *frames: tuple[int, bytes]) -> None:
        for _, data in frames:
            self.asked += data[0] in (0x40, 0xA0)
            if self.at < len(self.frames) and data[0] != 0x80:
                self.handler(self.frames[self.at])
                self.at += 1
                if self.again and self.at == len(self.frames):
                    self.at = 0

    def drain(self) -> None:
        pass

    def wait(self, seconds: float, until: Callable[[], bool]) -> bool:
        return until()


def read_sdo(data: bytes, folder: Path) -> bool:
    parts = re.split(rb"[ \n]", data)
    frames = []
    for part in parts[:200]:
        try:
            frames.append(bytes.fromhex(part.decode("ascii"))[:8])
        except ValueError:
            frames.append(part[:8])
    wire = _Answers(frames, again=len(data) % 16 == 0)
    block = len(data) % 5 == 0
    sdo = Sdo(wire, 5)  # type: ignore[arg-type]
    ref = ObjectRef(0x6064, 0, ("u8", "i32", "f64")[len(data) % 3], "position")
    failed, value = refused(lambda: sdo.read_block(ref) if block else sdo.read_bytes(ref))
    if failed or block or wire.asked > 1:
        return not failed
    wanted = _upload(frames * (2 if wire.again else 1))
    require(value == wanted, f"{[frame.hex() for frame in frames[:4]]} read as {value!r}, is {wanted!r}")
    return True


def _upload(frames: list[bytes]) -> bytes | None:
    """CiA 301's upload of 6064h: expedited, or segments with a toggle bit; None where it is none."""
    first = frames[0]
    if len(first) != 8 or first[0] >> 5 != 2 or struct.unpack_from("<HB", first, 1) != (0x6064, 0):
        return None
    if first[0] & 2:
        return first[4 : 8 - (first[0] >> 2 & 3)] if first[0] & 1 else first[4:]
    found, toggle = b"", 0
    for frame in frames[1:]:
        if len(frame) != 8 or frame[0] >> 5 != 0 or frame[0] >> 4 & 1 != toggle:
            return None
        found, toggle = found + frame[1 : 8 - (frame[0] >> 1 & 7)], toggle ^ 1
        if frame[0] & 1:
            stated = struct.unpack_from("<I", first, 4)[0]
            return found if not first[0] & 1 or stated == len(found) else None
    return None


def read_link(data: bytes, folder: Path) -> bool:
    text = data.decode("utf-8", "surrogateescape").split("\n")[0]
    with suppress(ValueError):
        ObjectRef.parse(text)
    failed, address = refused(lambda: parse_link(text, folder))
    if not failed:
        require(
            all(isinstance(value, int) and 0 <= value <= 12_000_000 for value in address.options.values()),
            text,
        )
    return not failed


def hex_frame(data: bytes) -> bytes:
    line = data.split(b"\n")[0]
    try:
        return bytes.fromhex(line.decode("ascii"))
    except ValueError:
        return line[:64]
