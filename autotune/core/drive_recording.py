"""What a drive has recorded by itself, and the loop that can ask for it (joined in `recordings.joining`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from autotune.core.arrays import Floats, Integers


@dataclass(frozen=True, slots=True)
class DriveRecording:
    """One segment of the drive's recorder.

    Attributes:
        columns: by the names of a recording, SI, motor side; shape (n,) each.
        sync: SYNC counter in each sample, low word, shape (n,).
        cycle: the drive's own cycle counter, low word, shape (n,); steps by 1 where nothing is lost.
        period: of the drive's samples [s].
        marks: (host's cycle, SYNC counter's low word), one wherever their difference has changed.
    """

    columns: Mapping[str, Floats]
    sync: Integers
    cycle: Integers
    period: float
    marks: tuple[tuple[int, int], ...]


@runtime_checkable
class RecordingLoop(Protocol):
    """A loop whose drive may have a recorder."""

    def recorder_seconds(self) -> float:
        """How long the drive can record without a gap [s]; 0 where it cannot."""

    def begin_recording(self, seconds: float) -> None:
        """Starts the recorder; it takes samples from the moment at which power comes on."""

    def end_recording(self) -> DriveRecording:
        """Stops the recorder and fetches what it has."""
