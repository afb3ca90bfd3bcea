"""Memory of large arrays that a process keeps: asked of the system anew, every page of them is a fault.

The C library gives an array of some megabytes back as soon as nobody has it any more, and asks for the next one anew. A
diagnosis makes thousands of them, of eight runs of a twin each: a quarter of a million faults, a fifteenth of its
processor time. Only a program that owns its process says so, and no server, which is to give memory back; a library
leaves the process of others as it is.
"""

from __future__ import annotations

import ctypes

_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1
"""Names of `mallopt` (malloc.h): from which size on memory is mapped by itself, and how much is kept at the end."""
_MAPPED, _KEPT = 1 << 25, 1 << 28
"""Bytes: the most that glibc allows, and more than all runs of a pass together have."""


def large_arrays_kept() -> None:
    """Has memory of large arrays used again in this process; nothing changes where the C library is another."""
    try:
        choose = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    choose(_MMAP_THRESHOLD, _MAPPED)
    choose(_TRIM_THRESHOLD, _KEPT)
