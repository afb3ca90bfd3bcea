"""The evidence behind a verdict in figures and words: candidates, why, what is left, what to record next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.core.units import percent, torque_symbol
from autotune.diagnosis.candidates import FittedCandidate, ScreenedCandidate, explained_of_rest
from autotune.diagnosis.evidence.evidence import Evidence, HoldoutResult
from autotune.diagnosis.evidence.time_driven import Moment, TimeLine
from autotune.diagnosis.evidence.torque_path import CYCLES
from autotune.diagnosis.free_shape import any_course
from autotune.diagnosis.refits import needed_share
from autotune.estimation.alignment import CURRENT_LOOP
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import TRAINING, Prepared, ReadingWave
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Problem
from autotune.estimation.residual import smoothed
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.reversal_memory import REVERSAL_MEMORY, contact
from autotune.models.table import EFFECTS, looking_alike, usual_rivals
from autotune.recordings.recording import Metadata

NAMED, NONE, UNKNOWN, AMBIGUOUS = "named", "none", "unknown", "ambiguous"
CONFIRMED, SUSPECTED = "confirmed", "suspected"
ANY_COURSE = (
    "over so little travel it comes near to any smooth course of the place, and a free function of the place explains "
    "what it leaves"
)
WORST_GAIN = -1.0
"""Shown of a candidate that is worse than nothing: how much worse an extrapolation is says nothing."""
WORTH_TELLING = 0.25
"""Of what is to be explained: a single effect that explains so much is told beside an "unknown"."""
TORQUE_CONSTANT = (
    "A wrong torque constant cannot be seen in these data: all torques scale with it. An independent "
    "inertia or a known added mass would show it."
)
CUT_SHORT = (
    "Stopped after {seconds:.0f} s of search, before all was asked: what is named is suspected only and may not be "
    "all, and what is not named may be there. With more time (--at-most) the rest is asked."
)
RECORD_AGAIN = (
    "Look at the machine for what was there once, and play the same programme again: without it these data tell "
    "whether anything else is missing."
)
DROWNED = (
    "That disturbance is larger than all that an effect explains; what it hides cannot be told. Remove its source, or "
    "record while it is off."
)
HUNTS = (
    "The axis hunts at {hertz:.0f} Hz, with more torque than its friction: the contact slides to and fro while it "
    "does, and what is left below that frequency is not its friction. Nothing is named. Lower the gains until it is "
    "quiet, and record again; play in the drive often is the cause."
)
HUNTS_ALIKE = (
    "The axis hunts at {hertz:.0f} Hz, with more torque than its friction, and in the same loop the model with what is "
    "named does so too. Friction is smoothed away while it does: lower the gains until it is quiet, and record again "
    "before its parameters are used."
)
OFFSET = (
    "A constant of {size:.2g} {unit} acts beside friction, {percent} % of it: a weight, a cable, an amplifier's "
    "offset, or friction that is higher one way than the other by twice as much. While an axis slides these are the "
    "same; it is the base model's offset, and no effect that is missing."
)
TOLD_OFFSET = 0.01
"""Of friction: a constant that is so large is told where nothing has a name."""
OWN_PRESLIDING = (
    "After a reversal friction comes to its level sooner than the exponential of a bristle does: one contact that is "
    "elastic until it slides. This is the base model's presliding by another law and no effect that is missing; it was "
    "fitted beside all else."
)
OTHER_CLIMB = (
    "After a reversal friction climbs by another curve than the exponential of a bristle: a part of it is there at "
    "once, or lets go sooner. This is the base model's presliding by another law and no effect that is missing; it was "
    "fitted beside all else."
)
MANY_CONTACTS = (
    "After a reversal friction climbs by another curve than the exponential of a bristle: as the sum of many contacts "
    "that let go one after another, so that small loops close where they began. All of them slide within ten times the "
    "way on which friction comes to two thirds of its level. This is ordinary for plain and rolling guides, the base "
    "model's presliding by another law and no effect that is missing; it was fitted beside all else."
)
WIDE_CONTACTS = (
    "After a reversal friction climbs by another curve than the exponential of a bristle: as the sum of many contacts "
    "that let go one after another, so that small loops close where they began. The last of them slide only beyond ten "
    "times the way on which friction comes to two thirds of its level, without a gap before them: whether they are the "
    "contact's own or a reversal memory beside it no such data tell. They are taken for its own, the base model's "
    "presliding by another law; it was fitted beside all else."
)
ALL_CONTACT = (
    "Beside this reversal memory no contact is left that forgets: small loops of all friction close where they began, "
    "and no gap parts its elements. So it may as well be one contact of many elements, as plain and rolling guides "
    "have, the base model's presliding by another law. No such data tell the two apart, so it is suspected only; what "
    "compensates it is the same."
)
OTHER_BENDING = (
    "After a reversal or a rest the contact bends by another curve than a bristle's: elastic for longer, or letting go "
    "sooner, as the laws of Dahl, Bouc and Wen, and elastic-then-plastic ones have it. This is the base model's "
    "presliding by another law and no effect that is missing; it was fitted beside all else."
)
NO_STATIC_FRICTION = (
    "Friction has no static part: it grows with speed, to three quarters of its level at {speed:.2g} {unit}, as that "
    "of a film, or of a simulated axis with a smoothed sign function. Any torque makes the axis creep. This is a law "
    "of the base model and no effect that is missing; it was fitted beside all else."
)
FADING_DAMPING = (
    "The damping in presliding fades with speed, to a third at {speed:.2g} {unit} or so: the contact is damped while "
    "it bends and hardly while it slides. This is a law of the base model, as textbooks have it, and no effect that is "
    "missing; it was fitted beside all else."
)
OTHER_CURVE = (
    "Friction that falls with speed, which the model has, falls by another curve than the model's; its shape was "
    "fitted freely before anything else was asked."
)
NOT_COMPARED = (
    "Torques are compared up to {hertz:.3g} Hz; {percent} % of the torque (rms) lies above, and is not "
    "compared."
)
PRESLIDING_REST = (
    "Beside it something still comes again, in one experiment at least: what that law is not exactly, or an effect "
    "that these data cannot tell from it."
)
CURRENT_LOOP_LATE = (
    "The torque follows its demand {late:.2g} ± {error:.1g} ms late, as a current loop of {hertz:.0f} Hz does: any "
    "drive has one, and it is no effect of the axis. It is taken out. Where the drive's own setting is much faster, "
    "the rest is a filter's or what the model is not exactly."
)
CURRENT_LOOP_AT_LEAST = (
    "The torque follows its demand {late:.2g} ms late or more: so much is taken out, as the slowest ordinary current "
    "loop ({hertz:.0f} Hz) makes it, and no more. Whether yours is as slow its settings tell."
)
READS_IN_WAVES = (
    "The encoder tells up to {size:.2g} {unit} too much or too little over each {period:.4g} {unit}, as one does that "
    "interpolates the sine and cosine of its lines. It is no effect of the axis, and taken out of the motion; its "
    "signals' offsets and sizes can be set in most drives."
)
READS_BELOW_A_COUNT = (
    "The reading seems to be off by {size:.2g} {unit} in waves of {period:.4g} {unit}: less than half a count, too "
    "little to tell an encoder's error from what its counts make. It is taken out of the motion, and asks for nothing."
)
READS_OFF_CENTRE = (
    "The encoder tells up to {size:.2g} {unit} too much or too little over each {period:.4g} {unit}: {counts:.2g} "
    "counts, more than any encoder divides a line into. So does one that is off centre on a shaft that turns once over "
    "that way: a screw, a pinion, a gear. It is an error of the measurement and no torque, and taken out of the "
    "motion; centre the encoder, renew its coupling, or correct the reading by a table in the drive."
)
CYCLES_LATE = (
    "The torque acts {cycles} of {period:.3g} ms after the row that it is recorded in, as one that goes over a bus "
    "does. It is no effect of the axis, and taken out. Look up how long the bus and the drive's input take: what they "
    "do not account for is a lag of the torque, and a shorter one makes room for faster gains."
)
CYCLES_OR_LAG = (
    "The torque acts {cycles} of {period:.3g} ms after the row that it is recorded in. A bus does that; a filter or a "
    "running mean of the demand, with the row read half a cycle sooner or later, may leave as little behind a drive's "
    "own loop. It is no effect that these data tell from a bus, and taken out; a prompter one makes room for faster "
    "gains."
)
MOVED_UNTOLD = (
    "The torque was taken to act {late:.2g} ms {when} than it was recorded, where inertia and friction explain it "
    "best: no controller tells when it acts, and a lag of the loop is none that these data could show. What the model "
    "lacks moves that time too: it is no measurement of a delay."
)
NOT_LOOKED_FOR = (
    "Without a twin {names} cannot be told, and {was} not looked for; a twin needs the reference that the controller "
    "followed, and all of the torque that the axis was given. How much one of them would explain a fit tells, but not "
    "whether it is there: autotune model add EFFECT FILE --model MODEL.toml --out NEW.toml."
)
MOVED_IN_A_ROW = (
    "The axis answers {late:.2g} ms after the torque that {told}: less than half a row, which the moment within a row "
    "makes at which a torque is read or set, and a quick current loop. It is nothing to look for, and taken out."
)
MOVED = (
    "The axis answers {late:.2g} ms after the torque that {told}. A current loop or a filter between demand "
    "and torque is late so, and so is a torque that is read sooner than its row: nothing in these data tells which it "
    "is, nor whether it is an effect of the axis. It is taken out."
)
MEASURED_SOONER = (
    "The axis answers {late:.2g} ms after the torque that was measured. Neither a bus nor a current loop makes that: "
    "both lie before that torque. A position that is filtered, or read later than the torque of its row, does, and so "
    "does a lag between torque and motion: nothing in these data tells which. It is taken out."
)
DELAYED = (
    "A dead time, as a host, a bus and a drive's input may have it, does as well as this lag: it delays the torque and "
    "does not bend it beyond chance. So it is suspected only; look up how the demand reaches the drive, and when."
)
TOLD_WITHOUT = (
    "How late the torque acts was told beside a model that lacks something, and what it lacks may look like a delay: "
    "take it for a guess."
)
AT_ITS_END = (
    "That is as late as a bus and a current loop may make it. The torque may come later still, by a filter or a dead "
    "time, as these data do not tell its length well: look them up in the drive. Such a lag is an effect, and is not "
    "ruled out here."
)
PROGRAMME = "autotune record AXIS.toml decide --from DIAGNOSIS.json --out FILE"
"""DIAGNOSIS.json is what `diagnose --json` printed; diagnosed are then both recordings."""
OWN_RECORDER = (
    "record it with your own controller or scope, at least twice, and import both: autotune data import FILE"
)
"""Where the axis is not one that this program has recorded."""
LEFT_BESIDE = (
    "Beside what is named an error of {times:.2g} times the noise is left that comes again: another effect, or another "
    "law of what is named{part}; where and when it is there, the page of autotune model compare --html shows."
)
PART_OF_REST = "; {effect} explains {percent} % of that and may be part of the truth"
LOOKED_FOR = "effects that could be looked for"
NEEDS_A_TWIN = "; what needs a twin was not looked for"
GIVEN_AS = "Give it as a further file (autotune model diagnose FILE OTHER), or in this one, its rows labelled 'veto'."
GIVEN_BESIDE = (
    "Give it as a further file (autotune model diagnose FILE OTHER), beside the rows labelled 'veto' in this."
)
"""How a trajectory reaches a diagnosis that confirms by it, and how where one is there already."""
PLAYED_ONCE = "the veto trajectory, of which no two repeats are alike, does not bear it out beyond chance"
OTHER_STATE = (
    "These data hold {kinds} kinds of motion, each repeated, so another motion tells little more. Change one thing on "
    "the machine and record the same again: the load taken off, another payload, cold and warm. What changes with it "
    "tells where it comes from; the page of autotune model compare --html shows where and when it is there"
)
OTHER_TRAJECTORY = (
    "These data hold {kinds} kinds of motion, each repeated. Another trajectory confirms or refutes the name: other "
    "strokes, speeds and places than these have; {how}. {given}"
)
ALL_KINDS = 5
"""Kinds of motion among which every effect shows itself; as many as where nothing is known of what is missing."""
ALREADY_THERE = (
    "; where these data have that already, change one thing on the machine and record the same again: the load taken "
    "off, another payload, cold and warm"
)
REPEATS_DIFFER = (
    "Repeats of the same motion differ by {percent} % of the torque (rms). An axis that sticks and slips or hunts "
    "does so, and what is smaller than that cannot be seen here: make the loop calmer, and record again."
)
LOUD_REPEATS = 0.05
"""Of the torque (rms): disturbances and sensors of axes that are used make one to three hundredths."""
MOST_NAMES = 4
"""In one sentence: a longer list tells nobody what to look at."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One effect's evidence.

    Attributes:
        gain: fall of the squared error on unseen experiments, relative.
        error_before, error_after: rms on unseen experiments [N m or N].
        contribution: what the residual of the model without it loses with it, on the rows that were fitted, shape (m,).
    """

    effect: str
    gain: float
    error_before: float
    error_after: float
    accepted: bool
    why: str
    contribution: Floats | None = field(default=None, repr=False, compare=False)


def torque_path_notes(data: Prepared, law: PositionController | None = None) -> tuple[str, ...]:
    """On what a demand goes through before it acts, and was taken out: cycles of a bus, and the current loop.

    Cycles that only make up for a record that was taken to be late are none. Of a `law` that works between the samples
    nothing but the twin tells when a torque was read, so that cycles are one way to say how late it acts.
    """
    notes = []
    whole = _whole_cycles(data)
    if law is not None and data.by_sensor and not _within_a_row(data):
        notes.append(MEASURED_SOONER.format(late=1e3 * data.late * data.period))
    elif whole > 0:
        cycles = f"{whole} cycle" + "s" * (whole > 1)
        said = CYCLES_OR_LAG if law is not None and law.ticks > 1 else CYCLES_LATE
        notes.append(said.format(cycles=cycles, period=1e3 * data.upsampling * data.period))
    elif law is not None and data.late > 0.0:
        told = "its controller asked for" if law.asked > 0.0 else "is recorded"
        said = MOVED_IN_A_ROW if _within_a_row(data) else MOVED
        notes.append(said.format(late=1e3 * data.late * data.period, told=told))
    elif law is None and abs(data.late) >= data.upsampling:
        when = "later" if data.late > 0.0 else "sooner"
        notes.append(MOVED_UNTOLD.format(late=1e3 * abs(data.late) * data.period, when=when))
    if _is_told(data):
        late, error, hertz = 1e3 * data.lag, 1e3 * data.lag_error, 1.0 / (2.0 * math.pi * data.lag)
        loop = CURRENT_LOOP_AT_LEAST if data.lag >= CURRENT_LOOP else CURRENT_LOOP_LATE
        notes.append(loop.format(late=late, error=error, hertz=hertz))
    if data.cycles >= max(CYCLES) and data.lag >= CURRENT_LOOP:
        notes.append(AT_ITS_END)
    if data.reading is not None:
        notes.append(_reading_note(data, data.reading))
    return tuple(notes)


def _within_a_row(data: Prepared) -> bool:
    """Whether the axis answers no more than half a row after the torque: the moment within a row makes that."""
    return 2.0 * data.late <= data.upsampling


def told_late(data: Prepared) -> bool:
    """Whether cycles of a bus or a current loop were taken out."""
    return _whole_cycles(data) > 0 or _is_told(data)


def _whole_cycles(data: Prepared) -> int:
    """Cycles of a bus that are none of a record that was taken to be late."""
    return min(data.cycles, round(data.late / data.upsampling))


def _is_told(data: Prepared) -> bool:
    """Whether a current loop is told from none."""
    return data.lag > 2.0 * data.lag_error


def _reading_note(data: Prepared, wave: ReadingWave) -> str:
    """What an encoder tells too much in waves over the place, and why it may."""
    period = 2.0 * math.pi / wave.wavenumber
    told = {"size": wave.size, "period": period, "unit": data.metadata.motion_unit}
    if wave.size < 0.5 * data.resolution:
        return READS_BELOW_A_COUNT.format(**told)
    if wave.interpolated(data.resolution):
        return READS_IN_WAVES.format(**told)
    return READS_OFF_CENTRE.format(**told, counts=period / data.resolution)


def not_looked_for(
    problem: Problem, evidence: Evidence, told: ScreenedCandidate | None = None
) -> tuple[str, ...]:
    """Says which effects such recordings cannot show as there is no twin; none where there is one.

    `told`: one of them, of which more is said already.
    """
    if problem.twin or problem.data.steady:
        return ()
    asked = evidence.candidates(problem)
    said = "" if told is None else told.effect
    names = [
        kind.name.replace("_", " ") for kind in problem.candidates if kind not in asked and kind.name != said
    ]
    if not names:
        return ()
    listed = " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    return (NOT_LOOKED_FOR.format(names=listed, was="was" if len(names) == 1 else "were"),)


def candidate_rows(
    problem: Problem,
    evidence: Evidence,
    root: ModelFit,
    first: Sequence[ScreenedCandidate],
    tried: Sequence[FittedCandidate],
    effects: Sequence[str],
) -> tuple[Candidate, ...]:
    """One row for every candidate: those that were taken first, then by gain."""
    count = max(float(problem.training.sum()), 1.0)
    before = math.sqrt(root.unseen.total / count)
    fits = {item.effect: item for item in tried}
    table = []
    for item in first:
        accepted = item.effect in effects
        gain = max(fits[item.effect].gain if item.effect in fits else item.gain, WORST_GAIN)
        after = before * math.sqrt(max(1.0 - gain, 0.0))
        text = why(problem, evidence, root, item, fits, effects)
        table.append(Candidate(item.effect, gain, before, after, accepted, text, _taken(root, item, fits)))
    return tuple(sorted(table, key=lambda one: (not one.accepted, -one.gain)))


def _taken(root: ModelFit, item: ScreenedCandidate, fits: Mapping[str, FittedCandidate]) -> Floats:
    """What the residual loses with this effect alone: by its fit inside the twin, where there is one of it alone."""
    fit = fits.get(item.effect)
    alone = fit is not None and set(fit.model_fit.effects) <= {*root.effects, item.effect}
    return root.fitted.error - (fit.model_fit.fitted if fit is not None and alone else item.fitted).error


def _short_of_a_name(
    problem: Problem, evidence: Evidence, root: ModelFit, fit: FittedCandidate, effects: Sequence[str]
) -> str:
    """What a candidate lacks that was followed to the end; `effects` are those that are named."""
    if effects:
        return "not the best explanation"
    needed = needed_share(problem, fit)
    if evidence.repeats and fit.share < needed:
        return f"{100 * needed:.0f} % are needed for a name"
    if not evidence.in_sight(problem, root, fit.model_fit):
        least = problem.policy.structure_part
        return f"of no experiment as much as {100 * least:.0f} % of what repeats do not share"
    return ANY_COURSE if any_course(problem, root, fit.model_fit) else "not beyond doubt"


def why(
    problem: Problem,
    evidence: Evidence,
    root: ModelFit,
    item: ScreenedCandidate,
    fits: Mapping[str, FittedCandidate],
    effects: Sequence[str],
) -> str:
    """Why a candidate was taken or left; `effects` are those that are named."""
    accepted = item.effect in effects
    if item.effect in fits:
        text = evidence.explains(fits[item.effect])
        if accepted:
            return text
        return f"{text}; {_short_of_a_name(problem, evidence, root, fits[item.effect], effects)}"
    if accepted:
        return "taken beside the others: lowers what they leave"
    gain = f"gain {100 * max(item.gain, WORST_GAIN):.1f} % on unseen experiments"
    gate = evidence.stopped_by(problem, root, item)
    if gate:
        return f"{gain}; {gate}"
    return f"{gain}, {'less than others' if fits or effects else 'too little to be followed'}"


def rms_unexplained(problem: Problem, root: ModelFit, rows: Flags | None = None) -> float:
    """Of the recorded torque on the rows that are fitted, or on those given: the share that the model leaves, by their
    spread; of motion one way by their size, as friction is a level there, which the model explains."""
    rows = problem.training > 0 if rows is None else rows
    left = root.fitted.error[rows]
    if not problem.scales.one_way:
        left = left - left.mean()
    return float(np.sqrt(np.mean(left**2))) / rms_recorded(problem, rows)


def rms_recorded(problem: Problem, rows: Flags) -> float:
    """Of the recorded torque on rows of shape (m,), by its spread; of motion one way by its size [N m]."""
    torque = problem.data.torque[problem.data.grid[rows]]
    own = torque if problem.scales.one_way else torque - torque.mean()
    return max(float(np.sqrt(np.mean(own**2))), 1e-300)


def rms_above(problem: Problem) -> float:
    """Of the recorded torque on the rows that are fitted: the share of its rms above the frequencies compared."""
    data, rows = problem.data, problem.training > 0
    torque = data.torque[data.grid[rows]]
    above = torque - smoothed(data, data.torque)[rows]
    return float(np.sqrt(np.mean(above**2))) / rms_recorded(problem, rows)


def unexplained(problem: Problem, model_fit: ModelFit) -> float:
    """Share of the torque's variance that a model leaves on the rows that count."""
    rows = problem.training > 0
    torque = smoothed(problem.data, problem.data.torque)[rows]
    return float(np.var(model_fit.fitted.error[rows])) / max(float(np.var(torque)), 1e-300)


