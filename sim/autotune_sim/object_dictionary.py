"""The object dictionary of the simulated drive, read from its electronic data sheet (CiA 306).

An entry holds a value or asks hooks for it; what a master may read or write, of what length and in
what range is decided here, so that SDO and PDO obey the same rules.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from configparser import RawConfigParser, SectionProxy
from pathlib import Path

from autotune_sim.aborts import Abort, AbortCode

Value = int | float | bytes

REAL32, VISIBLE_STRING, OCTET_STRING, DOMAIN = 0x08, 0x09, 0x0A, 0x0F
_LARGEST = 3.4028234663852886e38
FORMATS = {1: "?", 2: "b", 3: "h", 4: "i", 5: "B", 6: "H", 7: "I", 8: "f", 0x11: "d", 0x15: "q", 0x1B: "Q"}
_SECTION = re.compile(r"^([0-9A-Fa-f]{4})(?:sub([0-9A-Fa-f]{1,2}))?$")
_CONTAINERS = (0x8, 0x9)


class Entry:
    """One variable of the dictionary.

    Attributes:
        read: where the value comes from, if not from `value`.
        write: called with a checked value before it is kept; may raise Abort.
        delay: seconds that a write takes, given the value; may raise Abort.
    """

    __slots__ = (
        "access",
        "data_type",
        "default",
        "delay",
        "high",
        "index",
        "low",
        "mappable",
        "name",
        "packer",
        "read",
        "subindex",
        "value",
        "write",
    )

    def __init__(self, index: int, subindex: int, section: SectionProxy, node_id: int) -> None:
        self.index = index
        self.subindex = subindex
        self.name = section["ParameterName"]
        self.data_type = int(section["DataType"], 0)
        self.access = section["AccessType"].lower()
        self.mappable = section.get("PDOMapping", "0") == "1"
        self.packer = struct.Struct("<" + FORMATS[self.data_type]) if self.data_type in FORMATS else None
        self.default = self._parse(section.get("DefaultValue", ""), node_id)
        self.low = self._limit(section.get("LowLimit", ""))
        self.high = self._limit(section.get("HighLimit", ""))
        self.value = self.default
        self.read: Callable[[], Value] | None = None
        self.write: Callable[[Value], None] | None = None
        self.delay: Callable[[Value], float] | None = None

    @property
    def size(self) -> int:
        """Length [bytes]; 0 where it varies."""
        return self.packer.size if self.packer else 0

    @property
    def kept(self) -> bool:
        """True for parameters, which 1010 stores; process data (`rww`) and constants are not."""
        return self.access == "rw"

    def get(self) -> Value:
        return self.read() if self.read is not None else self.value

    def put(self, value: Value) -> None:
        """Takes a value of the right type if range and hooks allow it.

        Raises:
            Abort: out of range, or refused by the drive.
        """
        self.check(value)
        if self.write is not None:
            self.write(value)
        self.value = value

    def check(self, value: Value) -> None:
        if isinstance(value, bytes):
            return
        if isinstance(value, float) and not math.isfinite(value):
            raise Abort(AbortCode.RANGE)
        if self.low is not None and value < self.low:
            raise Abort(AbortCode.TOO_LOW)
        if self.high is not None and value > self.high:
            raise Abort(AbortCode.TOO_HIGH)

    def upload(self) -> bytes:
        """The value as bytes on the wire.

        Raises:
            Abort: write-only, or there is no value now.
        """
        if "r" not in self.access and self.access != "const":
            raise Abort(AbortCode.WRITE_ONLY)
        return self.encode(self.get())

    def decode(self, data: bytes) -> Value:
        """The value of bytes on the wire.

        Raises:
            Abort: read-only, or of another length than the object.
        """
        if "w" not in self.access:
            raise Abort(AbortCode.READ_ONLY)
        if self.packer is None:
            return data
        if len(data) != self.packer.size:
            raise Abort(AbortCode.TOO_LONG if len(data) > self.packer.size else AbortCode.TOO_SHORT)
        return self.packer.unpack(data)[0]  # type: ignore[no-any-return]

    def encode(self, value: Value) -> bytes:
        if self.packer is None:
            return value if isinstance(value, bytes) else b""
        return packed(self.packer, (value,))

    def _parse(self, text: str, node_id: int) -> Value:
        if self.packer is None:
            return text.encode("ascii")
        if self.data_type in (REAL32, 0x11):
            return float(text or 0.0)
        compact = text.replace(" ", "").upper()
        relative = "$NODEID" in compact
        number = int(re.sub(r"\+?\$NODEID\+?", "", compact) or "0", 0)
        return number + node_id if relative else number

    def _limit(self, text: str) -> float | None:
        if not text or self.packer is None:
            return None
        return float(text) if self.data_type in (REAL32, 0x11) else int(text, 0)


def packed(packer: struct.Struct, values: Sequence[Value]) -> bytes:
    """Values as bytes; what an object cannot hold is told as the most or the least that it can."""
    try:
        return packer.pack(*values)
    except (struct.error, OverflowError):
        return packer.pack(*map(_saturated, packer.format.lstrip("<"), values))


def _saturated(form: str, value: Value) -> Value:
    if isinstance(value, bytes) or form in "?d":
        return value
    if form == "f":
        return math.copysign(math.inf, value) if abs(value) > _LARGEST else value
    bits = 8 * struct.calcsize("<" + form)
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if form.islower() else (0, (1 << bits) - 1)
    return int(min(max(value, low), high))


class ObjectDictionary:
    """All entries by index and sub-index."""

    def __init__(self, parser: RawConfigParser, node_id: int) -> None:
        self.node_id = node_id
        self.indices: set[int] = set()
        self._entries: dict[int, Entry] = {}
        for title in parser.sections():
            match = _SECTION.match(title)
            if match is None:
                continue
            index, subindex = int(match[1], 16), int(match[2] or "0", 16)
            self.indices.add(index)
            section = parser[title]
            if match[2] is None and int(section.get("ObjectType", "0x7"), 0) in _CONTAINERS:
                continue
            self._entries[index << 8 | subindex] = Entry(index, subindex, section, node_id)

    def __iter__(self) -> Iterator[Entry]:
        return iter(self._entries.values())

    def __getitem__(self, key: tuple[int, int] | int) -> Entry:
        """The entry at (index, sub-index) or at index, sub-index 0.

        Raises:
            Abort: no such object or sub-index.
        """
        index, subindex = key if isinstance(key, tuple) else (key, 0)
        entry = self._entries.get(index << 8 | subindex)
        if entry is None:
            raise Abort(AbortCode.NO_SUBINDEX if index in self.indices else AbortCode.NO_OBJECT)
        return entry

    def number(self, index: int, subindex: int = 0) -> int:
        """Present value of an integer entry."""
        value = self[index, subindex].get()
        return int(value) if not isinstance(value, bytes) else 0

    def mapped(self, mapping: int) -> Entry:
        """The entry that a PDO mapping parameter (index, sub-index, bits) names.

        Raises:
            Abort: it does not exist, cannot be mapped or has another length.
        """
        try:
            entry = self[mapping >> 16, mapping >> 8 & 0xFF]
        except Abort:
            raise Abort(AbortCode.NO_OBJECT) from None
        if not entry.mappable or entry.size * 8 != mapping & 0xFF:
            raise Abort(AbortCode.NOT_MAPPABLE)
        return entry


def read_eds(path: Path, node_id: int) -> ObjectDictionary:
    """Reads an electronic data sheet for a node with the given id."""
    parser = RawConfigParser(inline_comment_prefixes=(";",))
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(path.read_text(encoding="ascii"), str(path))
    return ObjectDictionary(parser, node_id)
