"""A recording made ready for comparison: motion, grid of rows, blocks of repeats, roles.

Torque and motion are compared on a coarse grid that starts anew in every segment, so that the repeats of
an experiment can be subtracted row by row. Segments `conditioning` are never fitted, `veto` only gates,
`test` is only reported on; everything else is training data.

Parts of it are as much as a fit looks at, and as much as its sensitivities need. What comes after the last fitted row
(veto and test) need not be computed during a fit. Sensitivities are the same in every repeat of an experiment, as long
as nothing but the motion decides them: they are taken on the first round and copied.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Flags, Floats, Integers
from autotune.core.errors import NotEnoughExcitation
from autotune.models import layout
from autotune.models.table import EFFECTS
from autotune.recordings.checks import check_recording, torque_of
from autotune.recordings.recording import CONDITIONING, Metadata, Recording, Segment, refuse_mixture
from autotune.signals.chunks import CHUNK
from autotune.signals.filters import motion
from autotune.signals.late_rows import in_time
from autotune.signals.missing_codes import Gap, missing_codes
from autotune.signals.periodic import Periodic, periodic

MOTION_CUTOFF = 150.0  # Hz, of position, velocity and acceleration
LEAST_ROWS = 50  # of a stretch: a shorter one tells nothing, and is too short for filters and twins
CUTOFF = 60.0  # Hz, of everything that is compared
FASTEST = 0.09
"""Of the sampling rate: faster motion cannot be had from central differences."""
GRID = 200.0  # Hz
LEAST_CHUNK = 20  # grid rows
STANDSTILL_COUNTS = 2.1
STANDSTILL_SECONDS = 0.01
CHUNK_SECONDS = 2.0
TRAINING, VETO, TEST = "training", "veto", "test"
_ROLES = {"veto": VETO, "test": TEST}
SETTLED = 6.0
"""Periods of the motion's cut-off: so far away a filter does not feel the end of what it is given."""
FORGOTTEN = 20.0
"""The same where nothing may be told from all the data: its slowest part falls to e^-48, less than rounding."""
SAME_PLACE = 0.01
"""Of the travel: repeats that are further apart are not the same motion."""
_DRIFTING = [layout.flag(kind.name) for kind in EFFECTS.values() if kind.drifts]
_Scalar = TypeVar("_Scalar", bound="np.generic[Any]")


