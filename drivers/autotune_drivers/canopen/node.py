"""One node of the bus: NMT, heartbeat with a timer of its own, emergency messages.

The state that a node told long ago is not its state: `nmt_state` is "silent" when its heartbeat has
not come for three of its periods.
"""

from __future__ import annotations

import struct
import time
from collections import deque
from dataclasses import dataclass

from autotune_drivers.canopen.wire import EMERGENCY, HEARTBEAT, NMT, SYNC, Wire

OPERATIONAL = "operational"
PRE_OPERATIONAL = "pre-operational"
STOPPED = "stopped"
BOOT_UP = "boot-up"
SILENT = "silent"

_STATES = {0: BOOT_UP, 4: STOPPED, 5: OPERATIONAL, 127: PRE_OPERATIONAL}
RESET_NODE = "reset-node"
RESET_COMMUNICATION = "reset-communication"
_COMMANDS = {OPERATIONAL: 1, STOPPED: 2, PRE_OPERATIONAL: 128, RESET_NODE: 129, RESET_COMMUNICATION: 130}
_EMCY = struct.Struct("<HB5s")


@dataclass(frozen=True, slots=True)
class Emergency:
    """An EMCY message; `code` 0 says that the error is gone."""

    code: int
    register: int
    vendor: bytes


class Node:
    """The master's view of node `number`; `told`: its heartbeat has come; `woken`: we have started it."""

    def __init__(self, wire: Wire, number: int) -> None:
        self.wire = wire
        self.number = number
        self.period: float = 0.0
        self.boots = 0
        self.told = False
        self.woken = False
        self.emergencies: deque[Emergency] = deque(maxlen=16)
        self._told = ""
        self._heard = -1e9
        self._sync: tuple[int, ...] = ()
        self._sync_next = 0
        wire.on(HEARTBEAT + number, self._heartbeat)
        wire.on(EMERGENCY + number, self._emergency)

    @property
    def nmt_state(self) -> str:
        """What its heartbeat says, or "silent"; empty while it is not monitored and told nothing."""
        if self.period and time.monotonic() - self._heard > 3 * self.period:
            return SILENT
        return self._told

    def monitor(self, period: float) -> None:
        """The node was told to send its heartbeat every `period` seconds."""
        self.period = period
        self._heard = time.monotonic()
        self.told = False

    def command(self, state: str) -> None:
        """Asks the node to change its NMT state."""
        self.wire.send((NMT, bytes((_COMMANDS[state], self.number))))

    def reset(self, kind: str, seconds: float) -> bool:
        """Resets the node (`RESET_NODE`, `RESET_COMMUNICATION`); False where no boot-up message came in time."""
        boots = self.boots
        self.period = 0.0  # its heartbeat is as it was stored
        self.command(kind)
        return self.wire.wait(seconds, lambda: self.boots > boots)

    def count_syncs(self, overflow: int) -> None:
        """SYNC carries a counter from 1 to `overflow` (object 1019h); 0: no counter."""
        self._sync = tuple(range(1, overflow + 1))

    def sync_frame(self) -> tuple[int, bytes]:
        """The next SYNC message."""
        if not self._sync:
            return SYNC, b""
        counter = self._sync[self._sync_next]
        self._sync_next = (self._sync_next + 1) % len(self._sync)
        return SYNC, bytes((counter,))

    def take_emergencies(self) -> list[Emergency]:
        """The emergencies that have come since the last call."""
        taken = list(self.emergencies)
        self.emergencies.clear()
        return taken

    def _heartbeat(self, data: bytes) -> None:
        self._heard = time.monotonic()
        if data:
            self.told = True
            self._told = _STATES.get(data[0] & 0x7F, f"state {data[0]}")
            self.boots += self._told == BOOT_UP

    def _emergency(self, data: bytes) -> None:
        if len(data) == 8:  # anything shorter on this identifier is not an EMCY
            self.emergencies.append(Emergency(*_EMCY.unpack(data)))
