"""What a session changes in a drive, remembered so that it can be put back.

Every change goes through here: the old value is read before the new one is written. `backup()` can
travel to another process, so that whoever survives can restore; where there is a keeper, old and new value
are on disk before the new one is written, so that nobody has to survive.

An adapter's serial line has no checksum, so that a bit that flips there arrives as another value, acknowledged. What
is remembered is therefore read until it reads alike twice, and what is written is read back: another value is noted as
one of ours, and written over. What was written and not yet read back, or was being put back, when a session died may
hold anything; it is noted as not certain, and is ours whatever it holds.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, TypeVar

from autotune.core.errors import ConfigurationError, LinkError, TransferAborted
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.pdo import PdoSetting, read_setting, write_setting
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.kept import Keeper

Key = tuple[int, int]
Task = tuple[str, Callable[[], None]]
_ABSENT = (0x06020000, 0x06090011)
_ATTEMPTS = 3
Read = TypeVar("Read")


@dataclass(frozen=True, slots=True)
class Backup:
    """Old values, in the order in which they were changed."""

    objects: tuple[tuple[ObjectRef, Raw], ...] = ()
    pdos: tuple[PdoSetting, ...] = ()


class Session:
    """Changes objects and PDOs; remembers the value from before the first change of each.

    `inherited` is what an earlier session has left changed: it is put back by this one. `keeper` has on disk
    what may be changed at any moment; `nmt`, the node's state before, is noted with it.
    """

    def __init__(self, sdo: Sdo, inherited: Backup | None = None, keeper: Keeper | None = None) -> None:
        backup = inherited or Backup()
        self._sdo = sdo
        self._objects: dict[Key, tuple[ObjectRef, Raw]] = {
            (ref.index, ref.sub): (ref, raw) for ref, raw in backup.objects
        }
        self._pdos: dict[Key, PdoSetting] = {(pdo.kind, pdo.number): pdo for pdo in backup.pdos}
        self._changed: set[Key] = {*self._objects, *self._pdos}
        self._present: dict[Key, PdoSetting] = {}
        self._keeper = keeper
        self._kept: dict[Key, tuple[Raw | PdoSetting, ...]] = {}
        self._certain: set[Key] = set()  # holds the last value noted, or the one from before
        self.nmt = ""

    def backup(self) -> Backup:
        """Everything that was looked at in order to be changed, as it was before."""
        return Backup(tuple(self._objects.values()), tuple(self._pdos.values()))

    def remember(self, ref: ObjectRef) -> Raw:
        """Notes an object that will be changed later; its present value. Raises LinkError."""
        value = _surely(lambda: self._sdo.read(ref), _equal, str(ref))
        self._objects.setdefault((ref.index, ref.sub), (ref, value))
        return value

    def remember_pdo(self, wanted: PdoSetting) -> PdoSetting:
        """Notes a PDO that will be changed later; its present setting. Raises LinkError."""
        key = (wanted.kind, wanted.number)
        present = self._present.get(key) or _surely(lambda: read_setting(self._sdo, *key), same, wanted.name)
        self._pdos.setdefault(key, present)
        self._present[key] = present
        return present

    def write(self, ref: ObjectRef, raw: Raw) -> Raw:
        """Changes an object; what it holds then, as a drive may round it.

        Raises:
            LinkError: no answer, or refused. ConfigurationError: it cannot be noted.
        """
        present = self.remember(ref)
        if present == raw:
            return present
        key = (ref.index, ref.sub)
        self._keep(key, raw)
        self._changed.add(key)
        return self._put(ref, raw)

    def write_if_there(self, ref: ObjectRef, raw: Raw) -> bool:
        """Changes an object; False where the drive does not have it. Raises LinkError."""
        try:
            self.write(ref, raw)
        except TransferAborted as error:
            if error.code not in _ABSENT:
                raise
            return False
        return True

    def map(self, wanted: PdoSetting) -> None:
        """Changes a PDO; nothing is sent where it is as wanted. Raises LinkError, ConfigurationError."""
        key = (wanted.kind, wanted.number)
        present = self.remember_pdo(wanted)
        if same(present, wanted):
            return
        self._keep(key, wanted)
        self._changed.add(key)
        self._present.pop(key, None)
        write_setting(self._sdo, wanted, present)
        if holds(self._sdo, wanted):
            self._certain.add(key)
        self._present[key] = wanted

    def settle(self) -> None:
        """All that is to be changed has been, and was seen there: on disk too. Raises ConfigurationError.

        Until then the last change counts as one that a death may have cut, which is put back whatever is there.
        """
        if self._keeper is not None and self._kept:
            self._keeper.write(self._content(self._kept))

    def _put(self, ref: ObjectRef, raw: Raw) -> Raw:
        """Writes an object and reads it back, again where it is not that; what it holds then. Raises LinkError."""
        for _ in range(_ATTEMPTS):
            self._sdo.write(ref, raw)
            now = self._sdo.read(ref)
            if _equal(now, raw):
                self._certain.add((ref.index, ref.sub))
                break
            self._keep((ref.index, ref.sub), now)
        return now

    def _put_back(self, ref: ObjectRef, raw: Raw) -> None:
        try:
            now = self._put(ref, raw)
        except TransferAborted:  # of a drive that never let it be changed
            if not _equal(self._sdo.read(ref), raw):
                raise
            return
        if not _equal(now, raw):
            raise TransferAborted(f"{ref} is {now} after {raw} was written; look at adapter and cable", 0)

    def _put_pdo_back(self, pdo: PdoSetting) -> None:
        for _ in range(_ATTEMPTS):
            try:
                write_setting(self._sdo, pdo, pdo)
            except TransferAborted:  # of a drive that never let it be changed
                if not holds(self._sdo, pdo):
                    raise
                return
            if holds(self._sdo, pdo):
                return
        raise TransferAborted(f"{pdo.name} is not what was written; look at adapter and cable", 0)

    def forget_present(self) -> None:
        """The node was reset: what it has now is not known any more."""
        self._present.clear()

    def undo(self, ref: ObjectRef) -> None:
        """Puts one object back. Raises LinkError."""
        key = (ref.index, ref.sub)
        if key in self._changed:
            self._put_back(*self._objects[key])
            self._changed.discard(key)

    def restore(self, before_pdos: Callable[[], None] = lambda: None) -> list[str]:
        """Puts everything back, last change first; says what could not be.

        `before_pdos` is called first where PDOs have to be changed; only it may raise LinkError.
        What failed is tried once more after the rest, as some objects are only valid together. A node
        that no longer answers is not asked again.
        """
        pdos = [pdo for key, pdo in self._pdos.items() if key in self._changed]
        objects = [pair for key, pair in self._objects.items() if key in self._changed]
        self._doubt()
        if pdos:
            before_pdos()
        tasks: list[Task] = [(pdo.name, partial(self._put_pdo_back, pdo)) for pdo in reversed(pdos)]
        tasks += [(str(ref), partial(self._put_back, ref, raw)) for ref, raw in reversed(objects)]
        failed, dead = _attempt(tasks)
        if failed and not dead:
            failed, dead = _attempt([(name, task) for name, task, _ in failed])
        if not failed:
            self._changed.clear()
            self._let_go()
        self._present.clear()
        if dead:
            names = ", ".join(name for name, _, _ in failed)
            return [f"{names} could not be set back: {failed[0][2]}"]
        return [f"{name} could not be set back: {error}" for name, _, error in failed]

    # On disk

    def _keep(self, key: Key, value: Raw | PdoSetting) -> None:
        """Notes a value that will be written. Raises ConfigurationError."""
        known = self._kept.get(key, ())
        if self._keeper is None or value in known:
            return
        kept = {**self._kept, key: (*known, value)}
        self._certain.discard(key)
        self._keeper.write(self._content(kept))
        self._kept = kept

    def _doubt(self) -> None:
        """Everything is about to be put back. A disk that does not take it has the old note."""
        self._certain.clear()
        if self._keeper is not None and self._kept:
            with suppress(ConfigurationError):
                self._keeper.write(self._content(self._kept))

    def _content(self, kept: dict[Key, tuple[Raw | PdoSetting, ...]]) -> dict[str, Any]:
        objects = [
            {
                "object": f"{ref.index:04X}:{ref.sub:02X} {ref.type}",
                "name": ref.name,
                "before": raw,
                "written": list(kept[key]),
                "certain": key in self._certain,
            }
            for key, (ref, raw) in self._objects.items()
            if key in kept
        ]
        pdos = [
            {
                "before": asdict(pdo),
                "written": [asdict(one) for one in kept[key] if isinstance(one, PdoSetting)],
                "certain": key in self._certain,
            }
            for key, pdo in self._pdos.items()
            if key in kept
        ]
        return {"nmt": self.nmt, "objects": objects, "pdos": pdos}

    def _let_go(self) -> None:
        """Nothing is changed any more."""
        if self._keeper is not None and self._kept:
            self._keeper.clear()
        self._kept = {}


def _surely(read: Callable[[], Read], alike: Callable[[Read, Read], bool], name: str) -> Read:
    """Reads until two readings in a row are alike. Raises LinkError."""
    last = read()
    for _ in range(_ATTEMPTS):
        before, last = last, read()
        if alike(before, last):
            return last
    raise LinkError(f"{name} reads differently each time; look at adapter and cable")


def _equal(one: Raw, other: Raw) -> bool:
    return one == other or (one != one and other != other)


def _attempt(tasks: list[Task]) -> tuple[list[tuple[str, Callable[[], None], LinkError]], bool]:
    """What failed, and whether the node answered no more."""
    failed: list[tuple[str, Callable[[], None], LinkError]] = []
    for position, (name, task) in enumerate(tasks):
        try:
            task()
        except TransferAborted as error:
            failed.append((name, task, error))
        except LinkError as error:
            return failed + [(name, task, error) for name, task in tasks[position:]], True
    return failed, False


def holds(sdo: Sdo, setting: PdoSetting) -> bool:
    """Whether a PDO is set so; one whose setting cannot be read is not. Raises LinkError."""
    try:
        return same(read_setting(sdo, setting.kind, setting.number), setting)
    except TransferAborted:
        return False


def same(one: PdoSetting, other: PdoSetting) -> bool:
    """Alike in all that matters; the COB-ID's bits 29 and 30 are the drive's own."""
    identifier = 0x9FFF_FFFF
    return (
        one.cob_id & identifier == other.cob_id & identifier
        and one.transmission == other.transmission
        and one.entries == other.entries
    )
