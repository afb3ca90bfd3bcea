"""Who sends what to a drive, as the drive's own PDO parameters say: for a node that is not the master."""

from __future__ import annotations

from dataclasses import dataclass

from autotune.core.errors import StateError, TransferAborted
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.pdo import RPDO, TPDO, PdoSetting, read_setting
from autotune_drivers.canopen.sdo import Sdo

_OFF = 0x8000_0000
_ID = 0x7FF
_PDOS = 4


@dataclass(frozen=True, slots=True)
class Place:
    """Where a value is on the bus: COB-ID, and the byte in its frame."""

    cob_id: int
    byte: int


def settings(sdo: Sdo, kind: int) -> list[PdoSetting]:
    """The first PDOs of a drive, as far as it has them. Raises LinkError."""
    found = []
    for number in range(_PDOS):
        try:
            found.append(read_setting(sdo, kind, number))
        except TransferAborted:
            break
    return found


def valid(pdo: PdoSetting) -> bool:
    return not pdo.cob_id & _OFF


def places(pdos: list[PdoSetting], ref: ObjectRef) -> list[Place]:
    """Where an object is in the PDOs that are in use."""
    found = []
    for pdo in filter(valid, pdos):
        bits = 0
        for entry in pdo.entries:
            if entry >> 8 == ref.index << 8 | ref.sub:
                found.append(Place(pdo.cob_id & _ID, bits // 8))
            bits += entry & 0xFF
    return found


def free(pdos: list[PdoSetting], kind: int, number: int) -> int:
    """A PDO that nobody uses; the last one, which masters take last.

    Raises:
        StateError: all are in use.
    """
    unused = [pdo.number for pdo in pdos if not valid(pdo)]
    if unused:
        return unused[-1]
    name = {RPDO: "receive", TPDO: "transmit"}[kind]
    raise StateError(
        f"the master uses all {len(pdos)} {name} PDOs of node {number}; nothing was written. Free one in the "
        "master's configuration"
    )
