"""Compiled kernels: numba's decorator with types that a type checker understands.

The kernels work on records: structured arrays of length one, whose fields carry the names of the
physics. Compiled code is cached on disk, so that only the first process after an installation waits.
numba looks only at the file of the function itself to see whether the cache is stale; a kernel that
calls functions of other files would outlive a change of them. Here the stamp covers every file that has
kernels.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from autotune.core.kernel_cache import kept

Function = TypeVar("Function", bound=Callable[..., Any])
Record = Any
"""One record of a structured array, as a kernel sees it: fields are attributes."""

_SOURCES = ("friction.py", "machine.py", "own_friction.py", "own_ripple.py", "plant.py", "servo.py")


def kernel(function: Function) -> Function:
    """Compiles `function` on its first call; division by zero gives infinity, as in C.

    A kernel cannot make arrays: without reference counts (`_nrt`) calls between kernels cost nothing.
    """
    return kept(function, _stamp(), error_model="numpy", _nrt=False)


@cache
def _stamp() -> str:
    digest = hashlib.sha256()
    for name in _SOURCES:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()
