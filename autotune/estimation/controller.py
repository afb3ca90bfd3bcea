"""The position controller of a recording: the file's if it explains the torque demand, else identified.

The law: `controller_law`; how it is found in the data: `controller_search`, and for loops between the samples
`controller_between`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.core.remembered import Remembered, digest_of
from autotune.core.units import percent
from autotune.estimation.alignment import a_row_sooner, recorded_late, shifted
from autotune.estimation.controller_between import (
    answering_late,
    as_quick,
    following_late,
    holding,
    laws_between,
    laws_of_quick_rows,
    laws_of_slow_rows,
    quick_rows,
    read_before_steps,
    slow_rows,
    smooth_between,
)
from autotune.estimation.controller_law import (
    BEFORE,
    EVE,
    MOMENT,
    NEXT,
    SHORTEST_RUN,
    LoopSamples,
    PositionController,
    between_terms,
    late_samples,
    law_terms,
    regular_rows,
    share_explained,
    smeared_samples,
)
from autotune.estimation.controller_search import (
    EXACT,
    law_from_data,
    plain_in_band,
    plainly_better,
)
from autotune.estimation.data import Prepared, known_resolution, read_without, step_of, stretches_of
from autotune.estimation.disturbance import positions_read
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.twin_runs import slower, slower_in
from autotune.recordings.checks import at_limit, torque_of
from autotune.recordings.recording import OF_FILTER, Controller, Recording
from autotune.signals.between_samples import between_moments
from autotune.signals.filters import low_pass
from autotune.signals.runs import runs_of
from autotune.signals.triangle import less_run_means

IMPORT_REFERENCE = "import it with one if there is: autotune data import FILE --column reference=FIELD"
NAME_GAINS = (
    "If it is a PID whose gains you know, name them: autotune data import FILE --controller 'pid kp=... kd=... "
    "ki=...'; if a torque was added to its own (an excitation, a feedforward), name that: --column "
    "torque_feedforward=FIELD; if the drive filters its set points, record the reference behind that filter"
)
ROUNDED = 1.2
"""Times the variance that rounding to the steps of the recorded torque has."""
SAME = 1e-9
"""Relative difference of two torques that are one value of the drive."""
RECORDED_LATE = {MOMENT: 1.0, NEXT: 0.0, BEFORE: 2.0, EVE: 1.0}
"""Half samples by which a torque is recorded late that acts from each sample to the next."""
AS_READ = "Rows are written late: positions are taken as the controller read them, told by its demand."
AS_ACTED = (
    "The torque was read as each row begins, behind a drive that goes on lines from one set point to the next: what "
    "acts in the row was told from it by the drive's law."
)
_ASKED: Remembered[Floats] = Remembered(12)
KNOWN_LAWS: Remembered[tuple[PositionController, ...]] = Remembered()


def is_closed(recording: Recording) -> bool:
    """Whether the axis followed a reference of its own (in torque mode the measured position is logged)."""
    if "reference" not in recording:
        return False
    return bool(np.mean(recording["reference"] != recording["position"]) > 0.05)


def find_controller(data: Prepared, policy: Policy = POLICY) -> PositionController:
    """The controller that made the torque demand of prepared data; none unless all of them were controlled."""
    if not data.recorded_reference:
        return _none(f"the recording has no column 'reference'; {IMPORT_REFERENCE}")
    if not all(stretch.closed for stretch in data.stretches):
        return _none("parts were recorded without position control")
    samples = loop_samples(data, policy)
    found = identified(samples)
    if not found.usable and data.repeated:
        found = next(iter(_plain(samples)), found)
    if found.in_band and not data.repeated:
        # without repeats nothing tells what such a drive makes of counts from what a model lacks
        return replace(found, source="none", why=BETWEEN_SAMPLES)
    if found.usable and (late := recorded_late(data)) > 0.0:
        return replace(found, source="none", why=LATE.format(1e3 * late))
    return _or_between(data, samples, found)[0]


def _or_between(
    data: Prepared, samples: LoopSamples, found: PositionController
) -> tuple[PositionController, ...]:
    """A law, and beside it or in its place that of a drive that works between the samples.

    A law that explains less than half of the rows to their rounding is that of rows which are written late, or one that
    is near a faster loop's where motion is smooth: twins tell.
    """
    sure = found.smooth and 1.0 - found.explained < EXACT  # beyond what a demand's steps hide
    # a law that sees the position at once, but needs what its reference does by itself: the drive interpolates
    interpolates = found.position_delay == 0 and found.acceleration_feedforward != 0.0
    between = found.in_band or found.prompt or interpolates
    if not data.repeated or (found.usable and (sure or not between)):
        return (found,)
    quiet = quieter(data)
    heard = samples if quiet is data else loop_samples(quiet, samples.policy)
    if not found.usable:
        slow = _remembered(b"slow", heard, lambda: laws_of_slow_rows(heard))
        return slow or _remembered(b"quick", heard, lambda: laws_of_quick_rows(heard)) or (found,)
    laws = _remembered(b"between", heard, lambda: laws_between(heard, found, heard is not samples))
    if not found.exact:
        return laws
    # at the samples; what such a drive does between them is in no row, where motion is smooth
    return (found, *(law for law in laws if law.ticks > 1))


def controllers_of(
    data: Prepared, found: PositionController, policy: Policy = POLICY
) -> tuple[PositionController, ...]:
    """The controller, and what it may be as well where a drive works between the samples: only a twin tells."""
    if not found.usable:
        return (found,)
    samples = loop_samples(data, policy)
    laws = _or_between(data, samples, identified(samples) if found.ticks > 1 else found)
    laws = laws if found in laws else (found,)
    plain = _plain(samples) if data.repeated and not found.exact else ()
    between = next((law for law in laws if law.ticks > 1), None)
    if between is None:
        return tuple(dict.fromkeys((found, *plain)))
    part = slow_rows if between.slow else quick_rows if between.quick else None
    quiet = quieter(data)
    samples = samples if part is None else part(samples)
    heard = samples
    if quiet is not data:
        heard = loop_samples(quiet, policy)
        heard = heard if part is None else part(heard)
    smooth = _remembered(b"smooth", heard, lambda: _some(smooth_between(heard, between)))
    other: tuple[PositionController, ...] = ()
    if data.sensed is None:
        late = _remembered(b"late", samples, lambda: answering_late(samples, between))
    else:
        acted = loop_samples(felt(data), policy)
        what = b"follows" + repr(mark_of_samples(samples)).encode()
        late = _remembered(what, acted, lambda: _some(following_late(samples, acted.demand, between)))
        if part is None:
            other = by_sensor(acted, between) if quiet is data else _demanded(samples)
    moment = next((law for law in laws if law.ticks > 1 and law.taken == MOMENT), None)
    held = _remembered(b"held", heard, lambda: holding(heard, between))
    stepped = () if moment is None else _remembered(b"eve", heard, lambda: read_before_steps(heard, moment))
    if between.quick:
        others = smooth, late, stepped, held
        smooth, late, stepped, held = (tuple(as_quick(law) for law in some) for some in others)
    return (laws[0], *other, *plain, *laws[1:], *held, *smooth, *late, *stepped)


def _demanded(samples: LoopSamples) -> tuple[PositionController, ...]:
    """Law of a demand that is louder than the torque by its sensor; none where no loop between the samples tells it.

    A mean would be no louder: it was read as at the sample. A sensor that is read so as well shows what was asked for a
    tick before, in whose pattern of counts the law looks as one of another moment.
    """

    def found() -> tuple[PositionController, ...]:
        laws = laws_between(samples, identified(samples))
        return tuple(law for law in laws if law.ticks > 1 and law.taken == MOMENT)

    return tuple(replace(law, demanded=True) for law in _remembered(b"demanded", samples, found))


def by_sensor(acted: LoopSamples, law: PositionController) -> tuple[PositionController, ...]:
    """Laws of a torque by its sensor, in each way of recording it that explains as much, beside one of the demand.

    A demand that is read as a row begins is not what acts until the next where a loop answers set points that step.
    """

    def found() -> tuple[PositionController, ...]:
        return tuple(one for one in laws_between(acted, law) if one.ticks > 1 and one is not law)

    return tuple(replace(one, sensed=True) for one in _remembered(b"sensor", acted, found))


def _plain(samples: LoopSamples) -> tuple[PositionController, ...]:
    """The plain law below the compared frequency, and the same of a torque that is read when the next one is due."""
    laws = _remembered(b"plain", samples, lambda: _some(plain_in_band(samples)))
    return (*laws, *(read_late(law) for law in laws if law.position_delay > 0))


def read_late(law: PositionController) -> PositionController:
    """The law that leaves the same columns where it sees all a sample sooner, and its torque is recorded as late."""
    return replace(law.sooner(), taken=BEFORE)


def _some(law: PositionController | None) -> tuple[PositionController, ...]:
    return () if law is None else (law,)


def as_recorded(data: Prepared, found: PositionController) -> Prepared:
    """Data with the torque that tells most, where a drive's loop works between the samples, from each to the next."""
    found = found.of_its_drive(data.period)
    quiet, late = _compared(data, found), recorded_late_by(found)
    if found.read_off and found.ticks > 1:
        taken = _as_mean(quiet, found)
        return _as_asked(taken, found) if found.asked > 0.0 else taken
    moved = a_row_sooner(quiet) if found.taken == BEFORE else shifted(quiet, late)
    taken = replace(moved, late=0.0) if late else quiet
    taken = _as_acted(taken, found)
    return _as_asked(taken, found) if found.asked > 0.0 and found.ticks > 1 else taken


