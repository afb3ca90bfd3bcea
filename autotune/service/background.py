"""Becomes another Python command that stands behind everything else on this host.

The service runs before ordinary programs (`Nice=-5` in its unit), and a child inherits that, and a real-time policy
where there is one. This lets go of both before anything of the command begins.

    python -m autotune.service.background -m autotune.service.study diagnose RECORDING MODEL
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress

NICE = 10


def main() -> None:
    """Never returns."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])  # noqa: S606 - our own interpreter, without a shell


if __name__ == "__main__":
    main()