def left_out_note(problem: Problem, root: ModelFit) -> tuple[str, ...]:
    """How many rows were left out, and what the model leaves of the torque there: an effect may show there alone."""
    out = problem.data.role(TRAINING) & (problem.weight <= 0.0)
    share = float(np.count_nonzero(problem.weight <= 0.0)) / len(problem.weight)
    if share == 0.0:
        return ()
    text = f"{100 * share:.1f} % of the rows were left out: starts, stops or disturbances"
    if np.count_nonzero(out) < 2:
        return (f"{text}.",)
    torque = math.sqrt(float(np.mean(problem.data.torque[problem.data.grid[out]] ** 2)))
    left = math.sqrt(float(np.mean(root.fitted.error[out] ** 2))) / max(torque, 1e-300)
    return (f"{text}; there the model leaves {percent(left)} % of the torque (rms).",)


def repeats_note(apart: float) -> str:
    """What may be missing unseen where repeats differ by so much of the torque (rms); empty where that is ordinary."""
    return f" {REPEATS_DIFFER.format(percent=percent(apart))}" if apart > LOUD_REPEATS else ""


def nothing_note(
    problem: Problem,
    evidence: Evidence,
    root: ModelFit,
    first: Sequence[ScreenedCandidate],
    tried: Sequence[FittedCandidate],
) -> str:
    """Where nothing is missing: the share of the torque that stays unexplained, what stopped the best candidate, and
    where more of the torque than that is not compared at all, how much."""
    share = rms_unexplained(problem, root)
    text = f"{percent(share)} % of the torque (rms) stay unexplained after refitting"
    if np.any(problem.weight <= 0.0):
        whole = rms_unexplained(problem, root, problem.data.role(TRAINING))
        text += f", {percent(whole)} % with the rows that were left out"
    best = max(first, key=lambda item: item.gain, default=None)
    if best is None or best.gain <= 0.0:
        text += "; no candidate lowers it on unseen experiments."
    else:
        text += f"; {nearest(problem, evidence, root, best, tried)}"
    if evidence.repeats:
        text += repeats_note(evidence.noise_rms(problem, root) / rms_recorded(problem, problem.training > 0))
    above = 0.0 if problem.data.steady else rms_above(problem)
    if above <= share:
        return text
    return f"{text} {NOT_COMPARED.format(percent=percent(above), hertz=problem.data.cutoff)}"


