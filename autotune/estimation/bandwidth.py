"""Which frequencies and which rows a recording can be compared at.

Usual is what suits a servo axis at 1 kHz. A recording that is sampled more slowly has less; one that is sampled
faster, and whose torque moves the axis far beyond the usual cut-off, as a piezo's, is compared up to there, and all
lengths of time go with the cut-off.

Without repeats, torque and acceleration must be coherent: the cut-off is the highest frequency where their
coherence is above 0.7; beyond the usual one only where much of the torque is there. Rests, and reversals that the
encoder does not resolve, are left out.

Counts of the encoder look like acceleration, as the fourth power of the frequency. A fit, which may have no twin that
would make the same counts, ends below where they are a hundredth of it (`Bands`); a diagnosis with repeats where they
are lost in what repeats do not share (`_quiet`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Floats, Integers
from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.estimation.alignment import (
    aligned,
    brought_together,
    change_of_gains,
    filtered_or_late,
    linear_fit,
    needed,
    plainly_apart,
    recorded_late,
    shifted,
    upsampled,
)
from autotune.estimation.controller import as_read, find_controller
from autotune.estimation.controller_law import PositionController
from autotune.estimation.controller_unsaid import (
    with_feedforward_late,
    with_friction_fed,
    with_set_points_filtered,
    with_torque_added,
    with_torque_limit,
)
from autotune.estimation.coordinates import travel_since_reversal
from autotune.estimation.data import (
    CUTOFF,
    FASTEST,
    MOTION_CUTOFF,
    STANDSTILL_COUNTS,
    STANDSTILL_SECONDS,
    TRAINING,
    Block,
    Prepared,
    compared_below,
    known_resolution,
    prepare,
    stretches_of,
)
from autotune.estimation.policy import POLICY, Policy
from autotune.recordings.checks import check_recording, guide_of, torque_of
from autotune.recordings.held_rows import one_row_a_cycle
from autotune.recordings.programme import fitted_part
from autotune.recordings.recording import CONDITIONING, Recording
from autotune.recordings.speed_points import as_steady_recordings, speed_points
from autotune.signals.filters import low_pass, motion

CANDIDATES = (
    10.0,
    15.0,
    20.0,
    30.0,
    40.0,
    60.0,
    80.0,
    90.0,
    100.0,
    115.0,
    130.0,
    160.0,
    200.0,
)
COHERENT = 0.7
LOUD = 0.02
LEAST = 15.0  # Hz
ABOVE = 1.2
MOST_POWER = 0.99
"""Without a reference a loop's own noise looks like motion: not far above what most of the torque is."""
REST = 0.002
"""Of the largest speed: slower for `REST_SECONDS` is rest."""
REST_SECONDS = 0.02
GRAIN = 5.0
"""Counts after a reversal."""
LEAST_MOVING = 0.4
LEAST_ROWS = 8
USUAL_PERIOD = 1e-3
"""s; the usual cut-offs are made for it."""
MOST = 0.9
"""Of the torque's power: where less lies below the usual cut-off, the usual cut-off is not for this axis."""
HARMONICS = 2.5
"""The cut-off over the frequency below which nearly all of such a torque lies: friction that reverses has more."""
SPECTRUM_ROWS = 4096
QUIET, QUIET_ROUNDS = 0.5, 4
"""Of the noise between repeats: what counts may come to by way of the inertia; and cut-offs tried in turn."""
COUNTED = 0.01
"""Of the acceleration's power: what counts may come to in a fit. By regression on a motion with errors an inertia is
short by as much."""
HEARD = 0.3
"""Coherence above which torque moves the axis: by chance one frequency of seventy has it."""


