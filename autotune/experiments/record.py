"""The owner's side of a programme: rows become a recording, and progress is told as it goes.

Both are watches for `Loop.play`. A recorder has everything that was measured also when the programme
was stopped half-way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.axis import Axis
from autotune.core.loop import ROW_FIELDS, Loop, Watch
from autotune.experiments.path import ABANDONED
from autotune.experiments.runner import Played, Programme
from autotune.recordings.recording import (
    CONDITIONING,
    FLOAT_COLUMNS,
    Controller,
    Metadata,
    Recording,
    Segment,
)

_LABEL, _REPEAT, _MISSED = (ROW_FIELDS.index(name) for name in ("label", "repeat", "missed"))
_COLUMNS = {name: ROW_FIELDS.index(name) for name in FLOAT_COLUMNS}


class Recorder:
    """Collects rows; `recording` can be asked for at any time."""

    def __init__(self, metadata: Metadata, labels: Sequence[str]) -> None:
        self._metadata = metadata
        self._labels = np.array(labels, dtype=np.str_)
        self._blocks: list[Floats] = []

    def watch(self, rows: Floats) -> None:
        """Takes rows of shape (k, len(ROW_FIELDS))."""
        self._blocks.append(rows)

    @property
    def machine_seconds(self) -> float:
        """Machine time in the rows so far, lost cycles included [s]."""
        cycles = sum(len(rows) + float(rows[:, _MISSED].sum()) for rows in self._blocks)
        return float(cycles * self._metadata.sample_period)

    def recording(self) -> Recording:
        """All rows so far, in order; empty where nothing was played."""
        table = np.concatenate([np.empty((0, len(ROW_FIELDS))), *self._blocks])
        recording = Recording.from_columns(
            {name: table[:, column] for name, column in _COLUMNS.items()},
            self._metadata,
            self._labels[table[:, _LABEL].astype(np.int64)],
            table[:, _REPEAT].astype(np.int64),
            table[:, _MISSED].astype(np.int64),
        )
        return without_abandoned(recording)


def without_abandoned(recording: Recording) -> Recording:
    """Calls `conditioning` what was abandoned, and the segment before it, which was to be a measurement."""
    experiment = recording.experiment.astype(
        np.result_type(recording.experiment.dtype, np.dtype(f"<U{len(CONDITIONING)}"))
    )
    before: Segment | None = None
    for segment in recording.segments():
        if segment.experiment == ABANDONED:
            experiment[segment.rows] = CONDITIONING
            if before is not None:
                experiment[before.rows] = CONDITIONING
        before = segment
    return replace(recording, experiment=experiment)


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a programme is: `seconds` of machine time, `fraction` of it, `remaining` [s], what is playing."""

    seconds: float
    fraction: float
    remaining: float
    label: str


Tell = Callable[[Progress], None]


class ProgressWatch:
    """Tells the progress of a programme, from the rows that have come and the predicted durations."""

    def __init__(self, programme: Programme, period: float, tell: Tell) -> None:
        self._total = max(programme.duration, period)
        self._labels = programme.labels
        self._period = period
        self._tell = tell
        self._seconds = 0.0

    def watch(self, rows: Floats) -> None:
        """Takes rows of shape (k, len(ROW_FIELDS))."""
        self._seconds += self._period * (len(rows) + float(rows[:, _MISSED].sum()))
        fraction = min(self._seconds / self._total, 1.0)
        label = self._labels[int(rows[-1, _LABEL])]
        self._tell(Progress(self._seconds, fraction, max(self._total - self._seconds, 0.0), label))


def metadata_for(axis: Axis, controller: Controller | None = None) -> Metadata:
    """What a recording of this axis must say about itself."""
    return Metadata(
        motion_unit=axis.motion_unit,
        sample_period=axis.cycle,
        position_resolution=axis.position_resolution,
        torque_limit=axis.limits.torque,
        controller=controller,
        axis=axis.name,
        fingerprint=axis.fingerprint,
    )


def play(
    loop: Loop, programme: Programme, recorder: Recorder, *watches: Watch, tell: Tell | None = None
) -> Played:
    """Plays a programme into a recorder, past further watches, telling its progress.

    Raises: as `Programme` does; the recorder has what was measured until then.
    """
    chain: list[Watch] = [recorder.watch, *watches]
    if tell is not None:
        chain.append(ProgressWatch(programme, loop.period, tell).watch)
    return loop.play(programme, partial(_feed, chain))


def _feed(chain: Sequence[Watch], rows: Floats) -> None:
    for watch in chain:
        watch(rows)
