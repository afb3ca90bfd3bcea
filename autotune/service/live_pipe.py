"""A worker's end of the live traces: what it tells goes to the service through a pipe, and nothing waits for that."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from autotune.tuning.observer import Observer
from autotune.view.messages import write_all
from autotune.view.teller import Teller

VARIABLE = "AUTOTUNE_LIVE_PIPE"
"""Names the pipe's file descriptor."""
PATIENCE = 1e6  # s; a service that is held up is waited for by this thread alone
LAST_SECONDS = 1.0


@contextmanager
def told_to_service() -> Iterator[Sequence[Observer]]:
    """Who looks on for the service; nobody where it has given no pipe."""
    text = os.environ.pop(VARIABLE, "")
    if not text.isdigit():
        yield ()
        return
    pipe = int(text)
    os.set_inheritable(pipe, False)
    os.set_blocking(pipe, False)
    teller, ending = Teller(), threading.Event()
    thread = threading.Thread(target=_write, args=(teller, pipe, ending), name="live-pipe", daemon=True)
    thread.start()
    try:
        yield (teller,)
    finally:
        ending.set()
        thread.join(LAST_SECONDS)


def _write(teller: Teller, pipe: int, ending: threading.Event) -> None:
    try:
        while not (ending.is_set() and not teller.waiting()):
            data = teller.take()
            if data and not write_all(pipe, data, PATIENCE):
                return
            time.sleep(0.02)
    except OSError:
        return  # the service is gone; the job is about to be interrupted
    finally:
        os.close(pipe)
