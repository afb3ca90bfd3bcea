"""Compiled kernels: numba's decorator with types that a type checker understands.

The kernels work on records: structured arrays of length one, whose fields carry the names of the
physics. Compiled code is cached on disk, so that only the first process after an installation waits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])
Record = Any
"""One record of a structured array, as a kernel sees it: fields are attributes."""


def kernel(function: Function) -> Function:
    """Compiles `function` on its first call; division by zero gives infinity, as in C."""
    return cast(Function, numba.njit(cache=True, error_model="numpy")(function))
