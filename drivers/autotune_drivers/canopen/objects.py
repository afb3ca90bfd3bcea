"""Objects of a drive's dictionary: written `6064:00 i32` (index, sub-index in hex, type).

Types: `bool`, `u8` to `u64`, `i8` to `i64`, `f32`, `f64` (CiA 301, little-endian).
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass

from autotune.core.errors import ConfigurationError, LinkError

Raw = int | float

FORMATS = {
    "bool": "?",
    "u8": "B",
    "u16": "H",
    "u32": "I",
    "u64": "Q",
    "i8": "b",
    "i16": "h",
    "i32": "i",
    "i64": "q",
    "f32": "f",
    "f64": "d",
}
_PATTERN = re.compile(r"^([0-9A-Fa-f]{4}):([0-9A-Fa-f]{2}) (\w+)$")


@dataclass(frozen=True, slots=True)
class ObjectRef:
    """One entry of an object dictionary, with its type; `name` is what errors call it."""

    index: int
    sub: int
    type: str
    name: str = ""

    @classmethod
    def parse(cls, text: str, name: str = "") -> ObjectRef:
        """Reads `6064:00 i32`.

        Raises:
            ValueError: not of that form, or an unknown type.
        """
        match = _PATTERN.match(text)
        if match is None:
            raise ValueError(
                f"object {text!r} is not understood; write index, sub-index, type: '6064:00 i32'"
            )
        if match[3] not in FORMATS:
            raise ValueError(
                f"object {text!r} has the unknown type {match[3]!r}; known: {', '.join(FORMATS)}"
            )
        return cls(int(match[1], 16), int(match[2], 16), match[3], name)

    def __str__(self) -> str:
        place = f"{self.index:04X}h:{self.sub:02X}"
        return f"{self.name} ({place})" if self.name else f"object {place}"

    @property
    def format(self) -> str:
        """Its `struct` letter."""
        return FORMATS[self.type]

    @property
    def size(self) -> int:
        """Bytes."""
        return struct.calcsize("<" + self.format)

    @property
    def is_float(self) -> bool:
        return self.type in ("f32", "f64")

    @property
    def range(self) -> tuple[float, float]:
        """What its type can hold."""
        if self.type == "bool":
            return 0, 1
        if self.is_float:
            largest = 3.4028234663852886e38 if self.type == "f32" else float("inf")
            return -largest, largest
        bits = 8 * self.size
        return (0, 2**bits - 1) if self.type[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)

    def mapping(self) -> int:
        """Its entry in a PDO mapping: index, sub-index, bits."""
        return self.index << 16 | self.sub << 8 | 8 * self.size

    def raw(self, value: float) -> Raw:
        """The nearest value that the object can hold.

        Raises:
            ConfigurationError: not finite, or outside the type's range.
        """
        low, high = self.range
        if not math.isfinite(value) or not low <= (value if self.is_float else round(value)) <= high:
            raise ConfigurationError(
                f"{self} cannot hold {value:.10g}; its type {self.type} holds {low:.10g} to {high:.10g}"
            )
        return struct.unpack("<" + self.format, struct.pack("<" + self.format, self._cast(value)))[0]  # type: ignore[no-any-return]

    def encode(self, raw: Raw) -> bytes:
        """Bytes for the wire; `raw` must be what `raw()` returned."""
        return struct.pack("<" + self.format, self._cast(raw))

    def decode(self, data: bytes) -> Raw:
        """Value from the wire. Drives may send more bytes than the type has, if these are filling.

        Raises:
            LinkError: too few bytes.
        """
        if len(data) < self.size:
            raise LinkError(
                f"{self} came with {len(data)} bytes, its type {self.type} has {self.size}; the profile does "
                "not fit this drive's firmware"
            )
        value: Raw = struct.unpack_from("<" + self.format, data)[0]
        return value

    def _cast(self, value: Raw) -> Raw:
        return float(value) if self.is_float else round(value)
