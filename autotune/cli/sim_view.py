"""`autotune sim --view`: what is true on the simulated axis, whatever its drive says of it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from autotune.cli.live_view import live_view
from autotune.core.arrays import Floats
from autotune.core.axis import Axis
from autotune.core.loop import ROW_FIELDS, Watch
from autotune_sim.truth import Rows, Truth

MODES = ("without power", "position", "velocity", "torque")
CAPACITY = 1 << 16
POLL = 0.1
_COLUMNS = {"position": "position", "velocity": "velocity", "torque_command": "demanded", "torque": "torque"}


@contextmanager
def shown_truth(axis: Axis, wanted: bool) -> Iterator[Truth | None]:
    """The log that the simulation writes to, shown while the block lasts; None where that is not wanted."""
    if not wanted:
        yield None
        return
    truth, ending = Truth(capacity=CAPACITY), threading.Event()
    with live_view(axis) as live:
        watch = live.programme(MODES)
        thread = threading.Thread(target=_poll, args=(truth, watch, ending), name="sim-view", daemon=True)
        thread.start()
        try:
            yield truth
        finally:
            ending.set()
            thread.join(1.0)


def _poll(truth: Truth, watch: Watch, ending: threading.Event) -> None:
    last = 0
    while not ending.wait(POLL):
        rows, last = fresh(truth.buffer, last)
        if len(rows):
            watch(as_samples(rows))


def fresh(buffer: Rows, last: int) -> tuple[Rows, int]:
    """Rows after number `last` that are written, and the number of the newest; those overwritten are skipped."""
    order = (last + 1 + np.arange(len(buffer) - 1)) % len(buffer)
    time = buffer["time"][order]
    newer = time > buffer["time"][last]
    count = int(np.argmin(newer)) if not newer.all() else len(newer)
    if not count:
        return buffer[:0], last
    return np.array(buffer[order[:count]]), int(order[count - 1])


def as_samples(rows: Rows) -> Floats:
    """Rows of the live view, shape (k, len(ROW_FIELDS)); the label is the drive's mode."""
    found = np.full((len(rows), len(ROW_FIELDS)), np.nan)
    column = {name: index for index, name in enumerate(ROW_FIELDS)}
    found[:, column["time"]] = rows["time"]
    for name, field in _COLUMNS.items():
        found[:, column[name]] = rows[field]
    controlled = rows["mode"] == 0
    found[:, column["reference"]] = np.where(controlled, rows["target"], rows["position"])
    found[:, column["temperature"]] = rows["temperature"]
    found[:, column["missed"]] = found[:, column["repeat"]] = 0.0
    found[:, column["label"]] = rows["mode"] + 1
    return found
