"""A drive behind a `FakeNode` that goes through the power states of CiA 402, for tests of `Power`."""

from __future__ import annotations

import struct
from collections.abc import Callable

from autotune.core.stopping import StopLimits
from autotune_drivers.canopen.exchange import Exchange
from autotune_drivers.canopen.frames import Frame
from autotune_drivers.canopen.node import Node
from autotune_drivers.canopen.power import Power
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.wire import Wire
from autotune_drivers.profile import read_profile
from tests.drivers.fake_node import FakeNode
from tests.drivers.simulator import axis_of

ENABLED, QUICK_STOP, DISABLED, FAULT = 0x0237, 0x0217, 0x0250, 0x0218
AXIS = axis_of()
COUNTS = 1.0 / AXIS.position_resolution


class StateDrive:
    """Answers SYNC as the simulated drive's mapping wants it.

    Attributes:
        speed: what it tells while it stops, by cycles since the quick stop began [rad/s].
        controls: control words that it was sent.
        status: its status word.
    """

    def __init__(self, speed: Callable[[int], float] = lambda cycle: 0.0) -> None:
        self.node = FakeNode(
            {
                (0x1001, 0): b"\0",
                (0x603F, 0): b"\0\0",
                (0x6040, 0): b"\0\0",
                (0x6041, 0): b"\0\0",
                (0x6064, 0): bytes(4),
            }
        )
        self.node.on_sync = self._sync
        self.speed = speed
        self.controls: list[int] = []
        self.status = ENABLED
        self.syncs = self.position = self.velocity = 0
        self._stopping = 0

    def emergency(self, code: int) -> None:
        self.node.reply((0x85, struct.pack("<HB5s", code, 1, b"")))

    def fail(self, code: int, register: int = 1) -> None:
        """In fault, with its code in 603Fh and an emergency."""
        self.status = FAULT
        self.node.objects[0x603F, 0] = struct.pack("<H", code)
        self.node.objects[0x1001, 0] = bytes((register,))
        self.emergency(code)

    def _sync(self, rpdos: list[Frame]) -> list[Frame]:
        self.syncs += 1
        (control,) = struct.unpack_from("<H", rpdos[0][1])
        self.controls.append(control)
        self._obey(control)
        self.velocity = round(self.speed(self._stopping) * COUNTS)
        self.position += round(self.velocity * AXIS.cycle)
        self.node.objects[0x6041, 0] = struct.pack("<H", self.status)
        return [
            (0x185, struct.pack("<HiH", self.status, self.position, self.syncs)),
            (0x285, bytes(8)),
            (0x385, struct.pack("<ii", self.velocity, 0)),
        ]

    def _obey(self, control: int) -> None:
        if self.status == FAULT:
            return
        if control == 0x02 and self.status == ENABLED:
            self.status = QUICK_STOP
        if self.status == QUICK_STOP:
            self._stopping += 1
        if control == 0x00:
            self.status = DISABLED


def power_of(drive: StateDrive) -> tuple[Power, Exchange]:
    """The master's side, in lock-step, one cycle after power came on."""
    wire = Wire(drive.node, 127, 0.05)
    node, sdo = Node(wire, 5), Sdo(wire, 5)
    profile = read_profile("autotune-sim")
    exchange = Exchange(node, profile, AXIS.cycle, lock_step=True)
    exchange.settings(profile.commands.position.ref)
    exchange.restart()
    scale = (AXIS.position_resolution, AXIS.position_resolution)
    limits = StopLimits.of(AXIS)
    power = Power(node, sdo, exchange, profile, limits=limits, stop_seconds=0.05, scale=scale)
    exchange.cycle((0x0F, 0, 0))
    return power, exchange
