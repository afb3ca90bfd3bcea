"""Several cores for passes of kernels that know nothing of each other: the same results in less time.

A kernel gives the interpreter free while it runs. Only a program that owns its process says that the machine's cores
are its own; a library works on one, and so does what runs beside the loop of a drive. One core is left to others
unless a number is asked for: a service may hold the loop of an axis on the same machine.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, TypeVar

from autotune.core.time_limit import check_time

if TYPE_CHECKING:
    from concurrent.futures import Future, ThreadPoolExecutor

Item = TypeVar("Item")
Result = TypeVar("Result")

VARIABLE = "AUTOTUNE_CORES"
"""Environment variable: how many cores a program takes that asks for all; what is no number from 1 on is not heard."""
_MOST = 8
_cores = 1


def use_free_cores() -> None:
    """Has passes of this process worked on beside each other, on the cores that it may use but one."""
    global _cores
    _cores = min(_asked() or max(_allowed() - 1, 1), _MOST)


def on_each(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """What `work` gives for each item, in their order; no more of it than there are cores is made in advance.

    Raises:
        TimeIsUp: before an item for which there is no time left (`core.time_limit`).
        Exception: what `work` raises, at the item's place.
    """
    if min(_cores, len(items)) < 2:
        for item in items:
            check_time()
            yield work(item)
        return
    ahead: deque[Future[Result]] = deque()
    left = iter(items)
    try:
        for item in left:
            check_time()
            ahead.append(_pool(_cores).submit(work, item))
            if len(ahead) == _cores:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    finally:
        for future in ahead:  # what nobody asks for any more
            future.cancel()


@cache
def _pool(cores: int) -> ThreadPoolExecutor:
    from concurrent.futures import ThreadPoolExecutor  # a tenth of the start of a command that needs none

    return ThreadPoolExecutor(cores, thread_name_prefix="pass")


def _asked() -> int:
    text = os.environ.get(VARIABLE, "")
    return int(text) if text.isdecimal() else 0


def _allowed() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
