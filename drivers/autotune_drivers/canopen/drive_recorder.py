"""The drive's own data recorder, as a profile describes it: set up, started, fetched by block upload.

The drive samples by itself, so a loaded host loses nothing: it only fetches, with the axis at rest.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.drive_recording import DriveRecording
from autotune.core.errors import ConfigurationError, LinkError
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.session import Session
from autotune_drivers.profile import Profile, Recorder
from autotune_drivers.signals import Signal
from autotune_drivers.units import Units

COUNTERS = ("sync", "cycle")
_UNSIGNED = ("temperature",)


class DriveRecorder:
    """The recorder of one drive; `period` is the cycle that is recorded at where the drive lets one choose."""

    def __init__(self, sdo: Sdo, session: Session, profile: Profile, units: Units, period: float) -> None:
        self._sdo, self._session, self._units = sdo, session, units
        self._recorder = profile.recorder
        self._cycle = period

    @property
    def seconds(self) -> float:
        """How long it records without a gap [s]; 0 where there is none, or it cannot be joined."""
        recorder = self._recorder
        if recorder is None or not set(COUNTERS) <= set(recorder.columns):
            return 0.0
        return recorder.capacity * self._period(recorder)

    def begin(self, seconds: float) -> None:
        """Sets it up and starts it; a trigger, where the profile has one, begins with power.

        Raises:
            ConfigurationError: longer than it can hold. LinkError: refused.
        """
        recorder = self._need()
        wanted = round(seconds / self._period(recorder)) + 1
        if not 1 <= wanted <= recorder.capacity:
            raise ConfigurationError(
                f"{seconds:.1f} s are {wanted} samples, the drive's recorder holds 1 to {recorder.capacity}; "
                "record less in one go"
            )
        self._sdo.write(recorder.control, recorder.stop)
        for channel, ref in enumerate(recorder.channels):
            signals = list(recorder.columns.values())
            self._session.write(ref, signals[channel].ref.mapping() if channel < len(signals) else 0)
        for text, value in recorder.setup.items():
            ref = ObjectRef.parse(text)
            self._session.write(ref, ref.raw(value))
        if recorder.period is not None:
            at = recorder.period
            self._session.write(at.ref, at.ref.raw(self._cycle / self._units.factor(at.unit)))
        self._session.write(recorder.wanted, wanted)
        self._sdo.write(recorder.control, recorder.start)

    def end(self, marks: tuple[tuple[int, int], ...]) -> DriveRecording:
        """Stops it and fetches everything.

        Raises:
            LinkError: nothing recorded, or not as much as the drive says.
        """
        recorder = self._need()
        self._sdo.write(recorder.control, recorder.stop)
        count = int(self._sdo.read(recorder.recorded))
        if not count:
            raise LinkError(
                "the drive's recorder has recorded nothing: its trigger did not come. Check recorder.setup in "
                "the profile"
            )
        raw = self._rows(recorder, count) if recorder.layout == "rows" else self._columns(recorder, count)
        sync, cycle = (np.asarray(raw[name], dtype=np.int64) for name in COUNTERS)
        columns = {
            name: self._si(name, signal, raw[name])
            for name, signal in recorder.columns.items()
            if name not in COUNTERS
        }
        _add_feedforward(columns)
        return DriveRecording(columns, sync, cycle, self._period(recorder), marks)

    def stop(self) -> None:
        """Stops it, whatever it does. Raises LinkError."""
        if self._recorder is not None:
            self._sdo.write(self._recorder.control, self._recorder.stop)

    def _need(self) -> Recorder:
        if self._recorder is None:
            raise ConfigurationError("this drive's profile has no recorder; record over the link")
        return self._recorder

    def _period(self, recorder: Recorder) -> float:
        return self._cycle if recorder.sample_seconds is None else recorder.sample_seconds

    def _rows(self, recorder: Recorder, count: int) -> Mapping[str, Floats]:
        signals = recorder.columns
        layout = struct.Struct("<" + "".join(signal.ref.format for signal in signals.values()))
        data = self._sdo.read_block(recorder.data[0])
        if len(data) != count * layout.size:
            raise LinkError(
                f"the drive's recorder tells {count} samples of {layout.size} bytes, but {len(data)} bytes came; "
                "the profile's recorder.columns do not fit this firmware"
            )
        fields = [(name, "<" + signal.ref.format) for name, signal in signals.items()]
        table: Any = np.frombuffer(data, dtype=np.dtype(fields))
        return {name: table[name].astype(np.float64) for name in signals}

    def _columns(self, recorder: Recorder, count: int) -> Mapping[str, Floats]:
        found = {}
        for (name, signal), ref in zip(recorder.columns.items(), recorder.data, strict=False):
            data = self._sdo.read_block(ref)
            if len(data) < count * signal.ref.size:
                raise LinkError(
                    f"{name} came with {len(data)} bytes for {count} samples; the profile does not fit"
                )
            values = np.frombuffer(data, dtype="<" + signal.ref.format, count=count)
            found[name] = values.astype(np.float64)
        return found

    def _si(self, name: str, signal: Signal, raw: Floats) -> Floats:
        units = self._units
        return raw * (units.factor(signal.unit) if name in _UNSIGNED else units.signed(signal.unit))


def _add_feedforward(columns: dict[str, Floats]) -> None:
    """The host's and the drive's own feedforward are what the demand has beyond the controller's."""
    if "torque_command" in columns and "torque_feedback" in columns:
        columns["torque_feedforward"] = columns["torque_command"] - columns["torque_feedback"]
