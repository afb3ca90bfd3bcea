"""Whether some program has an axis at this moment."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path


def axis_busy(runs: Path, axis: str) -> bool:
    """The lock of `run_directory.axis_lock` is held; it is not touched by asking."""
    try:
        descriptor = os.open(runs / f".{axis}.lock", os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    else:
        return False
    finally:
        os.close(descriptor)
