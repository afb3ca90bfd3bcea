"""The cyclic loop: who plays an experiment on a drive, and how its samples get out.

On a real link the loop is a process of its own (`autotune_drivers.cyclic.loop`), so that fits, plots and
logging cannot delay it; in process (`LocalLoop`) it is a plain call. A routine is the same in both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, TypeVar

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.drive import Drive, Sample

ROW_FIELDS = (*Sample._fields, "label", "repeat")
ROWS_PER_BLOCK = 50

Result = TypeVar("Result")
Result_co = TypeVar("Result_co", covariant=True)
Publish = Callable[[Sample, int, int], None]
"""Called once a cycle with the sample, the index of its label in `Routine.labels`, and the repeat."""
Watch = Callable[[Floats], None]
"""Called with blocks of rows of shape (k, len(ROW_FIELDS)), in order, none twice."""


def power_in_words(power: bool | None) -> str:
    """What may be said of an axis after an interruption. `power`: as its drive tells it; None: nobody knows."""
    if power is False:
        return "the axis is without power, as the drive confirms"
    return (
        "it is NOT confirmed that the axis is at rest and without power: look at it, and use the emergency stop if it "
        "moves"
    )


class Routine(Protocol[Result_co]):
    """What is played on the drive; picklable, as it may travel to another process.

    It enables the drive, steps it, and disables it in `finally`. What it returns or raises reaches
    the caller of `Loop.play`.
    """

    @property
    def labels(self) -> Sequence[str]:
        """Names of the segments that it publishes."""

    def __call__(self, drive: Drive, publish: Publish) -> Result_co: ...


class Loop(Protocol):
    """The owner's side of the cyclic loop. Parameters are accessed at rest, between routines."""

    @property
    def period(self) -> float: ...

    @property
    def identity(self) -> Mapping[str, int | str]: ...

    def play(self, routine: Routine[Result], watch: Watch | None = None) -> Result:
        """Plays a routine to its end; `watch` sees the rows while it runs.

        All rows have been passed to `watch` when this returns or raises.
        Raises: what the routine raised; Interrupted on KeyboardInterrupt, after the axis is at rest.
        """

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]: ...

    def write_parameters(self, values: Mapping[str, float]) -> None: ...

    def store(self) -> None: ...

    def faults(self) -> list[str]: ...

    def close(self) -> None: ...


class LocalLoop:
    """Plays routines in this process; for drives that own their time (simulated, replayed)."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self.power: bool | None = False
        """What the drive has last told of its power; None while nobody knows."""

    @property
    def period(self) -> float:
        return self._drive.period

    @property
    def identity(self) -> Mapping[str, int | str]:
        return self._drive.identity

    def play(self, routine: Routine[Result], watch: Watch | None = None) -> Result:
        rows: list[tuple[float, ...]] = []

        def flush() -> None:
            if watch is not None and rows:
                watch(np.array(rows, dtype=np.float64))
            rows.clear()

        def publish(sample: Sample, label: int, repeat: int) -> None:
            rows.append((*sample, label, repeat))
            if len(rows) >= ROWS_PER_BLOCK:
                flush()

        self.power = None
        try:
            return routine(self._drive, publish)
        finally:
            try:
                self._drive.disable()
                self.power = False
            finally:
                flush()

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        return self._drive.read_parameters(names)

    def write_parameters(self, values: Mapping[str, float]) -> None:
        self._drive.write_parameters(values)

    def store(self) -> None:
        self._drive.store()

    def faults(self) -> list[str]:
        return self._drive.faults()

    def close(self) -> None:
        self._drive.close()