def nearest(
    problem: Problem,
    evidence: Evidence,
    root: ModelFit,
    best: ScreenedCandidate,
    tried: Sequence[FittedCandidate],
) -> str:
    """The candidate that gains most, and what stopped it: as it was fitted where it was, as among the candidates."""
    gate, gain = evidence.needs_twin(problem, best) or evidence.stopped_by(problem, root, best), best.gain
    where = "inside the twin" if problem.twin else "in a full fit"
    fitted = next((item for item in tried if item.effect == best.effect), None)
    if not gate and fitted is not None:
        gate, gain = f"{where} it {evidence.explains(fitted)}", fitted.gain
    name = best.effect.replace("_", " ")
    gate = gate or f"refuted or not borne out {where}"
    return f"{name} comes nearest, gain {100 * gain:.1f} % on unseen experiments, and is not taken: {gate}."


def unknown_note(
    problem: Problem,
    evidence: Evidence,
    coordinate: str,
    gain: float,
    chosen: FittedCandidate | None,
    tried: Sequence[FittedCandidate],
    nearly: bool = False,
) -> str:
    """What is known about what is unknown: where it sits, and what explains a part, each of them by itself.

    `nearly`: whether a known effect may be all of it, and was not taken.
    """
    policy = problem.policy
    part = chosen if chosen is not None and chosen.share >= policy.partly else None
    found, least = (part.model_fit.effects, policy.partly) if part is not None else ((), WORTH_TELLING)
    near = [item for item in tried if item.effect not in found and item.share >= least]
    text = f"Something {'repeatable ' if evidence.repeats else ''}is missing"
    known = "known effects" if problem.twin else LOOKED_FOR
    if nearly or part is not None or any(item.training.share >= policy.named for item in tried):
        text += " that no known effect explains beyond doubt"
    else:
        text += f" that none of the {known} explains" + " alone" * bool(near)
    if gain > policy.generic_gain:
        text += f"; it is structured in {coordinate.replace('_', ' ')}"
    if part is not None:
        names = ", ".join(found).replace("_", " ")
        text += f"; {names} {evidence.explains_part(part)} and may be part of the truth"
    for item in sorted(near, key=lambda item: -item.share):
        text += f"; {item.effect.replace('_', ' ')} {evidence.explains_part(item)}"
        text += " instead" * (part is not None)
    return text + "."