@dataclass(frozen=True, slots=True)
class Block:
    """One experiment with its repeats: rows `start` to `start + repeats·count` of the grid."""

    name: str
    role: str
    start: int
    repeats: int
    count: int

    @property
    def rows(self) -> slice:
        return slice(self.start, self.start + self.repeats * self.count)

    def by_repeat(self, values: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Values on the grid's rows, shape (m,), as a table of this experiment, shape (repeats, count)."""
        return values[self.rows].reshape(self.repeats, self.count)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Contiguous samples `start` to `stop`; `closed` where a position controller was at work."""

    start: int
    stop: int
    closed: bool

    @property
    def rows(self) -> slice:
        return slice(self.start, self.stop)


@dataclass(frozen=True, slots=True)
class Clocked:
    """A torque of one frequency [Hz] whose phase runs on through a whole recording: mains, a fan, a pump.

    `sine` and `cosine` are its parts [N m or N]; `shift` is that of the torque when they were found, `share` what it
    was of the variance that the model left.
    """

    hertz: float
    sine: float
    cosine: float
    shift: float
    share: float = 0.0

    def torque(self, data: Prepared) -> Floats:
        """Sample by sample, shape (n,)."""
        late = 0.5 * (data.shift - self.shift)
        angle = 2.0 * math.pi * self.hertz * data.period * (np.arange(len(data.torque)) + late)
        return np.asarray(self.sine * np.sin(angle) + self.cosine * np.cos(angle))


@dataclass(frozen=True, slots=True)
class Wander:
    """A level of the torque that wanders through a recording: a sensor's zero, an amplifier's offset, what is warmed.

    `levels` [N m or N] at `times` from its first sample on [s], shape (k,) each; a line from one to the next.
    """

    times: Floats
    levels: Floats

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.levels**2)))

    def torque(self, data: Prepared) -> Floats:
        """Sample by sample, shape (n,)."""
        return np.asarray(np.interp(data.period * np.arange(len(data.torque)), self.times, self.levels))


MOST_OF_A_LINE = 2.0**16
"""Counts: encoders and drives divide a period of sine and cosine by 2^14 at most; two bits more are beyond all."""


@dataclass(frozen=True, slots=True)
class ReadingWave:
    """What an encoder tells too much over the place it tells, as one does that interpolates its lines.

    Attributes:
        wavenumber: of one period of the scale [rad/motion unit].
        parts: sine and cosine of one wave a period, as offsets of its signals make it, then of two, as unequal sizes
            and a phase that is off do [motion unit].
    """

    wavenumber: float
    parts: tuple[float, float, float, float]

    def error(self, measured: Floats) -> Floats:
        """At readings of shape (n,) [motion unit]."""
        angle = self.wavenumber * measured
        one, two = np.exp(1j * angle), np.exp(2j * angle)
        sine, cosine, sine_2, cosine_2 = self.parts
        return np.asarray(sine * one.imag + cosine * one.real + sine_2 * two.imag + cosine_2 * two.real)

    def interpolated(self, resolution: float) -> bool:
        """Whether a period has no more counts of this size [motion unit] than a line is divided into; 0: unknown."""
        return 2.0 * math.pi / self.wavenumber <= MOST_OF_A_LINE * resolution or resolution <= 0.0

    @property
    def size(self) -> float:
        """How much it tells too much at most [motion unit]."""
        return math.hypot(*self.parts[:2]) + math.hypot(*self.parts[2:])

    @property
    def steepest(self) -> float:
        """Its largest slope over place at most; from 1 on the reading would go backwards."""
        return self.wavenumber * (math.hypot(*self.parts[:2]) + 2.0 * math.hypot(*self.parts[2:]))


@dataclass(frozen=True, slots=True)
class Prepared:
    """Arrays of shape (n,) by sample, (m,) by grid row. SI, motor side.

    Attributes:
        torque: demand held from each sample to the next; `feedforward`: part of it, 0 where not known.
        position, velocity, acceleration: zero-phase filtered; `measured`: the raw position.
        grid: samples at the centre of each grid row.
        taps: zero-phase low-pass that every torque goes through, shape (odd,).
        sensed: the torque by its own sensor, where the files hold it beside the demand, shape (n,).
        recorded_torque: as it was in the file; `torque` is this, moved by `shift` half samples, in which are `cycles`
            of the file that a bus takes, and through a current loop of time constant `lag` ± `lag_error` [s].
        late: samples by which `torque` was taken later than it was recorded.
        filtered: one side was put through a low-pass that the file's other column had gone through.
        coarse: the encoder's counts are a part of the acceleration that is compared, and no twin makes the same.
        starts: first sample of each recording.
        temperature: °C, shape (n,); None unless every recording has it.
        steady: only the curve of torque over constant speeds is compared (see `speed_curve`).
        upsampling: rows for each one of the file.
        periodic: stretches whose motion repeats itself: they are held out by phase.
        pace: what lengths of time are multiplied by (`bandwidth.Bands.pace`).
        clocked: torques that follow the clock; what is compared has none of them.
        wander: what the torque's level does by itself; what is compared has none of it.
        reading: what the encoder's interpolation tells too much; the filtered motion has none of it, `measured` has.
        certainty: how much each grid row counts, at most 1: the usual noise over its own; None: all alike.
        load_in_twin: a load beyond a transmission moves in runs of the twin only; motions go through the inverse of the
            rigid axis, the measured one and the twin's (`residual`).
        asked: what the controller asks for along `measured`, where that is compared and not the torque as recorded,
            from each sample to the next, shape (n,); the twin's torque is then what it asks for along the twin's.
        gaps: where the encoder leaves codes out, as the file has them.
    """

    metadata: Metadata
    period: float
    resolution: float
    time: Floats
    reference: Floats
    measured: Floats
    torque: Floats
    feedforward: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    stretches: tuple[Stretch, ...]
    grid: Integers
    blocks: tuple[Block, ...]
    taps: Floats
    motion_cutoff: float
    recorded_reference: bool
    recorded_torque: Floats
    shift: float = 0.0
    late: float = 0.0
    lag: float = 0.0
    lag_error: float = 0.0
    cycles: int = 0
    filtered: bool = False
    coarse: bool = False
    starts: tuple[int, ...] = (0,)
    temperature: Floats | None = None
    steady: bool = False
    upsampling: int = 1
    periodic: tuple[Periodic, ...] = ()
    sensed: Floats | None = None
    pace: float = 1.0
    clocked: tuple[Clocked, ...] = ()
    wander: Wander | None = None
    reading: ReadingWave | None = None
    certainty: Floats | None = None
    load_in_twin: bool = False
    asked: Floats | None = None
    gaps: tuple[Gap, ...] = ()

    @property
    def cutoff(self) -> float:
        """Frequency below which torques are compared [Hz]."""
        return 0.9 / (self.period * max(len(self.taps) // 2, 1))

    @property
    def by_sensor(self) -> bool:
        """Whether the torque that is compared is that of its own sensor."""
        return self.recorded_torque is self.sensed

    @property
    def second(self) -> int:
        """Grid rows of about a second, at most `CHUNK`: a coarse grid has fewer in it."""
        if self.steady or len(self.grid) < 2:
            return CHUNK
        step = float(np.median(np.diff(self.grid))) * self.period
        return min(max(round(self.pace / step), LEAST_CHUNK), CHUNK)

    def role(self, *roles: str) -> Flags:
        """Grid rows of blocks with one of these roles, shape (m,)."""
        chosen = np.zeros(len(self.grid), dtype=np.bool_)
        for block in self.blocks:
            chosen[block.rows] = block.role in roles
        return chosen

    def in_usual_noise(self, block: Block, values: Floats) -> Floats:
        """Values on the grid's rows as a table of an experiment, shape (repeats, count), each by its row's certainty.

        Mean squares of it are those of `values` where all rows are alike, else by how much a row tells.
        """
        table = block.by_repeat(values)
        return table if self.certainty is None else table * np.sqrt(self.share_of_rows(block))

    def share_of_rows(self, block: Block) -> Floats:
        """How much each row of a repeat of an experiment counts beside the others, shape (count,), 1 on average."""
        if self.certainty is None:
            return np.ones(block.count)
        certainty = block.by_repeat(self.certainty)[0]
        return np.asarray(certainty / certainty.mean())

    @property
    def folds(self) -> Integers:
        """What is held out together, as a number for each grid row, in order of appearance; shape (m,)."""
        names = {name: i for i, name in enumerate(dict.fromkeys(block.name for block in self.blocks))}
        fold = np.empty(len(self.grid), dtype=np.int64)
        for block in self.blocks:
            fold[block.rows] = names[block.name]
        first = len(names)
        for part in self.periodic:
            inside = (self.grid >= part.start) & (self.grid < part.stop)
            fold[inside] = first + part.fold(self.grid[inside])
            first += part.folds
        return fold

    @property
    def repeated(self) -> bool:
        return any(block.repeats > 1 and block.role == TRAINING for block in self.blocks)

    @property
    def closed(self) -> bool:
        return self.recorded_reference and all(stretch.closed for stretch in self.stretches)


def compared_below(period: float) -> float:
    """Frequency [Hz] below which repeated recordings are compared: the usual one, lower where sampling is slow."""
    return min(CUTOFF, FASTEST / period)


def prepare(
    recordings: Sequence[Recording],
    cutoff: float = CUTOFF,
    motion_cutoff: float = MOTION_CUTOFF,
    steady: bool = False,
    pace: float = 1.0,
) -> Prepared:
    """Makes recordings of one axis ready; `pace` as in `Prepared`.

    Raises:
        RecordingError: a column is missing, or axes are mixed.
        NotEnoughExcitation: too short, or nothing moves outside conditioning.
    """
    for recording in recordings:
        if not steady:
            check_recording(recording)
        refuse_mixture(recordings[0].metadata, recording.metadata)
    period, arrays = recordings[0].period, _joined_columns(recordings)
    parts = _gathered(recordings, steady, pace)
    resolution = known_resolution(recordings[0].metadata, arrays["position"])
    rows = [one.rows for one in parts.stretches]
    gaps = missing_codes(arrays["position"], rows, resolution)
    arrays["position"] = in_time(arrays["position"], rows, resolution)
    moved = filtered_motion(arrays["position"], parts.stretches, period, motion_cutoff)
    taps = low_pass_taps(cutoff, period)
    reach = max(1, round(STANDSTILL_SECONDS * pace / period))
    allowed = _usable(arrays["position"], parts.stretches, resolution, reach, len(taps) // 2)
    step = max(1, round(1.0 / (GRID / CUTOFF * cutoff * period)))
    grid, blocks = _grid(parts.segments, allowed, step, period)
    if not any(block.role == TRAINING for block in blocks):
        raise NotEnoughExcitation(
            "the recordings hold no motion to fit: beside conditioning, veto and test at least one "
            "segment must move; record the programme 'diagnosis'"
        )
    return Prepared(
        recordings[0].metadata,
        period,
        resolution,
        arrays["time"],
        arrays["reference"],
        arrays["position"],
        arrays["torque"],
        arrays["feedforward"],
        *moved,
        tuple(parts.stretches),
        grid,
        blocks,
        taps,
        motion_cutoff,
        all("reference" in recording for recording in recordings),
        arrays["torque"],
        steady=steady,
        starts=tuple(parts.starts),
        temperature=_temperature(recordings),
        periodic=tuple(parts.alike),
        sensed=_sensed(recordings),
        pace=pace,
        gaps=gaps,
    )


def _joined_columns(recordings: Sequence[Recording]) -> dict[str, Floats]:
    columns = [_columns(recording) for recording in recordings]
    return {name: np.concatenate([column[name] for column in columns]) for name in columns[0]}


@dataclass(frozen=True, slots=True)
class _Parts:
    """What recordings one after the other consist of, in rows of all of them."""

    stretches: list[Stretch]
    segments: list[Segment]
    alike: list[Periodic]
    starts: list[int]


def _gathered(recordings: Sequence[Recording], steady: bool, pace: float) -> _Parts:
    parts = _Parts([], [], [], [])
    offset = 0
    for number, recording in enumerate(recordings):
        whole = [Stretch(offset, offset + len(recording), False)]
        parts.stretches.extend(whole if steady else stretches_of(recording, offset))
        parts.starts.append(offset)
        parts.segments.extend(_segments(recording, offset, number if len(recordings) > 1 else 0, pace))
        if not steady:
            parts.alike.extend(_periodic(recording, offset, pace))
        offset += len(recording)
    return parts


def filtered_motion(
    measured: Floats | Sequence[Floats], stretches: Sequence[Stretch], period: float, cutoff: float
) -> tuple[Floats, Floats, Floats]:
    """Position, velocity and acceleration, filtered within each stretch; each of the shape given, (…, n)."""
    return motion(measured, period, cutoff, [(s.start, s.stop) for s in stretches])


def read_without(data: Prepared, reading: ReadingWave) -> Prepared:
    """The data with the motion as it was where the encoder's reading has such an error."""
    true = data.measured - reading.error(data.measured)
    position, velocity, acceleration = filtered_motion(true, data.stretches, data.period, data.motion_cutoff)
    return replace(data, position=position, velocity=velocity, acceleration=acceleration, reading=reading)


def low_pass_taps(cutoff: float, period: float) -> Floats:
    """Symmetric low-pass of gain 1 at rest; a single 1 where the cut-off is beyond the samples."""
    if cutoff * period >= 0.45:
        return np.ones(1)
    half = max(1, round(0.9 / (cutoff * period)))
    return np.asarray(scipy.signal.firwin(2 * half + 1, cutoff, fs=1.0 / period), dtype=np.float64)


def _columns(recording: Recording) -> dict[str, Floats]:
    n = len(recording)
    return {
        "time": recording["time"],
        "reference": recording["reference"] if "reference" in recording else recording["position"],
        "position": recording["position"],
        "torque": torque_of(recording),
        "feedforward": recording["torque_feedforward"] if "torque_feedforward" in recording else np.zeros(n),
    }


def _sensed(recordings: Sequence[Recording]) -> Floats | None:
    """Torque by its own sensor, where there is one: not the demand once more under another name."""
    if not all("torque_command" in recording and "torque" in recording for recording in recordings):
        return None
    if all(np.array_equal(recording["torque"], recording["torque_command"]) for recording in recordings):
        return None
    return np.concatenate([recording["torque"] for recording in recordings])


def _temperature(recordings: Sequence[Recording]) -> Floats | None:
    if not all("temperature" in recording for recording in recordings):
        return None
    values = np.concatenate([recording["temperature"] for recording in recordings])
    return values if np.all(np.isfinite(values)) and float(np.ptp(values)) > 0.0 else None


def stretches_of(recording: Recording, offset: int) -> list[Stretch]:
    """Cuts where samples were lost, time starts again, the axis was re-homed, or the mode changed."""
    time, position = recording["time"], recording["position"]
    step = np.abs(np.diff(position))
    lost = (recording.missed[1:] > 0) | (np.abs(np.diff(time) / recording.period - 1.0) > 0.5)
    usual = np.percentile(step, 99.9) if len(step) else 0.0
    jump = step > 20.0 * usual + 100.0 * (recording.metadata.position_resolution or 0.0)
    closed = _controlled(recording)
    edges = [0, *(np.flatnonzero(lost | jump | (np.diff(closed) != 0)) + 1).tolist(), len(recording)]
    return [
        Stretch(offset + a, offset + b, bool(closed[a]))
        for a, b in itertools.pairwise(edges)
        if b - a >= LEAST_ROWS
    ]


def _controlled(recording: Recording) -> NDArray[np.int8]:
    """1 where the reference is not just the measured position, by segment.

    An axis that rests on its target to the last count tells nothing: it is as the segment before, or after.
    """
    closed = np.zeros(len(recording), dtype=np.int8)
    if "reference" not in recording:
        return closed
    segments = [segment.rows for segment in recording.segments()]
    for rows in segments:
        closed[rows] = np.any(recording["reference"][rows] != recording["position"][rows])
    rests = [not closed[rows][0] and np.ptp(recording["position"][rows]) == 0.0 for rows in segments]
    known = [i for i, rest in enumerate(rests) if not rest]
    for i, rows in enumerate(segments):
        if rests[i] and known:
            nearest = max((k for k in known if k < i), default=known[0])
            closed[rows] = closed[segments[nearest]][0]
    return closed


def _segments(recording: Recording, offset: int, number: int, pace: float) -> list[Segment]:
    """Segments in absolute rows; a long one without repeats is cut into chunks to hold out."""
    found: list[Segment] = []
    segments = recording.segments()
    cut = _cut(segments)
    chunk = max(_least_chunk(recording, pace), 10)
    for segment in segments:
        role = segment.experiment
        if role == CONDITIONING:
            continue
        if not cut or role in _ROLES:
            found.append(Segment(role, segment.repeat, segment.start + offset, segment.stop + offset))
            continue
        pieces = max(1, round((segment.stop - segment.start) / chunk))
        edges = np.linspace(segment.start, segment.stop, pieces + 1).astype(int).tolist()
        for i, (a, b) in enumerate(itertools.pairwise(edges)):
            name = f"{role or 'recording'}/{number}.{segment.start}.{i}"
            found.append(Segment(name, 0, a + offset, b + offset))
    return found


def _cut(segments: Sequence[Segment]) -> bool:
    """Whether there are so few experiments, none of them repeated, that each must be cut to be held out."""
    names = [s.experiment for s in segments if s.experiment not in (CONDITIONING, *_ROLES)]
    return len(set(names)) == len(names) < 4


def _periodic(recording: Recording, offset: int, pace: float) -> list[Periodic]:
    """Segments without repeats whose motion repeats itself, in absolute rows."""
    segments = recording.segments()
    if not _cut(segments):
        return []
    guide = recording["reference" if "reference" in recording else "position"]
    fitted = [s for s in segments if s.experiment not in (CONDITIONING, *_ROLES)]
    found = [periodic(guide[s.rows], offset + s.start, recording.period / pace) for s in fitted]
    return [part for part in found if part is not None]


def _least_chunk(recording: Recording, pace: float) -> int:
    seconds = len(recording) * recording.period
    return round(max(CHUNK_SECONDS * pace, seconds / 24.0) / recording.period)


def known_resolution(metadata: Metadata, position: Floats) -> float:
    """One count of the position: as the file says, else the step that all steps are multiples of; 0 if none."""
    if metadata.position_resolution is not None:
        return metadata.position_resolution
    return step_of(position)


def step_of(values: Floats) -> float:
    """The step that all steps of values of shape (n,) are multiples of; 0 if none.

    Where values change by hundreds of steps from one to the next, levels that are beside each other tell it.
    """
    steps = np.abs(np.diff(values))
    return _common_step(steps, values) or _common_step(np.diff(np.unique(values)), values)


def _common_step(steps: Floats, values: Floats) -> float:
    """The least of some steps between values if nearly all of them are multiples of it, else 0."""
    steps = steps[steps > 1e-12 * max(1.0, float(np.ptp(values)))]
    if len(steps) == 0:
        return 0.0
    least = float(np.percentile(steps, 1.0))
    counts = steps[:20_000] / least
    whole = float(np.mean(np.abs(counts - np.round(counts)) < 0.05))
    return least if whole > 0.95 else 0.0


def _usable(
    position: Floats, stretches: Sequence[Stretch], resolution: float, reach: int, margin: int
) -> Flags:
    """Samples that are neither at the edge of a stretch nor at rest, shape (n,)."""
    usable = np.zeros(len(position), dtype=np.bool_)
    for stretch in stretches:
        usable[stretch.start + margin + 3 : max(stretch.stop - margin - 3, stretch.start)] = True
        if resolution > 0.0 and stretch.stop - stretch.start > 2 * reach + 1:
            windows = np.lib.stride_tricks.sliding_window_view(position[stretch.rows], 2 * reach + 1)
            spread = windows.max(axis=1) - windows.min(axis=1)
            still = spread < STANDSTILL_COUNTS * resolution
            usable[stretch.start + reach : stretch.stop - reach] &= ~still
    return usable


def _grid(
    segments: Sequence[Segment], usable: Flags, step: int, period: float
) -> tuple[Integers, tuple[Block, ...]]:
    families: dict[tuple[str, int], list[Segment]] = {}
    for segment in segments:
        families.setdefault((segment.experiment, segment.stop - segment.start), []).append(segment)
    rows: list[Integers] = []
    blocks: list[Block] = []
    start = 0
    for (name, length), members in families.items():
        centre = np.arange(step // 2, length, step)
        table = np.array([segment.start for segment in members])[:, None] + centre[None, :]
        table = table[:, np.all(usable[table], axis=0)]
        if table.shape[1] < 8:
            continue
        blocks.append(Block(name, _ROLES.get(name, TRAINING), start, *table.shape))
        rows.append(table.ravel())
        start += table.size
    grid = np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
    return grid, tuple(blocks)


def until_last(data: Prepared, rows: Flags, settled: float = SETTLED) -> Prepared:
    """The data up to the last sample that these grid rows need; residuals are 0 after it."""
    needed = data.grid[rows]
    if len(needed) == 0:
        return data
    return until_sample(data, int(needed.max()) + len(data.taps) // 2 + 1, settled)


def until_sample(data: Prepared, end: int, settled: float = SETTLED) -> Prepared:
    """The data up to a sample, and as far beyond as filters need: so many periods of the motion's cut-off.

    Where that ends just behind the beginning of a stretch, the stretch keeps as many rows as every one has.
    """
    end += math.ceil(settled / (data.motion_cutoff * data.period))
    begun = [s for s in data.stretches if s.start < end]
    stretches = (Stretch(s.start, min(s.stop, max(end, s.start + LEAST_ROWS)), s.closed) for s in begun)
    return replace(data, stretches=tuple(stretches))


def first_round(data: Prepared, on: Flags) -> Prepared:
    """The data up to the end of the first repeats; all that is fitted where repeats are not alike.

    What drifts makes them differ, and so does another place.
    """
    rows = data.role(TRAINING)
    if not on[_DRIFTING].any():
        for block in _alike(data):
            rows[block.rows] = np.arange(block.repeats * block.count) < block.count
    return until_last(data, rows)


def spread(data: Prepared, columns: Floats, on: Flags) -> None:
    """Copies what `first_round` gives of columns, shape (m, k), to the other repeats; other roles get 0."""
    columns[~data.role(TRAINING)] = 0.0
    if on[_DRIFTING].any():
        return
    for block in _alike(data):
        part = columns[block.rows]
        part[:] = np.tile(part[: block.count], (block.repeats, 1))


def repeats_alike(data: Prepared) -> bool:
    """Whether every fitted repeat is the same motion at the same place."""
    repeated = [block for block in data.blocks if block.role == TRAINING and block.repeats > 1]
    return len(_alike(data)) == len(repeated)


def _alike(data: Prepared) -> list[Block]:
    """Fitted blocks whose repeats are the same motion at the same place."""
    position = data.position[data.grid]
    apart = SAME_PLACE * float(np.ptp(position)) if len(position) else 0.0
    found: list[Block] = []
    for block in data.blocks:
        if block.role == TRAINING and block.repeats > 1:
            table = block.by_repeat(position)
            if float(np.max(np.abs(table[1:] - table[0]))) <= apart:
                found.append(block)
    return found
