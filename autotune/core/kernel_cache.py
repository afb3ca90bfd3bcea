"""Machine code that numba keeps on disk, safe for processes side by side.

numba numbers the files of machine code and writes its index before them: a process that reads the index in between
loads what stood under that number, from older code or for other arguments, and computes with it (a spring's torque
read from another parameter's place, without a word). Here every such file has a name of its own.
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import uuid
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import njit

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def kept(function: Kernel, stamp: str, **options: Any) -> Kernel:
    """Compiles `function` on its first call, and keeps the machine code as long as `stamp` is the same.

    Args:
        stamp: of all code that the kernel is made of; numba itself looks at the function's own file only.
        options: of `numba.njit`.
    """
    dispatcher: Any = njit(cache=True, **options)(function)
    files = getattr(dispatcher._cache, "_cache_file", None)
    if files is None or not (hasattr(files, "_source_stamp") and hasattr(files, "_data_name")):
        return njit(**options)(function)  # type: ignore[no-any-return]
    _keep_apart(files, stamp)
    return dispatcher  # type: ignore[no-any-return]


def kernel(function: Kernel) -> Kernel:
    """A kernel that calls none of other files; division by zero gives infinity, as in C."""
    return kept(function, digest(Path(function.__code__.co_filename)).hex(), error_model="numpy", nogil=True)


@cache
def digest(file: Path) -> bytes:
    """Of a file's content."""
    return hashlib.sha256(file.read_bytes()).digest()


def _keep_apart(files: Any, stamp: str) -> None:
    """Gives a kernel's cache its stamp, and every file of machine code a name that was never used.

    What older code has left is removed when newer is kept; a process that still runs it compiles it again.
    """
    base = str(files._index_name).removesuffix(".nbi")
    version = f"{base}.{stamp[:12]}"

    def named(_number: int) -> str:
        for old in Path(files._cache_path).glob(f"{glob.escape(base)}.*.nbc"):
            if not old.name.startswith(f"{version}."):
                with contextlib.suppress(OSError):
                    old.unlink()
        return f"{version}.{uuid.uuid4().hex[:12]}.nbc"

    files._source_stamp, files._data_name = stamp, named