def stranger_note(effect: str, times: float, error: float) -> str:
    """Why an effect is not named of which a part is so many times what its law makes, with this standard error."""
    law, name = EFFECTS[effect].proportion, effect.replace("_", " ").capitalize()
    if law is None or not math.isfinite(error):
        return f"{name} explains most, but so may something else; nothing is named."
    return (
        f"{name} explains most, but {law.name} is {times:.2f} ± {error:.1g} times what its law makes; "
        f"{law.stranger}, has {law.other:g}. So nothing is named."
    )


def relaxed_note(effect: str, others: Sequence[str], held: float, seconds: float) -> str:
    """Why an effect of the place is not named whose torque goes at rest, but for the part that is `held`.

    `others`: what it was found beside.
    """
    name, stays = effect.replace("_", " "), f"to {100 * held:.0f} % of it" if held > 0.0 else "all of it"
    beside = " and ".join(others).replace("_", " ")
    found = f"Beside {beside} a {name} explains most of the rest" if others else f"A {name} explains most"
    memory = "; a memory by another law looks so, too" if REVERSAL_MEMORY.name in others else ""
    return (
        f"{found}, but its torque does not hold: while the axis stays it goes, {stays} in the end, with "
        f"a time constant of some {seconds:.2g} s. No spring and no weight does that; a gas that cools or leaks, a "
        f"damper behind a spring or a belt that creeps does{memory}. So nothing is named."
    )


