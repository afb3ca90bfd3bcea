"""A job in a process of its own: order on standard input, messages on standard output, one JSON a line.

Nothing of a job can hurt the service or another axis: not a dead drive, not a crash. The worker keeps
its end of the pipe open for reading; when the service dies the pipe ends, the job is interrupted, the
axis comes to rest and everything is put back. A job cut off in this way leaves no result, so that the
next start of the service does it again; one that a person stopped leaves the result `aborted`.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
import traceback
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import Any

from autotune.core.errors import Interrupted
from autotune.core.garbage import seldom_collected
from autotune.core.loop import Loop
from autotune.service.live_pipe import told_to_service
from autotune.service.orders import Done, Order, salvage, write_begun, write_done
from autotune.service.work import Tools, perform
from autotune.tuning.links import open_link

NICE = 5
LEAST_SECONDS = 0.2  # between two messages of progress


class PipeReporter:
    """Tells the service what the job is doing."""

    def __init__(self) -> None:
        self._told = 0.0

    def stage(self, name: str, seconds: float) -> None:
        tell({"event": "stage", "stage": name, "seconds": seconds})

    def progress(self, fraction: float) -> None:
        now = time.monotonic()
        if now - self._told >= LEAST_SECONDS or fraction >= 1.0:
            self._told = now
            tell({"event": "progress", "fraction": round(fraction, 4)})

    def say(self, sentence: str) -> None:
        tell({"event": "say", "sentence": sentence})


def tell(message: dict[str, Any]) -> None:
    """One line to the service; where nobody listens any more the job is about to be interrupted anyway."""
    try:
        sys.stdout.write(json.dumps(message) + "\n")
        sys.stdout.flush()
    except (BrokenPipeError, ValueError):
        return


class _Lifeline:
    """Interrupts the job when the service is gone."""

    def __init__(self) -> None:
        self.cut = False

    def watch(self) -> None:
        threading.Thread(target=self._wait, daemon=True).start()

    def _wait(self) -> None:
        while os.read(sys.stdin.fileno(), 4096):
            continue
        self.cut = True
        os.kill(os.getpid(), signal.SIGTERM)


def main() -> int:
    """Reads the order, does it, writes the result, tells it."""
    signal.signal(signal.SIGTERM, _interrupt)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C at the service's terminal is the service's business
    line = _first_line()
    order = Order(**json.loads(line))
    lifeline = _Lifeline()
    lifeline.watch()
    try:
        write_begun(order, os.getpid(), datetime.now().astimezone())
        done = _perform(order)
    except (KeyboardInterrupt, Interrupted) as stop:  # in this process, or in the cyclic one
        kept = salvage(Path(order.runs), order.axis, order.id)
        if lifeline.cut and kept is None:
            return 130
        done = kept or Done("aborted", 130, f"Stopped: {stop or 'the link was not open'}.")
    except Exception as error:  # noqa: BLE001 - the last line of defence: said in the history as well
        traceback.print_exc()
        done = Done("died", 5, f"Unexpected {type(error).__name__}, a defect of autotune: {error}")
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    write_done(order, done)
    tell({"event": "done", **done.as_json()})
    return 0


def _perform(order: Order) -> Done:
    from autotune.core.axis import read_axis
    from autotune.core.errors import AutotuneError

    try:
        axis = read_axis(order.file)
    except AutotuneError as error:
        return Done("refused", error.exit_code, str(error))
    directory = Path(order.file).resolve().parent
    with told_to_service() as observers:
        tools = Tools(
            axis,
            lambda: _behind(open_link(axis, directory, Path(order.runs))),
            PipeReporter(),
            lambda: datetime.now().astimezone(),
            observers,
        )
        return perform(order, tools)


def _behind(loop: Loop) -> Loop:
    """Fits wait for the service and for cyclic loops, whose process was there before and keeps its place."""
    os.nice(max(NICE - os.nice(0), 0))
    return loop


def _first_line() -> bytes:
    """Unbuffered: what follows must stay in the pipe for the lifeline."""
    line = bytearray()
    while not line.endswith(b"\n"):
        byte = os.read(sys.stdin.fileno(), 1)
        if not byte:
            break
        line += byte
    return bytes(line)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    seldom_collected()
    sys.exit(main())
