"""A recording as a drive: the samples that a real one gave, for the same programme again.

`replay:recording.parquet` plays a file beside the axis file. What the axis would have done under another
command a recording cannot tell, so a position command has to be the recorded reference. Parameters are
what the recording knows of its controller; what is written is forgotten at the end.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from autotune.core.drive import Command, Mode, Sample, Standing
from autotune.core.errors import ConfigurationError, DriveError, LinkError, StateError
from autotune.recordings.files import read_recording
from autotune.recordings.recording import Recording

_ROUNDING = 1.01
_FINEST = 1e-9


class ReplayDrive:
    """Plays a recording row by row; `name` is what errors call it."""

    def __init__(self, recording: Recording, name: str) -> None:
        self._recording = recording
        self._name = name
        self._columns = [_column(recording, field) for field in Sample._fields[:-1]]
        self._missed = recording.missed
        self._row = 0
        self._mode: Mode | None = None
        self._parameters = _parameters(recording)
        resolution = recording.metadata.position_resolution or 0.0
        self._tolerance = max(resolution * _ROUNDING, _FINEST)
        self._closed = False

    @property
    def period(self) -> float:
        return self._recording.period

    @property
    def identity(self) -> Mapping[str, int | str]:
        metadata = self._recording.metadata
        return MappingProxyType(
            {
                "vendor": "autotune",
                "product": "recording",
                "revision": metadata.schema,
                "serial": metadata.fingerprint,
                "name": metadata.axis or self._name,
                "firmware": "",
            }
        )

    def look(self) -> Standing:
        """Where the next row begins; as nothing moves before power is on, at rest."""
        position = self._columns[Sample._fields.index("position")]
        return Standing(float(position[min(self._row, len(position) - 1)]), 0.0)

    def enable(self, mode: Mode) -> None:
        if self._closed:
            raise LinkError(f"the recording {self._name} is closed; open it again")
        if self._mode is not None:
            self._mode = None
            raise StateError("enable was asked for while power was on; disable first")
        self._mode = mode

    def step(self, command: Command) -> Sample:
        """The next row.

        Raises:
            StateError: not enabled. LinkError: the recording has ended.
            DriveError: another position than the recorded one, or no number.
        """
        if self._mode is None:
            raise StateError("a cycle was asked for while power is off; enable the drive first")
        if self._row >= len(self._recording):
            raise LinkError(
                f"the recording {self._name} has ended after {len(self._recording)} cycles; replay the programme "
                "that it was made with"
            )
        self._check(command)
        row, self._row = self._row, self._row + 1
        return Sample._make([*(float(column[row]) for column in self._columns), int(self._missed[row])])

    def _check(self, command: Command) -> None:
        if not all(map(math.isfinite, command[1:])):
            raise DriveError(f"{command} cannot be replayed: every value must be a finite number")
        recorded = float(self._columns[Sample._fields.index("reference")][self._row])
        if self._mode is not Mode.POSITION or math.isnan(command.position) or math.isnan(recorded):
            return
        if abs(command.position - recorded) > self._tolerance:
            raise DriveError(
                f"cycle {self._row} of {self._name} was recorded at reference {recorded:.9g}, but "
                f"{command.position:.9g} is commanded; a recording cannot tell what the axis would have done. "
                "Replay the programme that it was made with"
            )

    def disable(self) -> None:
        self._mode = None

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        wanted = list(self._parameters) if names is None else names
        return {name: self._parameters[self._known(name)] for name in wanted}

    def write_parameters(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            self._known(name)
            if not math.isfinite(value):
                raise ConfigurationError(f"{name} is {value}; it must be a finite number")
        self._parameters |= dict(values)

    def _known(self, name: str) -> str:
        if name not in self._parameters:
            near = difflib.get_close_matches(name, self._parameters, 1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}" if near else f"it has {', '.join(self._parameters) or 'none'}"
            raise ConfigurationError(f"the recording {self._name} knows no parameter {name!r}; {hint}?")
        return name

    def store(self) -> None:
        raise DriveError(
            f"the recording {self._name} is no drive that could store anything; nothing was stored"
        )

    def faults(self) -> list[str]:
        return []

    def close(self) -> None:
        self.disable()
        self._closed = True


def open_replay(path: Path) -> ReplayDrive:
    """Opens a recording as a drive. Raises RecordingError: no such file, or no recording."""
    return ReplayDrive(read_recording(path), path.name)


def _column(recording: Recording, field: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """A column of the recording; nan where it has none."""
    if field in recording:
        return recording[field]
    return np.full(len(recording), math.nan)


def _parameters(recording: Recording) -> dict[str, float]:
    metadata = recording.metadata
    found: dict[str, float] = {}
    if metadata.controller is not None:
        controller = metadata.controller
        found = {
            "controller.kp": controller.kp,
            "controller.kd": controller.kd,
            "controller.ki": controller.ki,
            "controller.derivative_filter": controller.derivative_filter,
        }
    if metadata.torque_limit is not None:
        found["limit.torque"] = metadata.torque_limit
    return found
