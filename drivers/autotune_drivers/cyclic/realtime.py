"""Real-time priority for the cyclic process while it plays, where the system permits it.

Only while it plays: loading what a routine needs takes a second of processor time, and several axes that begin at
the same minute would hold up the loops that run already.

Measured: under a real-time priority 0.05 % of 1 ms cycles are late on a quiet host; without one, on a
loaded host, a loop is tens of milliseconds late now and then.
"""

from __future__ import annotations

import ctypes
import gc
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_PRIORITY = 20
_MCL_CURRENT_AND_FUTURE = 3


def ask_for_priority() -> str:
    """Tries to get a real-time priority and to lock the memory; what came of it, in words."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except (AttributeError, OSError) as error:
        return (
            f"normal priority ({getattr(error, 'strerror', None) or error}); for cycles that are never late "
            "allow it: 'rtprio 20' in /etc/security/limits.conf"
        )
    return f"real-time priority {_PRIORITY}, memory {'locked' if _lock_memory() else 'not locked'}"


def _lock_memory() -> bool:
    """Locks the memory unless a limit would make later allocations fail."""
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if soft != resource.RLIM_INFINITY:
        return False
    try:
        return bool(ctypes.CDLL(None).mlockall(_MCL_CURRENT_AND_FUTURE) == 0)
    except (OSError, AttributeError):
        return False


@contextmanager
def first_in_line() -> Iterator[None]:
    """Real-time priority for the time of a routine; without the right to it nothing changes."""
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    try:
        yield
    finally:
        give_back_priority()


def give_back_priority() -> None:
    """Back among all others. Idempotent."""
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@contextmanager
def no_collection() -> Iterator[None]:
    """Keeps the garbage collector away while a routine plays.

    What is there before it stays until the process ends, and is not looked through before the next.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
