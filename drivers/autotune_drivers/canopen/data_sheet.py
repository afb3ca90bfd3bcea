"""Electronic data sheets (EDS) and device configuration files (DCF), CiA 306, as vendors really write them.

Real files have empty numbers, sections twice, Windows line ends, Latin-1 in names and keys in any case.
What can be understood is read, and `remarks` says what was passed over; what cannot be a data sheet at all
ends in one sentence.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from autotune.core.errors import ConfigurationError

LARGEST = 4_000_000  # bytes; real ones have 20 to 700 kB
MOST_REMARKS = 20
_SECTION = re.compile(r"^([0-9a-f]{4})(?:sub([0-9a-f]{1,2}))?$")
_TYPES = {
    0x01: "bool",
    0x02: "i8",
    0x03: "i16",
    0x04: "i32",
    0x05: "u8",
    0x06: "u16",
    0x07: "u32",
    0x08: "f32",
    0x11: "f64",
    0x15: "i64",
    0x1B: "u64",
}
_TEXTS = {0x09: "text", 0x0A: "bytes", 0x0B: "text", 0x0F: "domain"}
_ACCESS = ("ro", "wo", "rw", "rwr", "rww", "const")
_IDENTITY = ("VendorNumber", "ProductNumber", "RevisionNumber")
_CONTAINERS = (0x08, 0x09)

Sections = dict[str, dict[str, str]]


@dataclass(frozen=True, slots=True)
class SheetObject:
    """One entry: its type as `ObjectRef` names it (or text, bytes, domain), and what a master may do."""

    name: str
    type: str
    access: str
    mappable: bool

    @property
    def readable(self) -> bool:
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        return self.access not in ("ro", "const")


@dataclass(frozen=True, slots=True)
class DataSheet:
    """What a data sheet says.

    Attributes:
        vendor, product, revision: None where the file leaves them empty.
        objects: by (index, sub-index).
        remarks: what was passed over, in words; at most `MOST_REMARKS`.
    """

    vendor: int | None
    product: int | None
    revision: int | None
    product_name: str
    objects: Mapping[tuple[int, int], SheetObject]
    remarks: tuple[str, ...] = ()


def read_data_sheet(path: str | Path) -> DataSheet:
    """Reads an EDS or DCF file.

    Raises:
        ConfigurationError: no such file, far too large, or nothing in it that is an object.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise ConfigurationError(
                f"{path} has {size / 1e6:.1f} MB, a data sheet has at most {LARGEST / 1e6:.0f} MB; it is "
                "something else, or damaged: take the file from the vendor again"
            )
        return parse_data_sheet(path.read_bytes(), str(path))
    except FileNotFoundError:
        raise ConfigurationError(f"there is no data sheet {path}; check the name") from None
    except OSError as error:
        raise ConfigurationError(f"data sheet {path} cannot be read: {error.strerror}") from error


def parse_data_sheet(content: bytes, where: str) -> DataSheet:
    """Understands the bytes of a data sheet; `where` names it in errors. See `read_data_sheet`."""
    remarks: list[str] = []
    sections = _sections(_decoded(content, where), remarks)
    objects = dict(_objects(sections, remarks))
    if not objects:
        raise ConfigurationError(
            f"{where} has no section that describes an object ([1000], [6041], ...); it is not an EDS or DCF "
            "file, or damaged: take the file from the vendor again"
        )
    device = sections.get("deviceinfo", {})
    numbers = {key: _identity(device.get(key.lower(), "")) for key in _IDENTITY}
    remarks[:0] = [
        f"{key} is empty or no number of 32 bits" for key, number in numbers.items() if number is None
    ]
    vendor, product, revision = numbers.values()
    name = device.get("productname", "")
    return DataSheet(vendor, product, revision, name, objects, tuple(remarks[:MOST_REMARKS]))


def _decoded(content: bytes, where: str) -> str:
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    if b"\0" in content:
        raise ConfigurationError(f"{where} is not a text file; a data sheet (EDS, DCF) is: check the name")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")  # the usual one; only names and comments are concerned


def _sections(text: str, remarks: list[str]) -> Sections:
    """Sections and keys in lower case; of what is there twice, the last value counts."""
    sections: Sections = {}
    current: dict[str, str] = {}
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if not line or line[0] in ";#":
            continue
        if line[0] == "[" and "]" in line:
            title = line[1 : line.index("]")].strip().lower()
            if title in sections:
                remarks.append(f"section [{title}] comes again in line {number}")
            current = sections.setdefault(title, {})
            continue
        key, equals, value = line.partition("=")
        if equals:
            current[key.strip().lower()] = value.strip()
        elif len(remarks) < MOST_REMARKS:
            remarks.append(f"line {number} is neither a section nor a value: {line[:40]!r}")
    return sections


def _objects(sections: Sections, remarks: list[str]) -> Iterator[tuple[tuple[int, int], SheetObject]]:
    for title, section in sections.items():
        match = _SECTION.match(title)
        if match is None:
            continue
        index, sub = int(match[1], 16), int(match[2] or "0", 16)
        if match[2] is None and (_number(section.get("objecttype", "")) or 7) in _CONTAINERS:
            yield from _compact(index, section)
            continue
        entry = _entry(section)
        if entry is None:
            remarks.append(f"object [{title}] has no type that can be read")
            continue
        yield (index, sub), entry


def _compact(index: int, section: Mapping[str, str]) -> Iterator[tuple[tuple[int, int], SheetObject]]:
    """CompactSubObj: so many entries of one type, without sections of their own."""
    count = _number(section.get("compactsubobj", "")) or 0
    entry = _entry(section)
    if entry is not None and 0 < count < 255:
        yield (index, 0), SheetObject("Highest sub-index supported", "u8", "ro", False)
        for sub in range(1, count + 1):
            yield (index, sub), entry


def _entry(section: Mapping[str, str]) -> SheetObject | None:
    code = _number(section.get("datatype", ""))
    kind = None if code is None else _TYPES.get(code) or _TEXTS.get(code)
    access = section.get("accesstype", "").lower()
    if kind is None or access not in _ACCESS:
        return None
    mappable = bool(_number(section.get("pdomapping", "")) or 0)
    return SheetObject(section.get("parametername", ""), kind, access, mappable)


def _identity(text: str) -> int | None:
    """A number of 32 bits, as object 1018h holds it."""
    number = _number(text)
    return number if number is not None and 0 <= number < 2**32 else None


def _number(text: str) -> int | None:
    """A decimal or hexadecimal number; None where there is none. `1 ; comment` is 1."""
    compact = text.split(";")[0].strip().lower()
    if re.fullmatch(r"0x[0-9a-f]{1,16}", compact):
        return int(compact, 16)
    return int(compact) if re.fullmatch(r"-?\d{1,20}", compact) else None
