"""PDOs: communication and mapping parameters with the rules of CiA 301 (7.5.2.35 ff.), and transport.

To change a mapping: COB-ID with bit 31 set, sub-index 0 of the mapping to 0, the entries, sub-index 0
to their number, COB-ID with bit 31 clear. Anything else is refused, as real drives do.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.object_dictionary import FORMATS, Entry, ObjectDictionary, Value, packed

NUMBER = 4
_INVALID = 0x80000000
_EXTENDED = 0x20000000
_ID = 0x7FF
_LONGEST = 64
_RESERVED = ((0x000, 0x000), (0x001, 0x07F), (0x101, 0x180), (0x581, 0x5FF), (0x601, 0x67F), (0x6E0, 0x6FF))


class Pdo:
    """Parameters of one PDO, common to both directions; `changed` is called when they change."""

    _ACCESS: tuple[str, ...] = ()

    def __init__(
        self, objects: ObjectDictionary, communication: int, mapping: int, changed: Callable[[], None]
    ) -> None:
        self._objects = objects
        self._cob_id = objects[communication, 1]
        self._transmission = objects[communication, 2]
        self._count = objects[mapping, 0]
        self._entries = [objects[mapping, number] for number in range(1, 9)]
        self._changed = changed
        self._cob_id.write = self._write_cob_id
        self._transmission.write = self._write_transmission
        self._count.write = self._write_count
        for entry in self._entries:
            entry.write = self._write_entry
        self.refresh()

    def refresh(self) -> None:
        """Takes the parameters as they stand in the dictionary."""
        raw = int(self._cob_id.value)
        self.valid = not raw & _INVALID
        self.cob_id = raw & _ID
        self.transmission = int(self._transmission.value)
        self.mapped = self._mapped(int(self._count.value))
        self.packer = struct.Struct("<" + "".join(FORMATS[entry.data_type] for entry in self.mapped))

    def _mapped(self, count: int) -> list[Entry]:
        return [self._objects.mapped(int(entry.value)) for entry in self._entries[:count]]

    def _write_cob_id(self, value: Value) -> None:
        number = int(value)
        identifier = number & _ID
        if number & _EXTENDED:
            raise Abort(AbortCode.RANGE)
        if not number & _INVALID:
            reserved = any(low <= identifier <= high for low, high in _RESERVED) or identifier >= 0x701
            if reserved:
                raise Abort(AbortCode.RANGE)
            if self.valid and identifier != self.cob_id:
                raise Abort(AbortCode.STATE)
        self._cob_id.value = value
        self._update()

    def _write_transmission(self, value: Value) -> None:
        if 240 < int(value) < 254:
            raise Abort(AbortCode.RANGE)
        self._transmission.value = value
        self._update()

    def _write_count(self, value: Value) -> None:
        if self.valid:
            raise Abort(AbortCode.STATE)
        mapped = self._mapped(int(value))
        for entry in mapped:
            self._check_direction(entry)
        if sum(entry.size * 8 for entry in mapped) > _LONGEST:
            raise Abort(AbortCode.PDO_LENGTH)
        self._count.value = value
        self._update()

    def _write_entry(self, value: Value) -> None:
        if self.valid:
            raise Abort(AbortCode.STATE)
        if int(self._count.value) != 0:
            raise Abort(AbortCode.ACCESS)
        if int(value) != 0:
            self._check_direction(self._objects.mapped(int(value)))

    def _check_direction(self, entry: Entry) -> None:
        if not entry.access.startswith(self._ACCESS):
            raise Abort(AbortCode.NOT_MAPPABLE)

    def _update(self) -> None:
        self.refresh()
        self._changed()


class ReceivePdo(Pdo):
    """Process data to the drive; synchronous ones take effect with the next SYNC. `received` counts them."""

    _ACCESS = ("rw", "wo")

    def __init__(self, objects: ObjectDictionary, number: int, changed: Callable[[], None]) -> None:
        self._waiting: bytes | None = None
        self.received = 0
        super().__init__(objects, 0x1400 + number, 0x1600 + number, changed)

    def refresh(self) -> None:
        super().refresh()
        self._waiting = None

    def receive(self, data: bytes) -> bool:
        """Takes a frame; False where it is too short for the mapping."""
        if len(data) < self.packer.size:
            return False
        self.received += 1
        if self.transmission > 240:
            self._apply(data)
        else:
            self._waiting = data
        return True

    def synchronise(self) -> None:
        """SYNC: what was received takes effect."""
        if self._waiting is not None:
            data, self._waiting = self._waiting, None
            self._apply(data)

    def _apply(self, data: bytes) -> None:
        for entry, value in zip(self.mapped, self.packer.unpack_from(data), strict=True):
            try:
                entry.put(value)
            except Abort:
                continue  # a PDO has no way to refuse: the object keeps its value


class TransmitPdo(Pdo):
    """Process data to the master: with every n-th SYNC, or on change (types 0, 254, 255)."""

    _ACCESS = ("r", "const")

    def __init__(self, objects: ObjectDictionary, number: int, changed: Callable[[], None]) -> None:
        self._inhibit = objects[0x1800 + number, 3]
        self._event = objects[0x1800 + number, 5]
        self._start = objects[0x1800 + number, 6]
        self._syncs = 0
        self._started = False
        self._sent_at = -1e9
        self._sent = b""
        super().__init__(objects, 0x1800 + number, 0x1A00 + number, changed)
        self._inhibit.write = self._write_while_invalid
        self._start.write = self._write_while_invalid

    def refresh(self) -> None:
        super().refresh()
        self._syncs, self._started, self._sent, self._sent_at = 0, False, b"", -1e9
        self._reads: list[Callable[[], Value]] = [entry.read or entry.get for entry in self.mapped]

    def _write_while_invalid(self, _: Value) -> None:
        if self.valid:
            raise Abort(AbortCode.STATE)

    def content(self) -> bytes:
        return packed(self.packer, [read() for read in self._reads])

    def synchronous(self, counter: int) -> bool:
        """True where this SYNC (with its counter, or 0) asks for the PDO."""
        if not 0 < self.transmission <= 240:
            return self.transmission == 0 and self.content() != self._sent
        start = int(self._start.value)
        if not self._started and start and counter and counter != start:
            return False
        self._started = True
        self._syncs += 1
        if self._syncs < self.transmission:
            return False
        self._syncs = 0
        return True

    def acyclic(self, now: float) -> bytes | None:
        """Content to send where an event or the event timer asks for it, else None."""
        if self.transmission < 254:
            return None
        elapsed = now - self._sent_at
        if elapsed < int(self._inhibit.value) * 1e-4:
            return None
        content = self.content()
        timer = int(self._event.value) * 1e-3
        if content == self._sent and not (timer > 0 and elapsed >= timer):
            return None
        self.mark(content, now)
        return content

    @property
    def due(self) -> float | None:
        """When the event timer or the end of the inhibit time asks for attention [s]."""
        timer = int(self._event.value) * 1e-3
        pause = int(self._inhibit.value) * 1e-4
        if timer > 0:
            return self._sent_at + max(timer, pause)
        return self._sent_at + pause if self.content() != self._sent else None

    def mark(self, content: bytes, now: float) -> None:
        """Remembers what was sent, and when."""
        self._sent, self._sent_at = content, now