@dataclass(frozen=True, slots=True)
class Bands:
    """How signals are filtered before they are compared.

    Attributes:
        motion: cut-off of position, velocity and acceleration [Hz].
        error: cut-off of the torque residual [Hz].
        decimation: of the residual; half the rate left is just above `error`.
        counted: what counts of the encoder make of the acceleration's power below `error`.
        lowered: whether `error` is lower than usual for that.
    """

    motion: float = MOTION_CUTOFF
    error: float = CUTOFF
    decimation: int = 8
    counted: float = 0.0
    lowered: bool = False

    @classmethod
    def of(cls, recording: Recording) -> Bands:
        """Those of a fit: the usual ones, as low as a coarse encoder needs."""
        usual = cls.usual(recording)
        error, counted = below_counts(recording, usual.error)
        if error == usual.error:
            return replace(usual, counted=counted)
        return replace(cls.below(error, recording.period), counted=counted, lowered=True)

    @classmethod
    def usual(cls, recording: Recording) -> Bands:
        """The usual ones at 1 kHz, lower in proportion at slower sampling, higher where a fast recording needs it."""
        most = CUTOFF * USUAL_PERIOD / recording.period
        error = min(CUTOFF, most)
        if most > CUTOFF:
            error = max(CUTOFF, min(most, HARMONICS * busy_below(recording)))
        return cls.below(error, recording.period)

    @classmethod
    def below(cls, error: float, period: float) -> Bands:
        """Those with a cut-off of the torque residual [Hz]."""
        decimation = max(1, int(1.0 / (period * 2.0 * error)))
        return cls(MOTION_CUTOFF if error == CUTOFF else MOTION_CUTOFF / CUTOFF * error, error, decimation)

    @property
    def pace(self) -> float:
        """What lengths of time that suit the usual cut-off are multiplied by."""
        return CUTOFF / self.error


def below_counts(recording: Recording, cutoff: float) -> tuple[float, float]:
    """A cut-off [Hz], lowered to where counts are at most `COUNTED` of the acceleration; and what they are there."""
    counted = counts_over_motion(recording, cutoff)
    for _ in range(QUIET_ROUNDS):
        if counted <= COUNTED or cutoff <= LEAST:
            break
        cutoff = max(cutoff * (0.9 * COUNTED / counted) ** 0.2, LEAST)
        counted = counts_over_motion(recording, cutoff)
    return cutoff, counted


def counts_over_motion(recording: Recording, cutoff: float) -> float:
    """What counts of the encoder make of the acceleration's power below a cut-off [Hz], where the axis moves.

    0 where nothing moves or the position has no counts.
    """
    position, period = recording["position"], recording.period
    resolution = known_resolution(recording.metadata, position)
    if resolution <= 0.0:
        return 0.0
    reach = max(1, round(STANDSTILL_SECONDS * CUTOFF / cutoff / period))
    power, rows = 0.0, 0
    for stretch in stretches_of(recording, 0):
        moving = travel_near(position[stretch.rows], reach) >= STANDSTILL_COUNTS * resolution
        bend = motion(position[stretch.rows], period, MOTION_CUTOFF / CUTOFF * cutoff)[2]
        power += float(np.sum(low_pass(bend, cutoff, period)[moving] ** 2))
        rows += int(np.count_nonzero(moving))
    return rows * _as_acceleration(resolution, period, cutoff) ** 2 / power if power > 0.0 else 0.0


def _as_acceleration(resolution: float, period: float, cutoff: float) -> float:
    """Acceleration (rms) that rounding to counts looks like below a cut-off [Hz]: white, differentiated twice."""
    return (
        resolution / math.sqrt(12.0) * math.sqrt(2.0 * period * cutoff / 5.0) * (2.0 * math.pi * cutoff) ** 2
    )


def travel_near(position: Floats, reach: int) -> Floats:
    """Range of the position within ± `reach` samples, shape (n,)."""
    size = 2 * reach + 1
    return np.asarray(
        scipy.ndimage.maximum_filter1d(position, size) - scipy.ndimage.minimum_filter1d(position, size)
    )


