"""Whether this machine ran while a test did: whoever only sleeps on a processor knows how late it was woken.

Tests over a wire play in the time of the machine they run on. Where one of its processors stands still for a tenth of a
second (taken away by a host of virtual machines, or its share of time used up), the drive's guard stops the axis, as it
must, and the test says nothing of the program. It is run again then (`conftest.py`), and what was run again is told. A
test that fails on a machine that ran is never run again.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import tempfile
import threading
import time

NAP = 0.02
STOOD_STILL = 0.05
"""A third of what the drive's guard allows, in seconds."""


class Witness:
    """A process with a thread on each processor, and what they have seen: when one stood still, and for how long."""

    def __init__(self) -> None:
        self._told = tempfile.TemporaryFile("w+")  # noqa: SIM115 — closed by `close`
        self.process = subprocess.Popen(
            [sys.executable, "-S", "-E", __file__], stdin=subprocess.PIPE, stdout=self._told
        )
        atexit.register(self.close)
        while not os.fstat(self._told.fileno()).st_size:
            time.sleep(NAP)

    def longest_since(self, began: float) -> float:
        """The longest standstill that ended after `began` [s, monotonic clock]; 0 where there was none."""
        time.sleep(2 * NAP)  # the last one is told when it is over
        self._told.seek(0)
        told = [tuple(map(float, line.split())) for line in self._told]
        return max((seconds for at, seconds in told if at >= began), default=0.0)

    def close(self) -> None:
        self.process.terminate()
        self.process.communicate()
        self._told.close()


def sleep_on(processor: int) -> None:
    """Tells when this processor stood still."""
    os.sched_setaffinity(0, [processor])  # of this thread
    due = time.monotonic() + NAP
    while True:
        time.sleep(max(due - time.monotonic(), 0.0))
        now = time.monotonic()
        if now - due > STOOD_STILL:
            print(f"{now} {now - due}\n", end="", flush=True)
        due = now + NAP


def main() -> None:
    """Until its input is closed, which the end of whoever asked for it does."""
    for processor in os.sched_getaffinity(0):
        threading.Thread(target=sleep_on, args=(processor,), daemon=True).start()
    print("0 0", flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()