def recorded_again(now: Prepared, data: Prepared, law: PositionController) -> Prepared:
    """Data as a law has their torque, with all that was told since of those that are compared `now`."""
    again = replace(
        as_recorded(data, law),
        clocked=now.clocked,
        wander=now.wander,
        certainty=now.certainty,
        load_in_twin=True,
    )
    return again if now.reading is None else read_without(again, now.reading)


def recorded_late_by(law: PositionController) -> float:
    """Half samples by which a torque is recorded late that acts from each sample to the next, as it is compared."""
    return 0.0 if law.read_off else RECORDED_LATE[law.taken]


def _as_mean(data: Prepared, law: PositionController) -> Prepared:
    """Data whose torque is the mean from each row to the next of one that was read at a moment of it.

    Where a drive holds its set points the torque steps with each and falls until the next: no mean of two readings is
    what acted. The law knows by how much a reading is off, along the recorded motion.
    """
    torque = data.torque + _off_by_reading(_seen(data), law)
    sensed = torque if data.by_sensor else data.sensed
    return replace(data, torque=torque, recorded_torque=torque, sensed=sensed, shift=0.0, late=0.0)


def _off_by_reading(samples: LoopSamples, law: PositionController) -> Floats:
    """By how much the mean of each row is above what a law's torque was read as, shape (n,) [N m]."""
    seen = late_samples(samples, law.reference_delay, law.position_delay)
    rate = law.filter_rate(samples.period)
    read, acted = (
        between_terms(seen, replace(law, reference_delay=0, taken=taken), rate) @ law.terms_gains
        for taken in (law.taken, NEXT)
    )
    return np.asarray(acted - read)


