"""Looks at a drive's dictionary from outside, to compare it before and after."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.slcan import open_slcan
from autotune_drivers.canopen.wire import Wire

SETTINGS = (
    "1016:01 u32",
    "1016:02 u32",
    "1017:00 u16",
    "6007:00 i16",
    "605A:00 i16",
    "605E:00 i16",
    "6060:00 i8",
    "60C2:01 u8",
    "60C2:02 i8",
    "6085:00 u32",
    "607D:01 i32",
    "607D:02 i32",
    "6065:00 u32",
    "6072:00 u16",
    "2000:01 f32",
    "2100:04 f32",
)
STATUS = ObjectRef.parse("6041:00 u16")


@contextmanager
def sdo(port: Path, node: int = 5) -> Iterator[Sdo]:
    """An SDO client of its own on the adapter."""
    link = open_slcan(port, 1000000)
    try:
        yield Sdo(Wire(link, 126, 0.05), node)
    finally:
        link.close()


def settings(port: Path) -> dict[str, float]:
    """Everything that a session may change, PDOs included."""
    with sdo(port) as client:
        return settings_over(client)


def settings_over(client: Sdo) -> dict[str, float]:
    """The same over a client that is there."""
    found: dict[str, float] = {text: client.read(ObjectRef.parse(text)) for text in SETTINGS}
    for base in (0x1400, 0x1800):
        for number in range(4):
            found |= _pdo(client, base + number)
    return found


def _pdo(client: Sdo, index: int) -> dict[str, float]:
    values: dict[str, float] = {}
    for sub, kind in ((1, "u32"), (2, "u8")):
        values[f"{index:04X}:{sub}"] = client.read(ObjectRef(index, sub, kind))
    count = int(client.read(ObjectRef(index + 0x200, 0, "u8")))
    values[f"{index + 0x200:04X}:0"] = count
    for sub in range(1, count + 1):
        values[f"{index + 0x200:04X}:{sub}"] = client.read(ObjectRef(index + 0x200, sub, "u32"))
    return values


def powered(port: Path) -> bool:
    """Operation enabled, quick stop or fault reaction."""
    with sdo(port) as client:
        return int(client.read(STATUS)) & 0x6F in (0x27, 0x07, 0x0F, 0x2F)
