"""A link whose frames can be lost or added on the way, between the master and the simulated drive."""

from __future__ import annotations

from autotune.core.axis import Axis
from autotune_drivers.canopen.drive import CanopenDrive
from autotune_drivers.canopen.frames import Frame, FrameLink
from autotune_drivers.canopen.opening import open_drive
from autotune_drivers.canopen.slcan import open_slcan
from autotune_drivers.profile import read_profile
from tests.drivers.simulator import Simulator, axis_of


class BadWire:
    """A `FrameLink`.

    Attributes:
        lost: COB-IDs that reach nobody, whoever sends them.
        overwrite: frames that another master puts on the bus before each SYNC.
        heard: frames of others that come with the next receive.
        sent: what the master has sent.
    """

    def __init__(self, link: FrameLink) -> None:
        self._link = link
        self.name, self.hint = link.name, link.hint
        self.lost: set[int] = set()
        self.overwrite: list[Frame] = []
        self.heard: list[Frame] = []
        self.sent: list[Frame] = []

    def send(self, *frames: Frame) -> None:
        self.sent += frames
        passing = [frame for frame in frames if frame[0] not in self.lost]
        if self.overwrite and any(frame[0] == 0x80 for frame in passing):
            passing = [frame for frame in passing if frame[0] != 0x80]
            passing += [*self.overwrite, (0x80, b"")]
        self._link.send(*passing)

    def receive(self, timeout: float) -> list[Frame]:
        added, self.heard = self.heard, []
        if added:
            return added
        return [frame for frame in self._link.receive(timeout) if frame[0] not in self.lost]

    def close(self) -> None:
        self._link.close()


def bad_wire(running: Simulator, axis: Axis | None = None) -> tuple[CanopenDrive, BadWire]:
    """The simulated drive behind such a link."""
    axis = axis or axis_of()
    wire = BadWire(open_slcan(running.port, 1000000))
    try:
        return open_drive(wire, 5, axis, read_profile(axis.profile)), wire
    except BaseException:
        wire.close()
        raise
