"""Compiled kernels whose cache knows all the code they are made of.

numba keeps compiled code beside the source and looks only at the file of the function itself; a kernel
that calls functions of other files would stay in use after those have changed. Here the stamp covers
every file of the kernel's own package and of this one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import njit

from autotune.core.kernel_cache import digest, kept

Kernel = TypeVar("Kernel", bound=Callable[..., Any])
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "forceinline": True, "nogil": True}


def compiled(function: Kernel) -> Kernel:
    """Compiles `function` on its first call and keeps the machine code for later processes.

    A kernel works on the arrays it is given and cannot make new ones: without numba's reference counts
    (`_nrt`) on every call between kernels, the plant runs five to nine times faster, and built into one
    routine (`forceinline`) a quarter faster again: as fast as the same loop in C.
    """
    return kept(function, _stamp(function.__code__.co_filename), **_OPTIONS)


def built_in(function: Kernel) -> Kernel:
    """Compiles a kernel that only others call: its machine code is kept in theirs."""
    return njit(**_OPTIONS)(function)  # type: ignore[no-any-return]


def _stamp(own: str) -> str:
    return hashlib.sha256(_package(Path(own).parent) + _package(Path(__file__).parent)).hexdigest()


@cache
def _package(folder: Path) -> bytes:
    whole = hashlib.sha256()
    for file in sorted(folder.glob("*.py")):
        whole.update(digest(file))
    return whole.digest()