def _compared(data: Prepared, law: PositionController) -> Prepared:
    """The data with that of two recorded torques which is compared beside a law."""
    if law.sensed:
        return felt(data)
    return quieter(data) if law.in_band and not law.demanded else data


def by_sensor_compared(data: Prepared, law: PositionController) -> bool:
    """Whether the torque by its sensor is compared where the data, as they were recorded, hold a demand beside it."""
    return data.sensed is not None and _compared(data, law) is not data


def _as_acted(data: Prepared, law: PositionController) -> Prepared:
    """Data whose torque has what a law holds from set point to set point as it acted, not as it was read."""
    if law.taken != EVE:
        return data
    late = late_samples(_seen(data), law.reference_delay, 0)
    torque = data.torque.copy()
    for rows in late.stretches:
        torque[rows] += law.held_until_read(late.reference[rows], data.period)
    sensed = torque if data.by_sensor else data.sensed
    return replace(data, torque=torque, recorded_torque=torque, sensed=sensed, shift=0.0)


def _seen(data: Prepared) -> LoopSamples:
    """What a controller sees of prepared data."""
    stretches = tuple(stretch.rows for stretch in data.stretches)
    held = clamped(data.torque, data.metadata.torque_limit)
    return LoopSamples(data.period, data.reference, data.measured, data.torque, held, stretches, None)


