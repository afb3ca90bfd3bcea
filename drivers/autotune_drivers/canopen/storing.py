"""Parameters into a drive's own memory (object 1010h), and whether they are still there after a reset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from autotune.core.errors import DriveError
from autotune_drivers.canopen.node import Node
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.parameters import DriveParameters
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.profile import Store

_SAVE = 0x65766173
_BUSY, _DONE = 255, (0, 1)  # status of a command object (ETG.1020)


def save(node: Node, sdo: Sdo, parameters: DriveParameters, store: Store) -> None:
    """Stores what the drive has now, harmonics included.

    Raises:
        DriveError: the drive says that it has failed, or does not come to an end.
    """
    _save_ripple(node, sdo, parameters)
    ref = ObjectRef(store.at.index, store.at.sub, store.at.type, "store parameters")
    sdo.write(ref, _SAVE, store.seconds)


def _save_ripple(node: Node, sdo: Sdo, parameters: DriveParameters) -> None:
    """The harmonics into the drive's memory, where that is a command of its own."""
    block = parameters.ripple
    if block is None or block.save is None:
        return
    one = block.save
    sdo.write(replace(one.command, name="save harmonics"), one.value, one.seconds)
    node.wire.wait(one.seconds, lambda: sdo.read(one.status) != _BUSY)
    status = sdo.read(one.status)
    if status not in _DONE:
        raise DriveError(
            f"node {node.number} was told to save its harmonics ({one.command}), and {one.status} is "
            f"{status}: they are not stored. Look into the drive's diagnosis, and have its memory checked"
        )


def verify(node: Node, parameters: DriveParameters, store: Store, reset: Callable[[], None]) -> None:
    """Resets the node and reads everything again; what is not in the stored area gets its value back.

    Raises:
        DriveError: a value did not survive. LinkTimeout: the node did not come back (from `reset`).
    """
    before = parameters.read()
    reset()
    after = parameters.read()
    changed = [name for name, value in before.items() if after[name] != value]
    lost = [name for name in changed if parameters.stored_by(store.at, name)]
    parameters.write({name: before[name] for name in changed if name not in lost})
    if lost:
        told = ", ".join(f"{name} is {after[name]:.9g} instead of {before[name]:.9g}" for name in lost)
        raise DriveError(
            f"node {node.number} has confirmed storing, but after a reset {told}: its memory does not "
            "keep what is stored. Nothing is kept; have the drive's memory checked"
        )
