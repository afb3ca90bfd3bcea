"""Garbage is looked for seldom: loading a program makes a hundred thousand objects that all stay.

Looked for after every 700 of them, as Python does, it takes a sixth of the time in which a command starts, and half of
that as it is done here. Only a program that owns its process says so; a library leaves the process of others as it is.
"""

from __future__ import annotations

import gc

THRESHOLDS = (20_000, 10, 20)
"""New objects before the youngest are looked through, and how often that happens before the older ones are."""


def seldom_collected() -> None:
    """Has garbage looked for seldom in this process."""
    gc.set_threshold(*THRESHOLDS)