def busy_below(recording: Recording) -> float:
    """Frequency [Hz] below which nearly all of the torque lies that moves the axis; 0 where the usual cut-off does.

    Only torque that is coherent with the acceleration counts: neither ripple of a current nor noise.
    """
    period, torque, position = recording.period, torque_of(recording), recording["position"]
    segments = [s for s in recording.segments() if s.experiment != CONDITIONING]
    window = min(SPECTRUM_ROWS, max((s.stop - s.start for s in segments), default=0) // 8)
    if window < 64:
        return 0.0
    own, other, both = (np.zeros(window // 2 + 1, dtype=np.complex128) for _ in range(3))
    for segment in segments:
        rows = segment.stop - segment.start
        if rows >= 2 * window:
            pair = torque[segment.rows][1:-1], np.diff(position[segment.rows], 2)
            own += rows * scipy.signal.csd(pair[0], pair[0], 1.0 / period, nperseg=window)[1]
            other += rows * scipy.signal.csd(pair[1], pair[1], 1.0 / period, nperseg=window)[1]
            both += rows * scipy.signal.csd(pair[0], pair[1], 1.0 / period, nperseg=window)[1]
    power = np.abs(both) ** 2 / np.maximum(other.real, 1e-300)
    power[power < HEARD * own.real] = 0.0
    total = np.cumsum(np.maximum(power - 2.0 * float(np.median(power[3 * len(power) // 4 :])), 0.0))
    frequency = np.fft.rfftfreq(window, period)
    if total[-1] <= 0.0 or frequency[np.searchsorted(total, MOST * total[-1])] <= CUTOFF:
        return 0.0
    return float(frequency[np.searchsorted(total, MOST_POWER * total[-1])])


def coherent_cutoff(recording: Recording, twin: bool = False) -> float:
    """Cut-off [Hz] for a recording of one trajectory; `CUTOFF` where it is too short to tell.

    `twin`: a controller is known, so that noise that runs round the loop is accounted for.
    """
    period, pace = recording.period, min(1.0, Bands.usual(recording).pace)
    longest = max(recording.segments(), key=lambda s: s.stop - s.start)
    position, torque = recording["position"][longest.rows], torque_of(recording)[longest.rows]
    window = min(1024, len(position) // 6)
    if window < 64:
        return min(CUTOFF / pace, FASTEST / period)
    wanted = guide_of(recording)[longest.rows]
    wanted = wanted if np.ptp(wanted) > 0.0 else position
    # where a controller follows a reference, noise runs round the loop and is coherent with itself
    acceleration = np.diff(wanted, 2) / period**2
    frequency, coherence = scipy.signal.coherence(torque[1:-1], acceleration, 1.0 / period, nperseg=window)
    candidates = [candidate / pace for candidate in CANDIDATES]
    best = min(candidates[0], FASTEST / period)
    for candidate in candidates:
        if candidate > FASTEST / period:
            break
        inside = (frequency > 0.85 * candidate) & (frequency <= candidate)
        if inside.sum() >= 2 and np.median(coherence[inside]) > COHERENT:
            best = candidate
    if not twin:
        return min(best, max(LEAST / pace, ABOVE * loud_below(torque, period)), FASTEST / period)
    usual = CUTOFF / pace
    return (
        best if best <= usual or _power_beyond(torque, period, usual) > LOUD else min(usual, FASTEST / period)
    )


def loud_below(torque: Floats, period: float) -> float:
    """Frequency [Hz] below which nearly all of the torque's power above its noise lies."""
    window = min(2048, len(torque) // 4)
    frequency, power = scipy.signal.welch(torque, 1.0 / period, nperseg=window)
    floor = float(np.median(power[3 * len(power) // 4 :]))
    total = np.cumsum(np.maximum(power - 2.0 * floor, 0.0))
    return float(frequency[np.searchsorted(total, MOST_POWER * total[-1])])


def _power_beyond(torque: Floats, period: float, cutoff: float) -> float:
    """Share of the torque's alternating power above a cut-off."""
    slow = low_pass(torque - torque.mean(), cutoff, period)
    return float(np.var(torque - torque.mean() - slow) / max(float(np.var(torque)), 1e-300))


def without_rest(data: Prepared) -> Prepared:
    """The data without rows whose low-pass reaches into a rest, where friction holds any torque, or into
    the first counts after a reversal, where the encoder does not see the bristle bend.

    The data as they are where that would leave less than half of them.
    """
    seconds = REST_SECONDS * data.pace
    shortest = max(3, round(seconds / data.period))
    reach = len(data.taps) // 2 + round(1.0 / (data.motion_cutoff * data.period)) + shortest
    speed = np.abs(data.velocity)
    least = max(REST * float(np.percentile(speed, 99.5)), 0.25 * data.resolution / seconds)
    still = scipy.ndimage.uniform_filter1d((speed < least).astype(np.float64), shortest) > 0.999
    unseen = travel_since_reversal(data) < GRAIN * data.resolution
    near = scipy.ndimage.maximum_filter1d(still, 2 * reach + 1)
    near |= scipy.ndimage.maximum_filter1d(unseen, 2 * (reach - shortest) + 1)
    moving = ~near[data.grid]
    rows: list[Integers] = []
    blocks: list[Block] = []
    for block in data.blocks:
        kept = block.by_repeat(moving).all(axis=0)
        if kept.sum() >= LEAST_ROWS:
            table = block.by_repeat(data.grid)[:, kept]
            start = sum(len(part) for part in rows)
            blocks.append(replace(block, start=start, count=table.shape[1]))
            rows.append(table.ravel())
    if sum(len(part) for part in rows) < LEAST_MOVING * len(data.grid):
        return data
    return replace(data, grid=np.concatenate(rows), blocks=tuple(blocks))


@dataclass(frozen=True, slots=True)
class Brought:
    """A single recording whose columns were brought together for a fit.

    Attributes:
        law: the controller that may lead a twin of it.
        doubt: by how much inertia, viscous and Coulomb friction and offset change, over themselves, shape (4,): as a
            column is taken to have been filtered, where that explains the torque better than one that was read late; or
            on a finer raster, with the torque moved, where that is not plainly better than as they were recorded.
        notes: sentences on it.
    """

    recording: Recording
    law: PositionController
    doubt: Floats
    notes: tuple[str, ...] = ()


def of_one_moment(recording: Recording, law: PositionController) -> Brought:
    """A single recording on a raster that is fine enough, its torque moved to the motion that it causes.

    As `prepared_for` has it, and only where no law tells how its columns belong together, or the torque comes late for
    any: then there is none; and where it is told plainly that they do not as they were recorded.
    """
    same = Brought(recording, law, np.zeros(4))
    if np.any(recording.repeat > 0) or not np.ptp(recording["position"]) > 0.0:
        return same
    try:
        data = prepared_for([recording])
    except (NotEnoughExcitation, RecordingError):
        return same
    late = recorded_late(data) if law.usable else 0.0
    known = data.repeated or data.steady or data.pace < 1.0
    if known:
        return same
    if law.usable and late == 0.0:
        return replace(same, doubt=_of_half_a_sample(recording, data)) if law.in_band else same
    how = filtered_or_late(data)
    if not how.column and not plainly_apart(data):
        raw = prepare([recording], data.cutoff, data.motion_cutoff)
        return replace(same, doubt=change_of_gains(without_rest(raw), data))
    moved = brought_together(upsampled(recording, data.upsampling), how)
    if late == 0.0:
        return Brought(moved, law, how.change)
    why = find_controller(data).why
    return Brought(moved, replace(law, source="none", why=why), how.change, (f"No twin: {why}.",))


def _of_half_a_sample(recording: Recording, data: Prepared) -> Floats:
    """By how much inertia and friction change, over themselves, with the torque half a sample later, shape (4,).

    A law that was found below a frequency tells no part of a sample: whether a torque was read with the position, or
    holds until the next, it does not say. Behind a motor that is fed with a voltage, whose own field brakes it, that is
    half a sample of a large viscous friction, which acceleration shows as inertia.
    """
    raw = prepare([recording], data.cutoff, data.motion_cutoff)
    return change_of_gains(raw, shifted(raw, 1.0))


def _quiet(recordings: Sequence[Recording], cutoff: float, pace: float) -> Prepared:
    """Recordings prepared with the cut-off [Hz] at which encoder's counts are below what repeats do not share.

    That is the one given where they are below it there, by way of the inertia. Repeats have the same counts at the
    same places, a twin has not: above that they look like structure, and a load behind a spring swallows them.
    """
    data = prepare(recordings, cutoff, MOTION_CUTOFF / CUTOFF * cutoff, pace=pace)
    for _ in range(QUIET_ROUNDS):
        loud = _counts_over_noise(data, cutoff) if data.repeated else 0.0
        if loud <= 1.0:
            break
        # what counts make grows with the frequency to the power of 2.5, noise with its root
        cutoff = max(cutoff / math.sqrt(loud), LEAST / pace)
        data = prepare(recordings, cutoff, MOTION_CUTOFF / CUTOFF * cutoff, pace=pace)
        if cutoff == LEAST / pace:
            break
    return data


def _counts_over_noise(data: Prepared, cutoff: float) -> float:
    """Torque that rounding to counts seems to need, over `QUIET` of the noise between repeats; 0 without repeats."""
    blocks = [block for block in data.blocks if block.role == TRAINING and block.repeats > 1]
    if not blocks or data.resolution <= 0.0:
        return 0.0
    rows, rest = data.role(TRAINING), np.zeros(len(data.grid))
    gains, _, rest[rows] = linear_fit(data, rows)
    noise = [b.by_repeat(rest).var(axis=0, ddof=1).mean() for b in blocks]
    power = float(np.average(noise, weights=[block.count for block in blocks]))
    counts = abs(float(gains[0])) * _as_acceleration(data.resolution, data.period, cutoff)
    return counts / max(QUIET * math.sqrt(power), 1e-300)


def prepared_to_fit(recordings: Sequence[Recording], policy: Policy = POLICY) -> Prepared:
    """The same for a fit: of the standard programme that part which can be fitted in one twin.

    Raises:
        RecordingError, NotEnoughExcitation: as `prepare`.
    """
    return prepared_for([fitted_part(recording) for recording in recordings], policy)


def prepared_both(recordings: Sequence[Recording], policy: Policy = POLICY) -> tuple[Prepared, Prepared]:
    """Recordings made ready for a fit, and whole; the same where nothing of them is left out.

    Raises:
        RecordingError, NotEnoughExcitation: as `prepare`.
    """
    parts = [fitted_part(recording) for recording in recordings]
    data = prepared_for(parts, policy)
    whole = all(part is recording for part, recording in zip(parts, recordings, strict=True))
    return data, data if whole else prepared_for(recordings, policy)


def prepared_repeats(recordings: Sequence[Recording]) -> Prepared | None:
    """Of recordings with repeats what can be fitted in one twin, made ready; None without any, or of too little."""
    recordings = [fitted_part(recording) for recording in recordings]
    if not any(len(recording) for recording in recordings):
        return None
    longest = max(recordings, key=len)
    bands = Bands.usual(longest)
    most = max(compared_below(longest.period), bands.error)
    try:
        data = _quiet(recordings, most, min(1.0, bands.pace))
    except (NotEnoughExcitation, RecordingError):
        return None
    return data if data.repeated else None


def _at_the_rows(law: PositionController) -> bool:
    """Whether a controller works once a row: what it asks for is told row by row."""
    return law.usable and law.ticks == 1 and not law.in_band


def _of_its_cycles(recordings: Sequence[Recording], policy: Policy) -> Prepared | None:
    """Recordings with one row for each cycle of their controller, made ready; None where they have no more of them."""
    taken = [one_row_a_cycle(recording) for recording in recordings]
    if any(one is recording for one, recording in zip(taken, recordings, strict=True)):
        return None
    if len({one.period for one in taken}) > 1:
        return None
    return prepared_for(taken, policy)


def prepared_for(recordings: Sequence[Recording], policy: Policy = POLICY) -> Prepared:
    """Recordings made ready: as the diagnosis programme wants it, or as a single trajectory allows.

    Raises:
        RecordingError, NotEnoughExcitation: as `prepare`.
    """
    points = speed_points(recordings)
    if points:
        for recording in recordings:
            check_recording(recording)
        return prepare(as_steady_recordings(recordings, points), 1e6, 1e6, steady=True)
    longest = max(recordings, key=len)
    bands = Bands.usual(longest)
    pace = min(1.0, bands.pace)
    most = max(compared_below(longest.period), bands.error)
    data = _quiet(recordings, most, pace)
    law = find_controller(data, policy)
    fewer = None if _at_the_rows(law) else _of_its_cycles(recordings, policy)
    if fewer is not None:
        return fewer
    for with_what_was_not_said in (
        with_torque_limit,
        with_feedforward_late,
        with_set_points_filtered,
        with_friction_fed,
        with_torque_added,
    ):
        told = with_what_was_not_said(recordings, data, policy)
        if told is not recordings:
            break
    read = [as_read(recording, law) for recording in told]
    if any(one is not recording for one, recording in zip(read, recordings, strict=True)):
        recordings, data = read, _quiet(read, most, pace)
        law = find_controller(data, policy)
    if data.repeated:
        return data
    known = data.recorded_reference and law.usable
    cutoff = coherent_cutoff(longest, known)
    if known:
        return without_rest(prepare(recordings, cutoff, 2.5 * cutoff, pace=pace))
    coarse = False
    if pace == 1.0:  # no twin makes the same counts, and what they look like an elastic transmission swallows
        own = [below_counts(recording, cutoff) for recording in recordings]
        cutoff = min(lowered for lowered, _ in own)
        coarse = any(
            (counted if lowered == cutoff else counts_over_motion(recording, cutoff)) > COUNTED
            for recording, (lowered, counted) in zip(recordings, own, strict=True)
        )
    factor = needed(cutoff, recordings[0].period)
    fine = [upsampled(recording, factor) for recording in recordings]
    gaps, data = data.gaps, without_rest(prepare(fine, cutoff, 2.5 * cutoff, pace=pace))
    data = replace(data, upsampling=factor, coarse=coarse, gaps=gaps)
    return aligned(data) if pace == 1.0 else data
