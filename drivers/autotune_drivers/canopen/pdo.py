"""PDO mappings: packed, written in the order that real drives demand, saved and put back.

Order: COB-ID with bit 31 set (off), mapping sub-index 0 to 0, the entries, sub-index 0 to their
number, transmission type, COB-ID with bit 31 clear (on). Drives refuse any other.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from autotune.core.errors import ConfigurationError
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.sdo import Sdo

RPDO = 0x1400
TPDO = 0x1800
_MAPPING = 0x200
_OFF = 0x8000_0000
_KEEP = 0x4000_0000
_BITS = 64
_BASE = {RPDO: (0x200, 0x300, 0x400, 0x500), TPDO: (0x180, 0x280, 0x380, 0x480)}


@dataclass(frozen=True, slots=True)
class PdoSetting:
    """Everything that is changed in one PDO: `kind` RPDO or TPDO, `number` from 0."""

    kind: int
    number: int
    cob_id: int
    transmission: int
    entries: tuple[int, ...]

    @property
    def name(self) -> str:
        return f"{'RPDO' if self.kind == RPDO else 'TPDO'}{self.number + 1}"


def identifier(kind: int, number: int, node: int) -> int:
    """The CAN identifier of a PDO in the predefined connection set."""
    return _BASE[kind][number] + node


def pack(signals: Sequence[ObjectRef]) -> list[list[ObjectRef]]:
    """Distributes signals over PDOs of 64 bits, in order.

    Raises:
        ConfigurationError: more than four PDOs.
    """
    groups: list[list[ObjectRef]] = []
    for ref in signals:
        if not groups or sum(8 * other.size for other in (*groups[-1], ref)) > _BITS:
            groups.append([])
        groups[-1].append(ref)
    if len(groups) > 4:
        raise ConfigurationError(
            f"the profile's cyclic signals need {len(groups)} PDOs, drives have four; leave some out"
        )
    return groups


def layout(group: Sequence[ObjectRef]) -> struct.Struct:
    """How a PDO's bytes are laid out."""
    return struct.Struct("<" + "".join(ref.format for ref in group))


def setting(kind: int, number: int, node: int, transmission: int, group: Sequence[ObjectRef]) -> PdoSetting:
    """The setting that puts `group` into a PDO; an empty group switches the PDO off."""
    cob_id = identifier(kind, number, node) | (0 if group else _OFF)
    return PdoSetting(kind, number, cob_id, transmission, tuple(ref.mapping() for ref in group))


def read_setting(sdo: Sdo, kind: int, number: int) -> PdoSetting:
    """What the drive has now. Raises LinkError."""
    count = int(sdo.read(_mapping(kind, number, 0)))
    return PdoSetting(
        kind,
        number,
        int(sdo.read(_cob_id(kind, number))),
        int(sdo.read(_transmission(kind, number))),
        tuple(int(sdo.read(_mapping(kind, number, sub))) for sub in range(1, min(count, 64) + 1)),
    )


def write_setting(sdo: Sdo, wanted: PdoSetting, present: PdoSetting) -> None:
    """Puts a setting into the drive. `present` gives the bits of the COB-ID that stay.

    Raises:
        TransferAborted: the drive cannot map one of the objects. LinkError.
    """
    kind, number = wanted.kind, wanted.number
    kept = present.cob_id & _KEEP if kind == TPDO else 0
    off = (present.cob_id & ~_KEEP) | kept | _OFF
    sdo.write(_cob_id(kind, number), off)
    sdo.write(_mapping(kind, number, 0), 0)
    for sub, entry in enumerate(wanted.entries, 1):
        sdo.write(_mapping(kind, number, sub), entry)
    sdo.write(_mapping(kind, number, 0), len(wanted.entries))
    sdo.write(_transmission(kind, number), wanted.transmission)
    final = (wanted.cob_id & ~_KEEP) | kept
    if final & _OFF == 0 or final != off:
        sdo.write(_cob_id(kind, number), final)


def _name(kind: int, number: int) -> str:
    return f"{'RPDO' if kind == RPDO else 'TPDO'}{number + 1}"


def _cob_id(kind: int, number: int) -> ObjectRef:
    return ObjectRef(kind + number, 1, "u32", f"COB-ID of {_name(kind, number)}")


def _transmission(kind: int, number: int) -> ObjectRef:
    return ObjectRef(kind + number, 2, "u8", f"transmission type of {_name(kind, number)}")


def _mapping(kind: int, number: int, sub: int) -> ObjectRef:
    text = f"mapping of {_name(kind, number)}"
    return ObjectRef(kind + number + _MAPPING, sub, "u32" if sub else "u8", text)