def _as_asked(data: Prepared, law: PositionController) -> Prepared:
    """Data whose torque is what a law between the samples asks for along the recorded motion.

    A torque that is read at a moment has all that the loop makes of the encoder's counts at that tick, most of it above
    half the sampling rate: folded down, it is noise below the compared frequency that never acted, and that comes again
    where the motion does. What the law makes of the positions at the samples has none of it. What is slower than its
    sum wanders is that of the recorded torque.
    """
    wanted = _free_of_clamps(data, asked(data, replace(law, taken=NEXT)), law.asked)
    torque = wanted + slower(data, data.torque - wanted, law.asked)
    return replace(data, torque=torque, recorded_torque=torque, shift=0.0, asked=wanted)


def _free_of_clamps(data: Prepared, wanted: Floats, wanders: float) -> Floats:
    """What a law asks for, shape (n,), where the torque was not clamped, and the recorded torque where it was.

    A clamp leaves another sum than the law's, so that what it asks for steps there: from clamp to clamp it is levelled
    by itself, below the frequency `wanders` [Hz] above which it is compared. Runs shorter than a period of that tell
    nothing.
    """
    held = clamped(data.torque, data.metadata.torque_limit)
    if not held.any():
        return wanted
    levelled = data.torque.copy()
    for stretch in data.stretches:
        for start, stop in runs_of(~held[stretch.rows]):
            if (stop - start) * data.period * wanders >= 1.0:
                rows = slice(stretch.rows.start + start, stretch.rows.start + stop)
                off = data.torque[rows] - wanted[rows]
                levelled[rows] = wanted[rows] + slower_in(off, wanders, data.period)
    return levelled


def as_wanted(data: Prepared, law: PositionController) -> Prepared:
    """Data with the demand as an exact law of the samples computed it, before it was rounded; itself where it was not.

    What rounding to steps takes off a demand comes again where repeats move alike within one, and no model explains it.
    The demand is told by the recorded motion to within half a step of what was recorded, but for a constant from clamp
    to clamp.
    """
    step = step_of(data.recorded_torque)
    if not law.exact or law.ticks > 1 or data.upsampling > 1 or step == 0.0:
        return data
    # the law was identified in the torque as it was recorded
    recorded = replace(data, torque=data.recorded_torque)
    off = data.recorded_torque - asked(recorded, law)
    held = clamped(data.recorded_torque, data.metadata.torque_limit)
    for stretch in data.stretches:
        free = ~held[stretch.rows]
        runs = np.cumsum(~free)
        count = np.maximum(np.bincount(runs, free), 1)
        off[stretch.rows] -= (np.bincount(runs, free * off[stretch.rows]) / count)[runs]
    off[held] = 0.0
    torque = data.recorded_torque - np.clip(off, -0.5 * step, 0.5 * step)
    return shifted(replace(data, recorded_torque=torque), data.shift)


def felt(data: Prepared) -> Prepared:
    """The data with the torque by its sensor, where there is one: what the axis felt, and not what was asked for."""
    return data if data.sensed is None else replace(data, torque=data.sensed, recorded_torque=data.sensed)


def as_acted(data: Prepared) -> Prepared:
    """The data with the torque that a model without a twin is compared with: the quieter one, where repeats are.

    What a demand that was read at a moment has beside what acted no twin has then either.
    """
    return quieter(data) if data.repeated else data