def line_note(line: TimeLine) -> str:
    """What a disturbance that follows the clock is, and where to look for it."""
    if not line.steady:
        return (
            f"A force of {line.hertz:.2f} Hz goes on with the clock through all experiments, but is not as large in "
            f"each ({100 * line.share:.0f} % of the residual's variance): no known effect of the axis does that; look "
            "for what runs beside it while it moves: a tool that cuts, a spindle, a feeder; or for what it sets "
            "swinging itself: a liquid, something that hangs."
        )
    return (
        f"A disturbance of {line.hertz:.2f} Hz runs through all experiments whatever the motion "
        f"({100 * line.share:.0f} % of the residual's variance): look for mains, fans, pumps, neighbours."
    )


def wander_note(data: Prepared) -> str:
    """How far the torque's level wanders by itself; nothing where it does not."""
    if data.wander is None:
        return ""
    unit = torque_symbol(data.metadata.motion_unit, data.metadata.torque_unit)
    size = f"{data.wander.rms:.2g} {unit}"
    return (
        f"The level of the torque wanders from experiment to experiment, whatever the motion (by {size} rms): a torque "
        "sensor's or an amplifier's zero, something that warms. It is no effect that repeats, and taken out."
    )


def breathing_note(line: TimeLine) -> str:
    """What a friction level that follows the clock is, and where to look for it."""
    return (
        f"Friction rises and falls with {line.hertz:.2f} Hz whatever the motion "
        f"({100 * line.share:.0f} % of what differs from repeat to repeat): no known effect does that; look for "
        "a preload that something else moves: a pump, lubrication in strokes, a brake that is not quite open."
    )


