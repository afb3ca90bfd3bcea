"""Hears who else commands our drive: a bus has one master, and only one client an SDO channel.

No adapter gives us our own frames back, so whatever is heard with a COB-ID that only the master uses is
somebody else's (CiA 301, 7.3: predefined connection set): NMT commands, SYNC, process data to our node, SDO
requests to our node, and the heartbeat of the node number that we have taken, which would keep the drive
calm after our death.

Process data and SYNC come again and again, so `OFTEN` of them within `WITHIN` are asked for: one alone may
be a frame that was corrupted on the adapter's serial line. Of the others one suffices.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from functools import partial

from autotune.core.errors import StateError
from autotune_drivers.canopen.pdo import RPDO, identifier
from autotune_drivers.canopen.wire import HEARTBEAT, NMT, SYNC, Wire

OFTEN = 3
WITHIN = 1.0
_SDO_REQUEST = 0x600
_NMT_COMMANDS = (1, 2, 128, 129, 130)
_ABORT = 0x80


class Foreigners:
    """Listens on a wire for other masters of node `number`.

    Attributes:
        suspect: somebody was heard; `accuse` judges.
    """

    def __init__(self, wire: Wire, number: int) -> None:
        self.suspect = False
        self._number = number
        self._heard: dict[int, deque[tuple[float, bytes]]] = {}
        self._words: dict[int, tuple[str, int]] = {}
        everyone = (0, number)
        self._listen(
            wire, NMT, "NMT commands", 1, lambda d: len(d) == 2 and d[0] in _NMT_COMMANDS and d[1] in everyone
        )
        self._listen(wire, SYNC, "SYNC messages", OFTEN, lambda d: len(d) <= 1)
        for index in range(4):
            cob_id = identifier(RPDO, index, number)
            self._listen(wire, cob_id, f"process data for node {number}", OFTEN, lambda d: True)
        self._listen(
            wire, _SDO_REQUEST + number, f"SDO requests to node {number}", 1,
            lambda d: len(d) == 8 and d[0] != _ABORT,
        )  # fmt: skip
        own = wire.own_node
        self._listen(wire, HEARTBEAT + own, f"the heartbeat of node {own}, our own number", 1, lambda d: True)

    def _listen(
        self, wire: Wire, cob_id: int, words: str, often: int, counts: Callable[[bytes], bool]
    ) -> None:
        self._words[cob_id] = words, often
        self._heard[cob_id] = deque(maxlen=often)
        wire.on(cob_id, partial(self._arrived, cob_id, counts))

    def _arrived(self, cob_id: int, counts: Callable[[bytes], bool], data: bytes) -> None:
        if counts(data):
            self._heard[cob_id].append((time.monotonic(), data))
            self.suspect = True

    def accuse(self) -> StateError | None:
        """The error that names another master heard within the last second; None where there is none."""
        now = time.monotonic()
        self.suspect = False
        found = []
        for cob_id, heard in self._heard.items():
            words, often = self._words[cob_id]
            while heard and now - heard[0][0] > WITHIN:
                heard.popleft()
            self.suspect = self.suspect or bool(heard)
            if len(heard) >= often:
                data = heard[-1][1].hex(" ") or "no data"
                found.append(f"{words} (COB-ID {cob_id:03X}h: {data})")
        if not found:
            return None
        return StateError(
            f"another master is on the bus of node {self._number}; we did not send {', '.join(found)}. Two masters "
            "move an axis where neither wants it: stop the other one (a PLC, the vendor's tool, a second program) "
            "or take it off this bus, and start again"
        )
