"""Heartbeat producer (1017) and consumer (1016) of CiA 301, 7.2.8.2.2, on the wall clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.object_dictionary import Entry, ObjectDictionary, Value

CONSUMERS = 2


@dataclass(slots=True)
class _Watch:
    node: int
    time: float
    deadline: float | None = None


class HeartbeatConsumer:
    """Watches other nodes; watching one begins with its first heartbeat."""

    def __init__(self, objects: ObjectDictionary, changed: Callable[[], None]) -> None:
        self._entries = [objects[0x1016, number] for number in range(1, CONSUMERS + 1)]
        self._changed = changed
        for entry in self._entries:
            entry.write = self._writer(entry)
        self._watches: dict[int, _Watch] = {}

    def reset(self) -> None:
        """Takes the parameters as they stand in the dictionary; nothing is watched yet."""
        self._watches = {}
        self._refresh()

    def _refresh(self) -> None:
        before, self._watches = self._watches, {}
        for entry in self._entries:
            node, time = _parse(int(entry.value))
            if node and time:
                known = before.get(node)
                deadline = known.deadline if known and known.time == time * 1e-3 else None
                self._watches[node] = _Watch(node, time * 1e-3, deadline)

    @property
    def nodes(self) -> list[int]:
        """Ids of the nodes watched."""
        return list(self._watches)

    @property
    def due(self) -> float | None:
        """The earliest deadline [s]; None where nothing is watched."""
        deadlines = [watch.deadline for watch in self._watches.values() if watch.deadline is not None]
        return min(deadlines, default=None)

    def heard(self, node: int, now: float) -> None:
        watch = self._watches.get(node)
        if watch is not None:
            watch.deadline = now + watch.time

    def lost(self, now: float) -> list[int]:
        """Nodes whose time has run out; each is named once, until it is heard again."""
        late = [w for w in self._watches.values() if w.deadline is not None and now >= w.deadline]
        for watch in late:
            watch.deadline = None
        return [watch.node for watch in late]

    def _writer(self, entry: Entry) -> Callable[[Value], None]:
        def write(value: Value) -> None:
            node, time = _parse(int(value))
            taken = [_parse(int(e.value)) for e in self._entries if e is not entry]
            if node > 127:
                raise Abort(AbortCode.RANGE)
            if node and time and any(node == other and period for other, period in taken):
                raise Abort(AbortCode.PARAMETERS)
            entry.value = value
            self._refresh()
            self._changed()

        return write


class HeartbeatProducer:
    """Says when the drive's own heartbeat is due."""

    def __init__(self, objects: ObjectDictionary) -> None:
        self._time = objects[0x1017]
        self.due: float | None = None

    def poll(self, now: float) -> bool:
        """True where a heartbeat is to be sent now."""
        period = int(self._time.value) * 1e-3
        if period <= 0:
            self.due = None
            return False
        if self.due is None or self.due > now + period:
            self.due = now
        if now < self.due:
            return False
        late = self.due + period <= now
        self.due = now + period if late else self.due + period
        return True


def _parse(value: int) -> tuple[int, int]:
    return value >> 16 & 0xFF, value & 0xFFFF