def moment_note(data: Prepared, moment: Moment) -> str:
    """What acted once, when, and how much."""
    unit = torque_symbol(data.metadata.motion_unit, data.metadata.torque_unit)
    if moment.friction:
        what = (
            f"friction was {abs(moment.friction):.2g} {unit} {'higher' if moment.friction > 0.0 else 'lower'}"
        )
    else:
        way = "against" if moment.torque > 0.0 else "along"
        what = f"{abs(moment.torque):.2g} {unit} more acted {way} the positive direction"
    return (
        f"From {moment.start:.1f} to {moment.end:.1f} s {what} than when the same motion was played again "
        f"({100 * moment.share:.0f} % of all that differs from repeat to repeat, and at no other time): something that "
        "was there once, as a jam, chips, a hand or a cable that caught. It is no effect that these data show twice."
    )


def missing_codes_note(data: Prepared) -> str:
    """Where an encoder leaves codes out, and what may be at fault; nothing where it does not."""
    if not data.gaps:
        return ""
    most = max(data.gaps, key=lambda gap: gap.passes)
    codes = round(most.width / data.resolution) - 1
    place = f"{most.place:.6g} {data.metadata.motion_unit}"
    others = len(data.gaps) - 1
    more = f", and some at {others} other place{'s' * (others > 1)}" * (others > 0)
    return (
        f"The encoder never tells {codes} codes beside each other at {place}{more}: "
        f"all {most.passes} slow passes, forwards and backwards, jump over them, and the controller answers each as a "
        "push. No effect of the axis does that: look for a scratch or dirt on the scale, a bit that sticks, or an "
        "interpolation that is off."
    )