def quieter(data: Prepared) -> Prepared:
    """The data with the torque by its sensor, where that has less above the compared frequency than the demand has.

    What a loop between the samples makes of counts changes within a sample, and its value at a sample is not what acted
    until the next: noise that repeats as the counts do. The column with less of it above has less of it below.
    """
    if data.sensed is None:
        return data
    demand, sensed = (_roughness(data, values) for values in (data.recorded_torque, data.sensed))
    return felt(data) if sensed < demand else data


def _roughness(data: Prepared, torque: Floats) -> float:
    """Variance beyond the motion's cut-off [(N m)²]."""
    beyond = [
        torque[s.rows] - low_pass(torque[s.rows], data.motion_cutoff, data.period) for s in data.stretches
    ]
    return float(sum(np.sum(part**2) for part in beyond))


def loop_samples(data: Prepared, policy: Policy = POLICY) -> LoopSamples:
    """What the controller of prepared data is found in."""
    return LoopSamples(
        data.period,
        data.reference,
        data.measured,
        data.torque - data.feedforward,
        clamped(data.torque, data.metadata.torque_limit),
        tuple(stretch.rows for stretch in data.stretches),
        data.metadata.controller,
        policy,
        rounded=_step_beside(data.torque, data.feedforward),
    )


def _step_beside(torque: Floats, feedforward: Floats) -> float | None:
    """Step that a torque was rounded to, shape (n,), where less a feedforward it is on none; else None."""
    return step_of(torque) if np.any(feedforward) else None


def asked(data: Prepared, controller: PositionController) -> Floats:
    """The torque that a controller asks for along prepared data [N m], shape (n,).

    Its integral begins anew in every stretch and is right but for a constant from clamp to clamp.
    """
    seen = _seen(data)
    samples = late_samples(seen, controller.reference_delay, controller.position_delay)
    samples = smeared_samples(samples, controller.part_late)
    if controller.ticks > 1:
        return _asked_between(samples, controller) + controller.constant + data.feedforward
    samples = smeared_samples(samples, controller.smeared)
    terms = law_terms(samples, controller.derivative_filter, controller.smooth) @ controller.terms_gains
    demand = terms + controller.constant + data.feedforward
    limit = data.metadata.torque_limit or np.inf
    return np.asarray(np.where(seen.clamped, np.clip(data.torque, -limit, limit), demand))


def _asked_between(late: LoopSamples, law: PositionController) -> Floats:
    """The same of a law that works between the samples, from each to the next as its torque is recorded."""
    by_moment = law.taken in (MOMENT, EVE) and not law.held
    now = replace(law, reference_delay=0, taken=law.taken if by_moment else NEXT, asked=0.0, adrift=False)

    def found() -> Floats:
        demand = np.asarray(between_terms(late, now, law.filter_rate(late.period)) @ law.terms_gains)
        if not by_moment:
            return demand
        acted = between_moments(demand)
        for rows in late.stretches:
            acted[rows] += now.held_until_read(late.reference[rows], late.period)
        return acted

    along = digest_of(late.reference, late.position), late.period, repr(late.stretches)
    return _ASKED.answer((repr(now), *along), found)


def controller_of(recording: Recording) -> PositionController:
    """The controller of the parts of a recording that were under position control."""
    if "reference" not in recording:
        return _none(f"the recording has no column 'reference'; {IMPORT_REFERENCE}")
    samples = _samples_of(recording)
    return identified(samples) if samples.stretches else _none("nothing was recorded under position control")


def _samples_of(recording: Recording) -> LoopSamples:
    """What the controller of a recording is found in."""
    closed = [s.rows for s in stretches_of(recording, 0) if s.closed and is_closed(recording.rows(s.rows))]
    torque = torque_of(recording)
    demand = torque - recording["torque_feedforward"] if "torque_feedforward" in recording else torque
    return LoopSamples(
        recording.period,
        recording["reference"],
        recording["position"],
        np.asarray(demand),
        clamped(torque, recording.metadata.torque_limit),
        tuple(closed),
        recording.metadata.controller,
        rounded=_step_beside(torque, torque - demand),
    )


