"""The ceiling on the axis: iterative learning on the benchmark, beside the fixed parameters of the last run.

Trials are windows of the benchmark under the guard, with a torque that the host plays; nothing is written to the
drive, and its own feedforward is off meanwhile. Learning begins with what the fixed parameters play, so that it can
only be nearer. Both, and the axis without either, then run on motions that none of them has seen.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from autotune.control.feedforward import FeedforwardLaw, FixedFeedforward
from autotune.control.learning import LearntFeedforward, by_phase, next_torque
from autotune.control.model_feedforward import ModelFeedforward
from autotune.control.refinement import PeriodAverage
from autotune.core.arrays import Floats
from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.experiments.experiment import Experiment
from autotune.experiments.path import Motion
from autotune.experiments.sines import BenchmarkSine, period_samples
from autotune.experiments.standstill import standing
from autotune.models.model_file import read_model
from autotune.tuning.ceiling_note import FILE
from autotune.tuning.files import finite, write_json
from autotune.tuning.findings import FILE_NAME, HOST_FILE, latest_run, load_findings
from autotune.tuning.motion_plan import MotionPlan, planned
from autotune.tuning.preparation import SessionRequest, connected, own_run, prepared
from autotune.tuning.proof import tracking_error
from autotune.tuning.recovery import recover
from autotune.tuning.session import Session
from autotune.tuning.stage_adapt import REFINEMENT_PERIODS, measure_window, period_average, window_seconds
from autotune.tuning.stage_prove import windows_of

STAGE = "ceiling"
TRIALS = 8
STALLS = 3
"""Trials without a better one, after which it has converged."""
DIVERGES = 1.5
"""Times the error that learning began with, at which it is given up."""
FARTHEST = 0.5
"""Of the largest torque that learning began with: how far it may go from it."""
LEFT = 0.9
"""Of the torque limit: what the host may ask for; the rest is the controller's."""
PAIRS = 2
"""Windows of each side that the comparison rests on, measured in turn."""
UNSEEN = (
    (0.9, 0.8), (0.75, 0.6), (0.6, 1.2), (0.5, 0.5), (0.45, 1.4),
    (0.35, 0.9), (0.3, 1.6), (0.25, 0.7), (0.2, 1.1), (0.15, 2.0),
)  # fmt: skip
"""Amplitude and frequency of sines, of the benchmark's; none asks for more speed or acceleration."""
UNSEEN_PERIODS = 2
SPARE_SECONDS = 3.0
"""Of machine time: the way to a motion and between its windows."""
FIXED, LEARNT, NEITHER, BY_TIME = "fixed", "learnt", "neither", "by_time"


@dataclass(frozen=True, slots=True)
class Unseen:
    """Peak errors of the averaged period on a sine that nothing was learnt on [motion unit].

    `learnt`: with what was learnt, stretched to the period of this one, which is kinder than by time: the torque is
    then right at every reversal. `by_time` and `fixed_raw`: the torque as it was learnt, its own period over and over,
    and the fixed parameters; both not averaged, since that error has not the period of the motion.
    """

    amplitude: float
    frequency: float
    fixed: float
    learnt: float
    neither: float
    by_time: float
    fixed_raw: float