def sets_of_rivals(
    policy: Policy,
    effects: Sequence[str],
    first: Sequence[ScreenedCandidate],
    carried: Sequence[HoldoutResult],
) -> tuple[tuple[str, ...], ...]:
    """For each of the effects that has any, itself and what these data may not tell from it.

    That is what did nearly as well in its place elsewhere, and what usually looks like it and gains nearly as much
    here as the best of them, the likeliest first.
    """
    gains = {item.effect: item.gain for item in first}
    least = max(
        policy.least_gain,
        policy.rival_gain * max((gains.get(effect, 0.0) for effect in effects), default=0.0),
    )
    sets = []
    for effect in effects:
        elsewhere = [rival for item in carried if item.effect == effect for rival in item.rivals]
        usual = [
            rival for rival in usual_rivals(effect) if rival not in effects and gains.get(rival, 0.0) >= least
        ]
        usual.sort(key=lambda rival: -gains[rival])
        sets.append(tuple(dict.fromkeys([effect, *elsewhere, *usual])))
    return tuple(rivals for rivals in sets if len(rivals) > 1)


def offset_note(packed: Packed, metadata: Metadata) -> str:
    """What a constant beside friction may be, where it is large enough to be asked about."""
    level, size = contact(packed.p, packed.on)[0], abs(float(packed.p[layout.OFFSET]))
    if size <= TOLD_OFFSET * level:
        return ""
    unit = torque_symbol(metadata.motion_unit, metadata.torque_unit)
    return OFFSET.format(size=size, unit=unit, percent=percent(size / level))