def as_read(recording: Recording, law: PositionController) -> Recording:
    """The recording with positions as its controller read them, where rows hold later ones; else itself."""
    if not law.exact or "reference" not in recording:
        return recording
    counts = known_resolution(recording.metadata, recording["position"])
    position = positions_read(_samples_of(recording), law, counts)
    if position is None:
        return recording
    return with_column(recording, "position", position, AS_READ)


def as_acted_in_rows(recording: Recording, data: Prepared) -> Recording:
    """The recording with the mean torque of each row where it holds a reading of what steps in it; else itself.

    As `as_recorded` has it of prepared data, here those of the recording, for a fit whose twin has no law between the
    rows.
    """
    samples = loop_samples(data)
    laws = [one for one in _or_between(data, samples, identified(samples)) if one.ticks > 1]
    law = next((one for one in laws if one.read_off), None)
    if law is None or laws[0].taken != MOMENT:
        return recording
    column = "torque_command" if "torque_command" in recording else "torque"
    torque = torque_of(recording) + _off_by_reading(_samples_of(recording), law)
    return with_column(recording, column, torque, AS_ACTED)


def with_column(recording: Recording, name: str, values: Floats, remark: str) -> Recording:
    """The recording with other values in a column, and a remark on why."""
    told = replace(recording, floats=MappingProxyType({**recording.floats, name: values}))
    return told.with_metadata(remarks=(*recording.metadata.remarks, remark))


def clamped(torque: Floats, limit: float | None) -> Flags:
    """Rows at the torque limit, shape (n,); where none is known, those at the largest torque if it comes again.

    One clamped sample is enough to leave the integral other than its sum, and no torque that is free meets its own
    largest value twice.
    """
    if limit is not None:
        return at_limit(torque, limit).rows
    rows = np.abs(torque) >= (1.0 - SAME) * float(np.max(np.abs(torque), initial=0.0))
    return rows if np.count_nonzero(rows) > 1 else np.zeros(len(torque), dtype=np.bool_)


def identified(samples: LoopSamples) -> PositionController:
    """The file's controller where it explains the demand, else the one that explains it best, or none.

    Of the samples that were asked for last it is remembered: a fit and a diagnosis ask half a dozen times.
    """

    def found() -> tuple[PositionController]:
        law = _identified(samples)
        return (replace(law, exact=law.usable and _to_rounding(samples, law.explained)),)

    return _remembered(b"identified", samples, found)[0]


def _remembered(
    what: bytes, samples: LoopSamples, find: Callable[[], tuple[PositionController, ...]]
) -> tuple[PositionController, ...]:
    return KNOWN_LAWS.answer((what, *mark_of_samples(samples)), find)


def _to_rounding(samples: LoopSamples, explained: float) -> bool:
    """Whether a law leaves no more of the demand than rounding does."""
    rounded = ROUNDED * samples.step**2 / 12.0
    least = max(EXACT * float(np.var(samples.demand)), rounded)
    return (1.0 - explained) * float(np.var(samples.demand)) < least


def mark_of_samples(samples: LoopSamples) -> tuple[bytes, str]:
    """What tells samples apart: a digest of all that a law is identified from."""
    read = samples.period, samples.stretches, samples.known, samples.policy
    rest = *read, samples.most_rows, samples.piece, samples.rounded
    weighed = () if samples.weight is None else (samples.weight,)
    content = digest_of(samples.reference, samples.position, samples.demand, samples.clamped, *weighed)
    return content, repr(rest)