@dataclass(frozen=True, slots=True)
class Ceiling:
    """Peak errors of the averaged benchmark [motion unit]; `trials` of each trial of learning, the start first.

    `torque`: one period of what was learnt [N m or N], along `Motion.of` the axis.
    """

    fixed: float
    learnt: float
    neither: float
    trials: tuple[float, ...]
    unseen: tuple[Unseen, ...]
    torque: tuple[float, ...] = ()

    def as_json(self) -> dict[str, object]:
        return {
            "fixed": self.fixed,
            "learnt": self.learnt,
            "neither": self.neither,
            "trials": list(self.trials),
            "unseen": [asdict(one) for one in self.unseen],
        }

    def in_words(self, unit: str) -> str:
        """How near the fixed parameters come to it, on the learnt motion and on others."""
        learnt, fixed, none = (1e3 * value for value in (self.learnt, self.fixed, self.neither))
        said = (
            f"Ceiling, measured on the axis: iterative learning takes the benchmark's peak error to {learnt:.3g} "
            f"m{unit}, the fixed parameters to {fixed:.3g} m{unit} ({100 * (fixed / learnt - 1):+.0f} %); without "
            f"either it is {none:.3g} m{unit}."
        )
        if not self.unseen:
            return f"{said} Machine time did not suffice for motions that were not learnt."
        bare = [one.neither / one.fixed for one in self.unseen]
        stretched = [one.learnt / one.fixed for one in self.unseen]
        played = [one.by_time / one.fixed_raw for one in self.unseen]
        return (
            f"{said} On {len(self.unseen)} sines that neither has seen, the fixed parameters leave {_range(bare)} "
            f"times less than nothing does, {_range(played)} times less than what was learnt, played as it is, and "
            f"{_range(stretched)} times less than that stretched to their period."
        )


def _range(values: Sequence[float]) -> str:
    return f"{min(values):.1f} to {max(values):.1f}"


def fixed_law(axis: Axis, runs: Path) -> FeedforwardLaw:
    """What the last run proposed: the model's feedforward, the thesis's, or of a model alone its own.

    Raises:
        ConfigurationError: there is no run with a model.
    """
    try:
        latest_run(runs, axis, FILE_NAME)
    except ConfigurationError:
        return ModelFeedforward(read_model(latest_run(runs, axis, "model.toml") / "model.toml"), axis.cycle)
    found = load_findings(runs, axis, "prove")
    if found.proposed_model is not None:
        return ModelFeedforward(found.proposed_model, axis.cycle)
    if found.proposed is None:
        raise ConfigurationError(
            f"the last run proposed no feedforward ({HOST_FILE}); run 'autotune run' again"
        )
    return FixedFeedforward(found.proposed, axis.cycle)


def ceiling_plan(axis: Axis) -> MotionPlan:
    """What is going to move, at most."""
    motion = Motion.of(axis)
    sines: list[Experiment] = [BenchmarkSine(motion, 1, REFINEMENT_PERIODS)] * (TRIALS + 1)
    sines += [BenchmarkSine(motion, 1, axis.benchmark.periods)] * (3 * PAIRS)
    for number in range(len(UNSEEN)):
        sines += _on_unseen(unseen_motion(motion, number), dict.fromkeys((FIXED, LEARNT, NEITHER, BY_TIME)))
    whole = planned(sines, axis)
    return replace(whole, seconds=min(whole.seconds, axis.limits.machine_seconds))


def measure_ceiling(request: SessionRequest, law: FeedforwardLaw) -> Ceiling:
    """Learns and compares on the axis; nothing is left in the drive.

    Raises:
        AutotuneError, KeyboardInterrupt: after everything was put back; the axis is at rest.
    """
    with own_run(request) as run:
        request.reporter.stage("connect", 3.0)
        with connected(run.opening, run.journal, request.reporter) as loop:
            recover(loop, request.runs, run.journal)
            with prepared(request, loop, run.journal) as session:
                found = _measured(session, law)
        _keep(request, run.directory, run.started, found)
    return found


def _keep(request: SessionRequest, directory: Path, started: datetime, found: Ceiling) -> None:
    """For the reports of later runs (`ceiling_note`); the answer does not hang on it."""
    about = {"fingerprint": request.axis.fingerprint, "measured": started.isoformat()}
    try:
        write_json(directory / FILE, finite({**about, **found.as_json()}))
    except OSError as error:
        request.reporter.say(f"What was found could not be kept in {directory}: {error}")


def _measured(session: Session, law: FeedforwardLaw) -> Ceiling:
    standing(session.loop, session.limits)
    session.begin(STAGE, ceiling_plan(session.axis).seconds)
    best, trials = _learn(session, law)
    laws: dict[str, FeedforwardLaw | None] = {FIXED: law, LEARNT: LearntFeedforward(best), NEITHER: None}
    peaks = _compared(session, laws)
    unseen = [found for number in range(len(UNSEEN)) if (found := _elsewhere(session, number, law, best))]
    return Ceiling(peaks[FIXED], peaks[LEARNT], peaks[NEITHER], trials, tuple(unseen), tuple(best.tolist()))


