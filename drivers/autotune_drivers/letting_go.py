"""A port or a bus has one master at a time; one that is about to end is waited for."""

from __future__ import annotations

import time
from collections.abc import Callable

_WITHIN = 2.0
"""How long [s] another process may still need: one whose owner was killed takes the axis to rest before it ends."""
_LOOK = 0.05


def when_let_go(take: Callable[[], None]) -> None:
    """Takes it as soon as whoever has it now lets go.

    Raises:
        OSError: what `take` raised last; nobody let go.
    """
    end = time.monotonic() + _WITHIN
    while True:
        try:
            take()
            return
        except OSError:
            if time.monotonic() > end:
                raise
        time.sleep(_LOOK)
