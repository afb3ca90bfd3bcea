"""A recording: columns of equal length and what must be known to understand them.

Columns `time, experiment, repeat, reference, position, velocity, torque_command, torque,
torque_feedforward, torque_feedback, temperature, missed`; only `time, position, torque` must be
there, `reference` wherever the axis was controlled. SI, motor side. Files: Parquet with metadata, or
plain CSV with leading `# key: value` lines (see `recording_files`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.drive import Sample
from autotune.core.errors import RecordingError
from autotune.core.units import torque_symbol

SCHEMA_VERSION = 2
"""Since 2 a Parquet file carries a checksum of its content."""
FLOAT_COLUMNS = (
    "time",
    "reference",
    "position",
    "velocity",
    "torque_command",
    "torque",
    "torque_feedforward",
    "torque_feedback",
    "temperature",
)
COLUMNS = ("time", "experiment", "repeat", *FLOAT_COLUMNS[1:], "missed")
REQUIRED_COLUMNS = ("time", "position", "torque")
MOTION_UNITS = ("rad", "m")
CONDITIONING = "conditioning"
"""The label of all that lies between measurements: never fitted."""
RESERVED_EXPERIMENTS = (CONDITIONING, "veto", "test")


OF_FILTER = (
    "the share of a new difference in the filtered one, 1 for no filter: of a time constant T 1 - exp(-h / T), of a "
    "corner frequency f 1 - exp(-2 pi f h), h the loop's period"
)


@dataclass(frozen=True, slots=True)
class Controller:
    """u = kp·e + kd·d + ki·Σe·h, d ← d + derivative_filter·((Δr − Δy)/h − d).

    This sample's error is in the sum; the output is clamped to the torque limit with the sum held
    while clamped, applied at once and held for the sample.
    """

    kp: float
    kd: float
    ki: float
    derivative_filter: float = 1.0

    def __str__(self) -> str:
        return (
            f"pid kp={self.kp!r} kd={self.kd!r} ki={self.ki!r} derivative_filter={self.derivative_filter!r}"
        )

    @classmethod
    def parse(cls, text: str) -> Controller:
        """Reads `pid kp=60 kd=0.15 ki=6000 derivative_filter=0.5`.

        Raises:
            RecordingError: another kind of controller, an unknown key or not a number.
        """
        kind, *pairs = text.split() or [""]
        known = {"kp", "kd", "ki", "derivative_filter"}
        values = dict(pair.partition("=")[::2] for pair in pairs)
        if kind != "pid" or set(values) - known or not {"kp", "kd", "ki"} <= set(values):
            raise RecordingError(
                f"controller {text!r} is not understood; write 'pid kp=60 kd=0.15 ki=6000 "
                "derivative_filter=0.5' (the last: share of a new difference in the filtered one, 1 for no filter); "
                "leave the line out for any other law, such as cascaded loops: it is identified from the data"
            )
        try:
            gains = {name: float(value) for name, value in values.items()}
        except ValueError as error:
            raise RecordingError(f"controller {text!r}: {error}; every gain must be a number") from error
        if not np.all(np.isfinite(list(gains.values()))):
            raise RecordingError(
                f"controller {text!r} has a gain that is not finite; every gain must be a number"
            )
        smoothing = gains.get("derivative_filter", 1.0)
        if not 0.0 < smoothing <= 1.0:
            raise RecordingError(
                f"controller {text!r}: derivative_filter is {smoothing:g}, and must be above 0 and at most 1; it is "
                f"{OF_FILTER}"
            )
        return cls(**gains)


@dataclass(frozen=True, slots=True)
class Metadata:
    """What must be known to understand the columns. SI, motor side.

    Attributes:
        motion_unit: `rad` or `m`; torque is in N m or N accordingly.
        sample_period: s.
        position_resolution: one count of the position sensor, in the motion unit; None if unknown.
        torque_limit: where the drive clamps its torque; None if unknown.
        controller: the position controller in force; None if unknown (identified from data then).
        axis: name of the axis; `fingerprint`: of its configuration (`Axis.fingerprint`).
        extra: further `key: value` pairs, kept as they are.
        remarks: what reading the file gave cause to say; no part of the recording.
    """

    motion_unit: str = "rad"
    sample_period: float = 1e-3
    position_resolution: float | None = None
    torque_limit: float | None = None
    controller: Controller | None = None
    axis: str = ""
    fingerprint: str = ""
    schema: int = SCHEMA_VERSION
    extra: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    remarks: tuple[str, ...] = field(default=(), compare=False)

    @property
    def torque_unit(self) -> str:
        """What the torque is in where it is neither N m nor N: A or V of an import; else empty."""
        return self.extra.get("torque_unit", "")


@dataclass(frozen=True, slots=True)
class Segment:
    """A contiguous stretch of one experiment and repeat: rows `start` to `stop` (exclusive)."""

    experiment: str
    repeat: int
    start: int
    stop: int

    @property
    def rows(self) -> slice:
        return slice(self.start, self.stop)


@dataclass(frozen=True, slots=True)
class Recording:
    """Columns and metadata; immutable.

    Attributes:
        floats: numeric columns by name, each of shape (n,).
        experiment: name of the segment of each row, shape (n,), dtype str.
        repeat: repetition of the segment of each row, shape (n,).
        missed: cycles lost just before each row, shape (n,).
    """

    metadata: Metadata
    floats: Mapping[str, Floats]
    experiment: NDArray[np.str_]
    repeat: NDArray[np.int64]
    missed: NDArray[np.int64]

    @classmethod
    def from_columns(
        cls,
        columns: Mapping[str, Sequence[float] | Floats],
        metadata: Metadata,
        experiment: Sequence[str] | NDArray[np.str_] | str = "",
        repeat: Sequence[int] | NDArray[np.int64] | int = 0,
        missed: Sequence[int] | NDArray[np.int64] | int = 0,
    ) -> Recording:
        """Builds a recording from numeric columns.

        Raises:
            RecordingError: a required column is missing, or lengths differ.
        """
        floats = {
            name: np.ascontiguousarray(columns[name], dtype=np.float64)
            for name in FLOAT_COLUMNS
            if name in columns
        }
        missing = [name for name in REQUIRED_COLUMNS if name not in floats]
        if missing:
            raise RecordingError(
                f"column {', '.join(missing)} is missing; a recording needs {', '.join(REQUIRED_COLUMNS)} "
                f"and has {', '.join(columns) or 'none'}"
            )
        rows = len(floats["time"])
        uneven = [f"{name} ({len(values)})" for name, values in floats.items() if len(values) != rows]
        if uneven:
            raise RecordingError(f"columns differ in length: time has {rows} rows, but {', '.join(uneven)}")
        return cls(
            metadata,
            MappingProxyType(floats),
            np.broadcast_to(np.asarray(experiment, dtype=np.str_), (rows,)),
            np.broadcast_to(np.asarray(repeat, dtype=np.int64), (rows,)),
            np.broadcast_to(np.asarray(missed, dtype=np.int64), (rows,)),
        )

    @classmethod
    def from_samples(
        cls, samples: Sequence[Sample], metadata: Metadata, experiment: str, repeat: int = 0
    ) -> Recording:
        """Builds one segment from what `Drive.step` returned."""
        table = np.array(samples, dtype=np.float64).reshape(len(samples), len(Sample._fields))
        columns = {name: table[:, index] for index, name in enumerate(Sample._fields)}
        missed = columns.pop("missed").astype(np.int64)
        return cls.from_columns(columns, metadata, experiment, repeat, missed)

    def __len__(self) -> int:
        return len(self.floats["time"])

    def __contains__(self, name: str) -> bool:
        return name in self.floats

    def __getitem__(self, name: str) -> Floats:
        try:
            return self.floats[name]
        except KeyError:
            raise RecordingError(
                f"this recording has no column {name!r}; it has {', '.join(self.floats)}"
            ) from None

    @property
    def period(self) -> float:
        """Sample period [s]."""
        return self.metadata.sample_period

    def segments(self) -> list[Segment]:
        """Contiguous stretches of equal experiment and repeat, in order."""
        if len(self) == 0:
            return []
        change = (self.experiment[1:] != self.experiment[:-1]) | (self.repeat[1:] != self.repeat[:-1])
        edges = [0, *(np.flatnonzero(change) + 1).tolist(), len(self)]
        return [
            Segment(str(self.experiment[start]), int(self.repeat[start]), start, stop)
            for start, stop in itertools.pairwise(edges)
        ]

    def rows(self, selection: slice | NDArray[np.bool_] | NDArray[np.int64]) -> Recording:
        """The rows selected, as a recording of its own."""
        return Recording(
            self.metadata,
            MappingProxyType({name: values[selection] for name, values in self.floats.items()}),
            self.experiment[selection],
            self.repeat[selection],
            self.missed[selection],
        )

    def select(self, *experiments: str) -> Recording:
        """All rows of the named experiments."""
        return self.rows(np.isin(self.experiment, experiments))

    def split(self) -> Iterator[tuple[Segment, Recording]]:
        """Each segment with its rows."""
        for segment in self.segments():
            yield segment, self.rows(segment.rows)

    def with_metadata(self, **changes: object) -> Recording:
        """The same rows with some metadata replaced."""
        return replace(self, metadata=replace(self.metadata, **changes))  # type: ignore[arg-type]


def concatenate(recordings: Iterable[Recording]) -> Recording:
    """Joins recordings of one axis in the order given; columns that all of them have are kept.

    Raises:
        RecordingError: nothing to join, or the recordings are of different axes or units.
    """
    parts = list(recordings)
    if not parts:
        raise RecordingError("no recording was given; name at least one file")
    first = parts[0].metadata
    for part in parts[1:]:
        refuse_mixture(first, part.metadata)
    shared = [name for name in FLOAT_COLUMNS if all(name in part for part in parts)]
    return Recording.from_columns(
        {name: np.concatenate([part[name] for part in parts]) for name in shared},
        first,
        np.concatenate([part.experiment for part in parts]),
        np.concatenate([part.repeat for part in parts]),
        np.concatenate([part.missed for part in parts]),
    )


def refuse_twice(recordings: Sequence[Recording]) -> None:
    """Raises RecordingError where a recording, or the beginning of one, is given again.

    What is the same in both to the last digit is taken for what every repeat shows, noise included.
    """
    for (i, one), (j, other) in itertools.combinations(enumerate(recordings, 1), 2):
        if one.metadata != other.metadata:
            continue
        rows = min(len(one), len(other))
        both = [name for name in FLOAT_COLUMNS if name in one and name in other]
        if rows and all(np.array_equal(one[name][:rows], other[name][:rows]) for name in both):
            raise RecordingError(
                f"recordings {i} and {j} hold the same {rows} rows; a recording given twice shows nothing twice. "
                "Name each one once"
            )


def refuse_mixture(one: Metadata, other: Metadata) -> None:
    """Raises RecordingError where two recordings cannot be of the same axis."""
    if one.motion_unit != other.motion_unit:
        raise RecordingError(
            f"the recordings mix axes: motion unit {one.motion_unit} and {other.motion_unit}; "
            "fit each axis by itself"
        )
    if one.torque_unit != other.torque_unit:
        units = [torque_symbol(m.motion_unit, m.torque_unit) for m in (one, other)]
        raise RecordingError(
            f"the recordings mix units: torque in {units[0]} and in {units[1]}; import both alike, with the same "
            "--torque-unit or a torque constant"
        )
    if one.fingerprint and other.fingerprint and one.fingerprint != other.fingerprint:
        raise RecordingError(
            f"the recordings mix axes: {one.axis or one.fingerprint} and {other.axis or other.fingerprint}; "
            "fit each axis by itself"
        )
