"""CAN frames in and out: what every CAN adapter offers to the layers above.

A frame is `(identifier, data)`; only 11-bit data frames exist for CANopen. A link is used by one
thread, hands over frames in blocks, and says in words what is wrong with its adapter.
"""

from __future__ import annotations

import errno
import socket
import time
from typing import Any, Protocol

import can

from autotune.core.errors import LinkError
from autotune_drivers.letting_go import when_let_go

Frame = tuple[int, bytes]


class FrameLink(Protocol):
    """A CAN adapter. Every method may raise LinkError: unplugged, bus off, gone."""

    @property
    def name(self) -> str:
        """What a person calls it: the device or the interface."""

    @property
    def hint(self) -> str:
        """What the adapter itself can say about a node that is silent; may be empty."""

    def send(self, *frames: Frame) -> None:
        """Sends frames in order, with one system call where the adapter allows it."""

    def receive(self, timeout: float) -> list[Frame]:
        """All frames that are there; waits up to `timeout` seconds for the first."""

    def close(self) -> None:
        """Lets go of the adapter. Idempotent, never raises."""


class BusLink:
    """Any python-can bus as a link: socketcan, and the virtual bus of the tests.

    Args:
        lock: what holds the interface for us alone; closed with the link.
    """

    def __init__(self, bus: Any, name: str, lock: socket.socket | None = None) -> None:
        self._bus = bus
        self._lock = lock
        self.name = name
        self.hint = ""
        self._closed = False

    def send(self, *frames: Frame) -> None:
        for identifier, data in frames:
            try:
                self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
            except OSError as error:
                raise unplugged(self.name, error) from error
            except can.CanError as error:
                raise _bus_error(self.name, error) from error

    def receive(self, timeout: float) -> list[Frame]:
        frames: list[Frame] = []
        try:
            message = self._bus.recv(timeout)
            while message is not None:
                if not (message.is_extended_id or message.is_remote_frame or message.is_error_frame):
                    frames.append((message.arbitration_id, bytes(message.data)))
                message = self._bus.recv(0)
        except OSError as error:
            raise unplugged(self.name, error) from error
        except can.CanError as error:
            raise _bus_error(self.name, error) from error
        return frames

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._bus.shutdown()
            if self._lock is not None:
                self._lock.close()


def open_socketcan(interface: str) -> BusLink:
    """Opens a kernel CAN interface.

    Our own frames are not to come back to us: whatever is heard with a master's COB-ID is somebody else's.

    Raises:
        LinkError: there is no such interface, it is down, the kernel has no CAN, or another autotune has it.
    """
    lock = lock_interface(interface)
    try:
        bus = can.Bus(interface="socketcan", channel=interface, receive_own_messages=False)
    except (OSError, can.CanError) as error:
        lock.close()
        raise LinkError(
            f"CAN interface {interface!r} cannot be opened: {error}. Look for it with 'ip link'; bring it up "
            f"with 'ip link set {interface} up type can bitrate 1000000'. Where the kernel has no CAN, use "
            "an slcan adapter: canopen+slcan:///dev/ttyACM0?bitrate=1000000&node=5"
        ) from error
    return BusLink(bus, interface, lock)


def lock_interface(interface: str) -> socket.socket:
    """Takes a CAN interface for us alone: two masters on one bus would both send SYNC.

    An interface is no file that could be locked. An abstract address of a local socket is the kernel's, belongs
    to the same network namespace as the interface, and goes with the process, however that ends.

    Raises:
        LinkError: another autotune has it.
    """
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        when_let_go(lambda: lock.bind(f"\0autotune-can-{interface}"))
    except OSError as error:
        lock.close()
        raise LinkError(
            f"CAN interface {interface!r} is in use by another autotune ({error.strerror}); a bus has one master. "
            "Wait until that has ended, or stop it"
        ) from error
    return lock


def unplugged(name: str, error: OSError) -> LinkError:
    """The error of an adapter that went away under our hands."""
    code = errno.errorcode.get(error.errno or 0, "")
    return LinkError(
        f"the CAN adapter {name} is gone ({code or 'no code'}: {error.strerror or error}); it was unplugged, "
        "or the simulator ended. The drive stops by its own heartbeat guard. Plug it in and start again"
    )


def _bus_error(name: str, error: can.CanError) -> LinkError:
    return LinkError(
        f"the CAN interface {name} reports: {error}. Check that it is up, the bit rate, and that the bus is "
        "terminated at both ends"
    )


def drain(link: FrameLink, seconds: float) -> list[Frame]:
    """Everything that arrives within `seconds`."""
    frames: list[Frame] = []
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        frames += link.receive(left)
    return frames