def _identified(samples: LoopSamples) -> PositionController:
    known = samples.known
    rows, _ = regular_rows(samples, 1.0)
    if rows.sum() < SHORTEST_RUN:
        why = "the torque is clamped nearly everywhere; record gentler motion"
        return _none(why) if known is None else _trusted(known, why)
    if float(np.var(samples.demand[rows])) == 0.0:
        why = "the torque demand never changes; record motion"
        return _none(why) if known is None else _trusted(known, why)
    named = None if known is None else _checked(samples, known)
    if named is not None and 1.0 - named.explained < EXACT:
        return named
    found = law_from_data(samples)
    if (
        named is not None
        and named.explained > samples.policy.controller_explains
        and not plainly_better(samples, found, named)
    ):
        return named
    if not found.usable:
        why = _unexplained(found.explained, samples.policy.controller_explains)
        return replace(found, why=why)
    return found if named is None else replace(found, why=_replaced(named, found))


def _none(why: str) -> PositionController:
    return PositionController(why=why)


def _trusted(known: Controller, why: str) -> PositionController:
    return PositionController(
        known.kp,
        known.kd,
        known.ki,
        known.derivative_filter,
        explained=float("nan"),
        source="trusted",
        why=f"The controller of the file could not be verified and is trusted: {why}.",
    )


SLOWEST_FILTER = 0.005
"""Least share of a new difference in a filtered one: no loop's derivative is 200 samples slow, but a time constant in
seconds looks so."""
SAME_GAIN = 0.05
"""Relative: within the dead time of a row a loop of usual bandwidth turns gains into others by about as much."""
BETWEEN_SAMPLES = (
    "the controller's law shows at low frequencies only, as where a drive closes its loop between the samples or its "
    "torque has noise of its own, and one recording does not tell what that makes of encoder counts from what the "
    "model lacks; record the same motion at least twice"
)
LATE = (
    "the torque is recorded about {:.2g} ms after the motion that it causes, as no loop can have it: read late, or "
    "filtered, by the drive or the logger; it is taken to have acted as much sooner"
)


def _unexplained(share: float, needed: float) -> str:
    return (
        f"reference and position explain {100 * share:.1f} % of the torque demand by the law of a PID, a cascade or "
        f"a state controller; more than {100 * needed:.1f} % are needed. {NAME_GAINS}"
    )


def _replaced(named: PositionController, found: PositionController) -> str:
    left = (
        f"The controller that the file names leaves {percent(1.0 - named.explained)} % of the torque demand's "
        f"variance unexplained, the one identified from the data {percent(1.0 - found.explained)} %; that is used "
        "instead. "
    )
    if named.derivative_filter < SLOWEST_FILTER:
        return left + f"Its derivative_filter of {named.derivative_filter:.3g} is {OF_FILTER}."
    late = min(found.reference_delay, found.position_delay)
    same = all(
        math.isclose(getattr(named, gain), getattr(found, gain), rel_tol=SAME_GAIN) for gain in ("kp", "kd")
    )
    if late > 0 and same:
        rows = "a row" if late == 1 else f"{late} rows"
        return (
            left
            + f"Its gains are the same: the file has the torque {rows} late, and the gains need no mending."
        )
    if same:
        differs = "a filter of the derivative, a feedforward, or a loop that works more often than the rows"
        return left + f"Its gains are the same: what differs is {differs}."
    left += "Mend the gains in the file"
    if named.derivative_filter == 1.0:
        return left + ", or name its derivative_filter; a feedforward can differ so too."
    return left + ", or its law differs: a feedforward, a dead time, cascaded loops."


def _checked(samples: LoopSamples, known: Controller) -> PositionController:
    """The file's controller with the share of the demand that it explains."""
    rows, run = regular_rows(samples, known.derivative_filter)
    terms = law_terms(samples, known.derivative_filter)[rows]
    law = np.array([known.kp, known.kd, known.ki, known.kd, 0.0, 0.0, 0.0])
    rest = samples.demand[rows] - terms @ law
    return PositionController(
        known.kp,
        known.kd,
        known.ki,
        known.derivative_filter,
        constant=float(np.mean(rest)) if known.ki == 0.0 else 0.0,
        explained=share_explained(less_run_means(rest, run), less_run_means(samples.demand[rows], run)),
        source="metadata",
    )