def _learn(session: Session, law: FeedforwardLaw) -> tuple[Floats, tuple[float, ...]]:
    """The torque of the best trial, and the peak error of each."""
    start = played_by(law, session.motion)
    room = FARTHEST * float(np.max(np.abs(start)))
    torque, best, since = start, start, 0
    done: list[PeriodAverage] = []
    for number in range(TRIALS + 1):
        window = measure_window(session, LearntFeedforward(torque), f"trial-{number}", number)
        done.append(period_average(window, session.axis.benchmark.frequency))
        smooth = [one.smooth_peak for one in done]
        best, since = (torque, 0) if smooth[-1] <= min(smooth) else (best, since + 1)
        left = session.budget.left - (3 * PAIRS + 1) * window_seconds(session.axis.benchmark.frequency)
        if since >= STALLS or smooth[-1] > DIVERGES * smooth[0] or left < 0.0:
            break
        wanted = next_torque(torque, done[-1].feedback, session.axis.cycle)
        bound = LEFT * session.limits.torque
        torque = np.clip(np.clip(wanted, start - room, start + room), -bound, bound)
    return best, tuple(one.peak_error for one in done)


def played_by(law: FeedforwardLaw, motion: Motion) -> Floats:
    """One period of what a law plays along the benchmark in its steady cycle; shape (n,) [N m or N]."""
    n, own = period_samples(motion), copy.deepcopy(law)
    own.prepare()
    rows = BenchmarkSine(motion, 1, 2, own).rows
    torque = [own.step(place, speed, change, None) for place, speed, change, _ in rows[: 3 * n]]
    return np.array(torque[2 * n :])


def _compared(session: Session, laws: Mapping[str, FeedforwardLaw | None]) -> dict[str, float]:
    """Peak error of the averaged benchmark with each law, measured in turn."""
    periods, frequency = session.axis.benchmark.periods, session.axis.benchmark.frequency
    windows = [
        BenchmarkSine(session.motion, 1, periods, law, first_repeat=pair, label=label)
        for pair in range(PAIRS)
        for label, law in laws.items()
    ]
    rows, _ = session.play("compared", windows)
    return {label: tracking_error(windows_of(rows, label), frequency).peak_error for label in laws}


def _elsewhere(session: Session, number: int, law: FeedforwardLaw, learnt: Floats) -> Unseen | None:
    """One motion that nothing was learnt on; None where machine time does not suffice for it."""
    motion = unseen_motion(session.motion, number)
    turned = LearntFeedforward(by_phase(learnt, period_samples(motion)))
    laws = {FIXED: law, LEARNT: turned, NEITHER: None, BY_TIME: LearntFeedforward(learnt)}
    windows = _on_unseen(motion, laws)
    if session.budget.left < sum(one.duration for one in windows) + SPARE_SECONDS:
        return None
    rows, _ = session.play(f"unseen-{number}", windows)
    found = {label: tracking_error(windows_of(rows, label), motion.frequency) for label in laws}
    peaks = {label: found[label].peak_error for label in (FIXED, LEARNT, NEITHER)}
    raw = {BY_TIME: found[BY_TIME].raw_peak_error, "fixed_raw": found[FIXED].raw_peak_error}
    return Unseen(motion.amplitude, motion.frequency, **peaks, **raw)


def unseen_motion(motion: Motion, number: int) -> Motion:
    """One of `UNSEEN`, with a whole number of samples in its period."""
    amplitude, frequency = UNSEEN[number]
    other = replace(motion, amplitude=amplitude * motion.amplitude, frequency=frequency * motion.frequency)
    return replace(other, frequency=1.0 / (period_samples(other) * motion.period))


def _on_unseen(motion: Motion, laws: Mapping[str, FeedforwardLaw | None]) -> list[BenchmarkSine]:
    return [BenchmarkSine(motion, 1, UNSEEN_PERIODS, law, label=label) for label, law in laws.items()]