def left_note(problem: Problem, model_fit: ModelFit, further: Sequence[FittedCandidate] = ()) -> str:
    """What the model with all that is named leaves that comes again, where that is as much as the noise; else empty.

    `further`: effects fitted beside all that is named, and not taken; which of them explains most of that, and half
    of training and veto each, is told. Fits of other rows than those that are compared now say nothing.
    """
    error = model_fit.fitted.error
    noise = problem.noise_variance(error, TRAINING)
    again = problem.mean_square(error, TRAINING) - noise
    if noise <= 0.0 or again < noise:
        return ""
    same = [one for one in further if np.shape(one.model_fit.fitted.error) == np.shape(error)]
    shares = [
        (min(part.share for part in explained_of_rest(problem, model_fit, one.model_fit)), one.effect)
        for one in same
    ]
    share, effect = max(shares, default=(0.0, ""))
    part = ""
    if effect and share >= problem.policy.partly:
        part = PART_OF_REST.format(effect=effect.replace("_", " "), percent=percent(share))
    return LEFT_BESIDE.format(times=math.sqrt(again / noise), part=part)


def headline(
    verdict: str, effects: Sequence[str], confidence: str | None, complete: bool, twin: bool = True
) -> str:
    """The verdict in a line; `complete`: all was asked, and the time was not up before; `twin`: there was one."""
    names = ", ".join(effects)
    if verdict == UNKNOWN and not complete:
        return "time was up before anything had a name: whether something is missing is not known"
    return {
        NAMED: f"missing: {names} ({confidence})",
        NONE: f"nothing is missing that these data could show{'' if twin else NEEDS_A_TWIN}",
        UNKNOWN: f"something is missing that is none of the {'known effects' if twin else LOOKED_FOR}",
        AMBIGUOUS: f"missing: {names}, or what looks like it",
    }[verdict]


def once_more(seconds: float) -> str:
    """What to do next where a search ended after so many `seconds`: it comes before any recording."""
    return f"Diagnose the same data again with more time before anything is recorded: --at-most {4.0 * seconds:.0f}."


def next_experiment(
    verdict: str,
    effects: Sequence[str],
    confusable: Sequence[Sequence[str]],
    confidence: str | None,
    chosen: FittedCandidate | None,
    own_axis: bool,
    kinds: int = 0,
    has_veto: bool = False,
) -> str | None:
    """What to record next, where that would tell more; None where nothing is missing or all is confirmed.

    Args:
        kinds: how many motions these data hold that were played more than once.
        has_veto: whether they hold a trajectory that was not fitted.
    """
    given = GIVEN_BESIDE if has_veto else GIVEN_AS
    there = ALREADY_THERE * (kinds >= ALL_KINDS)
    if verdict == "ambiguous":
        return separating_experiment(confusable[0], own_axis) + there
    if verdict == "named" and confidence == "suspected":
        if not confusable and kinds >= ALL_KINDS:
            return OTHER_TRAJECTORY.format(kinds=kinds, how=_how(own_axis), given=given)
        said = (
            separating_experiment(confusable[0], own_axis) if confusable else _confirming(effects, own_axis)
        )
        return f"{said}{there}. Another trajectory confirms or refutes the name. {given}"
    if verdict == "unknown" and kinds >= ALL_KINDS:
        return OTHER_STATE.format(kinds=kinds)
    if verdict == "unknown":
        return separating_experiment(chosen.model_fit.effects if chosen else (), own_axis) + ALREADY_THERE
    return None


def separating_experiment(rivals: Sequence[str], own_axis: bool) -> str:
    """The experiment that tells most of the rivals apart, in words, and how to come by it.

    Args:
        rivals: effects, the likeliest first.
        own_axis: whether the recordings came from an axis that this program can move.
    """
    names = [rival.replace("_", " ") for rival in rivals[:MOST_NAMES]]
    aim = f"To tell {' from '.join(names)}" if len(names) == 2 else f"To tell {', '.join(names)} apart"
    return _experiment(aim if len(names) > 1 else "To learn more", rivals, own_axis)


def _confirming(effects: Sequence[str], own_axis: bool) -> str:
    """The same for effects that are all named: none of them is to be told from another."""
    names = " and ".join(effect.replace("_", " ") for effect in effects)
    return _experiment(f"To confirm {names}", effects, own_axis)


def _experiment(aim: str, rivals: Sequence[str], own_axis: bool) -> str:
    sets = looking_alike()
    best = max(sets, key=lambda one: (len(sets[one] & set(rivals)), -len(sets[one])))
    separates = len(sets[best] & set(rivals)) > 1
    words = best.experiment if separates else "small and large, slow and fast motion over the whole travel"
    return f"{aim}, move the axis so: {words}; {_how(own_axis)}"


def _how(own_axis: bool) -> str:
    return f"record it: {PROGRAMME}" if own_axis else OWN_RECORDER
