"""Puts right what an earlier session has left changed in a CANopen drive, from the file that it kept.

Only what holds a value of that session is put back: what is as before needs nothing, and what holds
something else was set by somebody since, unless that session died while it was writing it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from autotune.core.errors import LinkError, TransferAborted
from autotune_drivers.canopen.node import OPERATIONAL, PRE_OPERATIONAL, STOPPED, Node
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.pdo import PdoSetting, read_setting
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.session import Backup, Session, holds
from autotune_drivers.kept import Keeper

_OFF = 0x8000_0000


@dataclass(frozen=True, slots=True)
class Left:
    """What a session has noted: old values, those that it has written since, and whether it has seen them there."""

    objects: tuple[tuple[ObjectRef, Raw, tuple[Raw, ...], bool], ...]
    pdos: tuple[tuple[PdoSetting, tuple[PdoSetting, ...], bool], ...]
    nmt: str

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Left:
        """From the file. Raises KeyError, TypeError or ValueError where that does not say what it must."""
        objects = tuple(
            (
                ObjectRef.parse(one["object"], str(one["name"])),
                _raw(one["before"]),
                tuple(_raw(value) for value in one["written"]),
                bool(one.get("certain", True)),
            )
            for one in content["objects"]
        )
        pdos = tuple(
            (
                _setting(one["before"]),
                tuple(_setting(value) for value in one["written"]),
                bool(one.get("certain", True)),
            )
            for one in content["pdos"]
        )
        return cls(objects, pdos, str(content["nmt"]))


def put_right(
    node: Node,
    sdo: Sdo,
    keeper: Keeper,
    quieten: Callable[[], None] = lambda: None,
    *,
    commands: bool = True,
) -> tuple[str, ...]:
    """What an earlier session has left in this drive is put back, read back, and said.

    `commands`: the node's state is ours to change; it is not where another master moves the axis.
    `quieten` is called before anything is put back: an armed recorder refuses that its settings are changed.

    Raises:
        ConfigurationError: its file is damaged. LinkError: something could not be put back; the file stays.
    """
    content = keeper.read()
    if content is None:
        return tuple(keeper.others())
    try:
        left = Left.of(content)
    except (KeyError, TypeError, ValueError) as error:
        raise keeper.damaged(error) from error
    mine, foreign = _mine(sdo, left)
    session = Session(sdo, mine)
    if mine.objects:
        with suppress(TransferAborted):  # then what is refused is told
            quieten()
    calm = (lambda: node.command(PRE_OPERATIONAL)) if commands else (lambda: None)
    troubles = session.restore(calm) or _not_as_before(sdo, mine)
    if troubles:
        raise LinkError(
            f"an earlier session has ended without putting back what it changed in node {node.number}, and this one "
            f"could not either: {'; '.join(troubles)}. Nothing else was done. Switch the drive off and on; start again"
        )
    if commands:
        node.command(left.nmt if left.nmt in (OPERATIONAL, STOPPED) else PRE_OPERATIONAL)
    keeper.clear()
    return (*_told(node, mine, foreign), *keeper.others())


def _told(node: Node, mine: Backup, foreign: Sequence[str]) -> list[str]:
    names = [str(ref) for ref, _ in mine.objects] + [pdo.name for pdo in mine.pdos]
    told = []
    if names:
        told.append(
            f"an earlier session has ended without closing; it left {', '.join(names)} of node {node.number} changed; "
            "put back"
        )
    if foreign:
        told.append(
            f"an earlier session has changed {', '.join(foreign)} of node {node.number}, which hold something else "
            "again: left as they are"
        )
    return told


def _mine(sdo: Sdo, left: Left) -> tuple[Backup, list[str]]:
    """What holds a value of that session, with the old one; and what holds neither."""
    objects: list[tuple[ObjectRef, Raw]] = []
    pdos: list[PdoSetting] = []
    foreign: list[str] = []
    for ref, before, written, certain in left.objects:
        present = _present(sdo, ref)
        if present is None or present == before:
            continue
        if present in written or not certain:
            objects.append((ref, before))
        else:
            foreign.append(str(ref))
    for setting, settings, certain in left.pdos:
        if holds(sdo, setting):
            continue
        if not certain or _is_mix(read_setting(sdo, setting.kind, setting.number), (setting, *settings)):
            pdos.append(setting)
        else:
            foreign.append(setting.name)
    return Backup(tuple(objects), tuple(pdos)), foreign


def _present(sdo: Sdo, ref: ObjectRef) -> Raw | None:
    try:
        return sdo.read(ref)
    except TransferAborted:
        return None


def _is_mix(now: PdoSetting, known: Sequence[PdoSetting]) -> bool:
    """As a session cut off while it changed a PDO can have left it: every part old, new, or emptied."""
    return (
        now.cob_id & ~_OFF in [one.cob_id & ~_OFF for one in known]
        and now.transmission in [one.transmission for one in known]
        and now.entries in [(), *(one.entries for one in known)]
    )


def _not_as_before(sdo: Sdo, mine: Backup) -> list[str]:
    wrong = [
        f"{ref} is {now} instead of {before}"
        for ref, before in mine.objects
        if (now := sdo.read(ref)) != before
    ]
    return wrong + [f"{pdo.name} is not as before" for pdo in mine.pdos if not holds(sdo, pdo)]


def _raw(value: Any) -> Raw:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"{value!r} is no number")
    return value


def _setting(content: Mapping[str, Any]) -> PdoSetting:
    kind, number, cob_id, transmission = (
        int(content[name]) for name in ("kind", "number", "cob_id", "transmission")
    )
    return PdoSetting(kind, number, cob_id, transmission, tuple(int(entry) for entry in content["entries"]))
