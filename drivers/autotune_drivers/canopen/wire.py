"""One CANopen bus as its master sees it: frames to their handlers, and our own heartbeat.

Single-threaded on purpose: frames are handled where the caller waits for them (`pump`), and the
heartbeat is sent from there and from `send`. A loop that hangs therefore stops its heartbeat, and the
drive's consumer (object 1016h) stops the axis.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from autotune_drivers.canopen.frames import Frame, FrameLink
from autotune_drivers.punctuality import Punctuality

Handler = Callable[[bytes], None]

NMT = 0x000
SYNC = 0x080
EMERGENCY = 0x080
HEARTBEAT = 0x700
_OPERATIONAL = b"\x05"
_BURST = 0.005


class Wire:
    """Dispatches frames by identifier; produces the heartbeat of node `own_node` while asked to.

    Attributes:
        punctuality: how late that heartbeat was.
    """

    def __init__(self, link: FrameLink, own_node: int, beat_period: float) -> None:
        self.link = link
        self.punctuality = Punctuality()
        self.own_node = own_node
        self._handlers: dict[int, Handler] = {}
        self._beat: Frame = (HEARTBEAT + own_node, _OPERATIONAL)
        self._beat_period = beat_period
        self._beat_due = float("inf")

    def on(self, identifier: int, handler: Handler) -> None:
        """Calls `handler` with the data of every frame of `identifier`."""
        self._handlers[identifier] = handler

    def send(self, *frames: Frame) -> None:
        """Sends frames, and our heartbeat with them when it is due. Raises LinkError."""
        now = time.monotonic()
        if now >= self._beat_due:
            self.punctuality.note(now - self._beat_due)
            self._beat_due = now + self._beat_period
            frames = (*frames, self._beat)
        self.link.send(*frames)

    def start_heartbeat(self) -> None:
        """From now on the heartbeat is sent whenever the wire is used."""
        self.punctuality.begin()
        self._beat_due = time.monotonic()

    def stop_heartbeat(self) -> None:
        """Silence: a drive that guards us stops its axis."""
        self._beat_due = float("inf")

    def look_at_the_clock(self) -> None:
        """Notes a heartbeat that is due and not sent yet: whoever judges this host may come before it."""
        self.punctuality.note(time.monotonic() - self._beat_due)

    def pump(self, timeout: float) -> bool:
        """Handles what has arrived; waits at most `timeout` seconds for the first frame.

        Returns False when nothing came. Raises LinkError.
        """
        now = time.monotonic()
        if now >= self._beat_due:
            self.send()
        frames = self.link.receive(min(timeout, max(self._beat_due - now, 1e-3)))
        for identifier, data in frames:
            handler = self._handlers.get(identifier)
            if handler is not None:
                handler(data)
        return bool(frames)

    def drain(self) -> None:
        """Handles everything that is there now; a babbling node cannot hold us for more than 5 ms."""
        end = time.monotonic() + _BURST
        while self.pump(0.0) and time.monotonic() < end:
            pass

    def wait(self, seconds: float, until: Callable[[], bool]) -> bool:
        """Handles frames until `until()` holds; False when `seconds` have passed before."""
        end = time.monotonic() + seconds
        while not until():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.pump(left)
        return True
