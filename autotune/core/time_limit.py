"""A limit of time for work that has something to show before it is done.

Only what asks can be stopped: passes of kernels do before each (`core.side_by_side`), a few seconds at most apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import monotonic
from typing import TypeVar

Result = TypeVar("Result")
Other = TypeVar("Other")

_END: ContextVar[float] = ContextVar("end", default=math.inf)


class TimeIsUp(Exception):
    """The time that the work inside `limited` may take is over."""


def deadline(seconds: float) -> float:
    """The moment so many seconds from now, for `limited`; `inf` is no limit."""
    return monotonic() + seconds


def is_over(until: float) -> bool:
    """Whether a `deadline` has passed."""
    return monotonic() > until


@contextmanager
def limited(until: float) -> Iterator[None]:
    """Has work inside end with `TimeIsUp` soon after a `deadline`."""
    before = _END.set(until)
    try:
        yield
    finally:
        _END.reset(before)


def check_time() -> None:
    """Goes on while there is time.

    Raises:
        TimeIsUp: there is none left.
    """
    if monotonic() > _END.get():
        raise TimeIsUp


def while_time(work: Callable[[], Result], otherwise: Other) -> Result | Other:
    """What `work` gives; `otherwise` where time is up before it is done."""
    try:
        check_time()
        return work()
    except TimeIsUp:
        return otherwise
