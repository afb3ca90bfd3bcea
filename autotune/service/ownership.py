"""One owner per link on this machine: the service, or one command of the command line.

The owner holds a lock named after what only one program may use: a serial device, a CAN interface, a simulated
axis's file. A CAN interface can be opened by many, but each tuning program is a master that sends SYNC (CiA 301):
with two of them every drive on the bus would sample twice a cycle. One program may look after several axes of
one bus, one after the other. The lock says who owns, never whom to trust: where a service is, and its token,
is in its own configuration (`service_file`).
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.service.lock_file import Held, Holder, Lock, holder_of, lock_folder
from autotune_drivers.url import SCHEMES, LinkAddress, parse_link


@dataclass(frozen=True, slots=True)
class Key:
    """`drive`: which node on which link; `bus`: what only one program at a time may use."""

    drive: str
    bus: str


def key_of(axis: Axis, axis_file: Path) -> Key:
    """Where the axis's drive is, the same for every way of writing it.

    Raises:
        ConfigurationError: the link is not one.
    """
    scheme = axis.link.partition(":")[0].lower()
    if scheme not in SCHEMES:  # simulated in the process: the file is the axis
        place = f"{scheme}:{axis_file.resolve()}"
        return Key(place, place)
    address = parse_link(axis.link, axis_file.resolve().parent)
    bus = f"device:{_device(Path(address.target))}" if SCHEMES[scheme].is_path else f"can:{address.target}"
    return Key(f"{bus}#{_node(address)}", bus)


def _node(address: LinkAddress) -> int | None:
    return next((address.options[name] for name in ("node", "id") if name in address.options), None)


def _device(path: Path) -> str:
    """Names below /dev are resolved (by-id is the same device), others may be links that move."""
    return os.path.realpath(path) if path.is_relative_to("/dev") else os.path.abspath(path)


def owner_of(key: Key) -> Holder | None:
    """Who holds the link now; None where nobody does."""
    return holder_of(_path(key.bus))


def take(bus: str, name: str, what: str) -> Lock:
    """Takes a link for axis `name`.

    Raises:
        ConfigurationError: another program has it; says which, and how to take over.
    """
    try:
        return Lock.take(_path(bus), what)
    except Held as held:
        raise ConfigurationError(in_use(name, bus, held.holder)) from None


def in_use(name: str, bus: str, holder: Holder) -> str:
    """The sentence where another program has the link of an axis."""
    kind, _, place = bus.partition(":")
    why = f", and only one master at a time may send SYNC on {place}" if kind == "can" else ""
    stop = f"stop it (kill {holder.process}, as its user or root)" if holder.process else "stop it"
    return f"axis {name} is held by {holder}{why}; wait until it has ended, or {stop}"


@contextmanager
def owned(axis: Axis, axis_file: Path, what: str) -> Iterator[None]:
    """Holds the axis's link for a command of the command line.

    Raises:
        ConfigurationError: another process has it.
    """
    held = take(key_of(axis, axis_file).bus, axis.name, what)
    try:
        yield
    finally:
        held.release()


def _path(bus: str) -> Path:
    return lock_folder() / f"autotune-{hashlib.sha256(bus.encode()).hexdigest()[:20]}.lock"
