"""One thread of linear algebra a process: at the sizes met here several only wait for each other.

Only a program that owns its process says so, before numpy is loaded for the first time; a library leaves the
process of others as it is. Processes started later inherit it.
"""

from __future__ import annotations

import os

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def one_thread() -> None:
    """Asks for one thread, unless somebody asked for another number."""
    for name in VARIABLES:
        os.environ.setdefault(name, "1")
