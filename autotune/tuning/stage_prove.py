"""Stage `prove`: windows with and without compensation, in turn: of the benchmark, and of a held-out motion.

On the benchmark it has to be better beyond doubt. On the held-out motion, which nothing was adapted to, it must
not be worse beyond doubt (`proof.harm`); nor may the load have changed meanwhile (`doubts`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from autotune.control.feedforward import FeedforwardLaw
from autotune.core.axis import Benchmark
from autotune.experiments.held_out import HeldOut
from autotune.experiments.path import Motion
from autotune.experiments.sines import BenchmarkSine
from autotune.recordings.recording import Recording, concatenate
from autotune.tuning.proof import HeldOutError, Proof, TrackingError, harm, prove, tracking_error
from autotune.tuning.session import Session
from autotune.tuning.unfit_axes import refuse_changing_load

ENABLED = "feedforward.enabled"
COMMITTED_REPEATS = 2
GIVEN_BACK = 0.5  # share of the proved gain that the committed drive must show at least
HELD_OUT_PAIRS, HELD_OUT_COMMITTED = 4, 3
BEFORE, AFTER, COMMITTED = "before", "after", "committed"


@dataclass(frozen=True, slots=True)
class Proved:
    """The proof and the windows that it rests on; `harmful`: in words, where it may harm another motion."""

    proof: Proof
    before: tuple[Recording, ...]
    after: tuple[Recording, ...]
    held_out_before: HeldOutError
    held_out_after: HeldOutError
    harmful: str = ""

    @property
    def better(self) -> bool:
        """Better on the benchmark beyond doubt, and no worse on a motion that it does not know."""
        return self.proof.better and not self.harmful


@dataclass(frozen=True, slots=True)
class Committed:
    """What the drive does by itself with what was written: on the benchmark, and on the held-out motion."""

    benchmark: TrackingError
    held_out: HeldOutError


def prove_stage(session: Session, law: FeedforwardLaw, own: Mapping[str, float], least: float) -> Proved:
    """Measures before and after in turn.

    Args:
        session: of the run; the drive's own feedforward is off.
        law: to be proved, played by the host.
        own: parameters that switch the drive's own feedforward on, which belongs to "before"; empty for none.
        least: share of the peak error before that must be gained.

    Raises:
        NotTunable: the load changed while the proof was measured.
    """
    benchmark = session.axis.benchmark
    session.begin("prove", proof_seconds(session.motion, benchmark))
    rows = _played_in_turn(session, law, own)
    before, after = (windows_of(rows, label) for label in (BEFORE, AFTER))
    refuse_changing_load((*before, *after), benchmark.frequency)
    confidence = session.axis.acceptance.confidence
    proof = prove(before, after, benchmark.frequency, least, confidence)
    unknown = [HeldOutError.of(windows_of(rows, held_out_label(label))) for label in (BEFORE, AFTER)]
    harmful = harm_in_words(session, unknown[0], unknown[1])
    return Proved(proof, before, after, unknown[0], unknown[1], harmful)


def held_out_label(label: str) -> str:
    """Label of the held-out windows beside those of the benchmark."""
    return f"held_out_{label}"


def harm_in_words(session: Session, before: HeldOutError, after: HeldOutError) -> str:
    """Why the feedforward must not be kept; "" where it is no worse on the held-out motion, beyond doubt."""
    axis = session.axis
    worse = harm(before, after, axis.position_resolution, axis.acceptance.confidence)
    if worse is None:
        return ""
    figure, one, other = worse
    return (
        f"on a motion that it was not adapted to (moves, constant speed, a smaller and faster sine) the {figure} would "
        f"go from {session.milli(one)} to {session.milli(other)}, which is not as good beyond doubt"
    )


def proof_seconds(motion: Motion, benchmark: Benchmark) -> float:
    """Machine time of the proof [s]."""
    window = (benchmark.periods + 2) / benchmark.frequency
    return 2 * (benchmark.repeats * window + HELD_OUT_PAIRS * HeldOut(motion).duration)


def committed_seconds(motion: Motion, benchmark: Benchmark) -> float:
    """Machine time of the measurement after a commit [s]."""
    return with_host_seconds(benchmark) + HELD_OUT_COMMITTED * HeldOut(motion).duration


def with_host_seconds(benchmark: Benchmark) -> float:
    """Machine time of the measurement with what a host plays beside the drive [s]."""
    return (COMMITTED_REPEATS * benchmark.periods + 2) / benchmark.frequency


def measure_committed(session: Session) -> Committed:
    """Benchmark and held-out motion as the drive runs them by itself, without anything from the host."""
    periods = session.axis.benchmark.periods
    sine = BenchmarkSine(session.motion, COMMITTED_REPEATS, periods, label=COMMITTED)
    unknown = held_out_label(COMMITTED)
    others = [HeldOut(session.motion, label=unknown, first_repeat=k) for k in range(HELD_OUT_COMMITTED)]
    rows, _ = session.play(COMMITTED, [sine, *others])
    found = tracking_error(windows_of(rows, COMMITTED), session.axis.benchmark.frequency)
    return Committed(found, HeldOutError.of(windows_of(rows, unknown)))


def measure_with_host(session: Session, host: FeedforwardLaw) -> TrackingError:
    """The benchmark with what the drive holds and what the host plays beside it."""
    periods = session.axis.benchmark.periods
    sine = BenchmarkSine(session.motion, COMMITTED_REPEATS, periods, host, label="with_host")
    rows, _ = session.play("with-host", [sine])
    return tracking_error(windows_of(rows, "with_host"), session.axis.benchmark.frequency)


def holds_what_was_proved(before: TrackingError, after: TrackingError, measured: TrackingError) -> bool:
    """The committed drive gives at least half of the proved gain."""
    gain = before.peak_error - after.peak_error
    return measured.peak_error <= before.peak_error - GIVEN_BACK * gain


def windows_of(recording: Recording, label: str) -> tuple[Recording, ...]:
    """The measured windows under a label, in order."""
    return tuple(rows for segment, rows in recording.split() if segment.experiment == label)


def _windows(session: Session, label: str, repeat: int, law: FeedforwardLaw | None) -> list[BenchmarkSine]:
    """One window of the benchmark, and in the first repeats one of the held-out motion."""
    periods, motion = session.axis.benchmark.periods, session.motion
    windows = [BenchmarkSine(motion, 1, periods, law, first_repeat=repeat, label=label)]
    if repeat < HELD_OUT_PAIRS:
        windows.append(HeldOut(motion, 1, 1, law, first_repeat=repeat, label=held_out_label(label)))
    return windows


def _played_in_turn(session: Session, law: FeedforwardLaw, own: Mapping[str, float]) -> Recording:
    repeats = range(session.axis.benchmark.repeats)
    if own:
        return concatenate([part for repeat in repeats for part in _pair_with_own(session, law, own, repeat)])
    sides = ((BEFORE, None), (AFTER, law))
    experiments = [
        window
        for repeat in repeats
        for label, played in sides
        for window in _windows(session, label, repeat, played)
    ]
    return session.play("proof", experiments)[0]


def _pair_with_own(
    session: Session, law: FeedforwardLaw, own: Mapping[str, float], repeat: int
) -> Sequence[Recording]:
    """The drive's own feedforward is on for "before" only; it is switched at rest."""
    session.loop.write_parameters(own)
    try:
        before, _ = session.play(f"proof-{repeat}-before", _windows(session, BEFORE, repeat, None))
    finally:
        session.loop.write_parameters(dict.fromkeys(own, 0.0))
    after, _ = session.play(f"proof-{repeat}-after", _windows(session, AFTER, repeat, law))
    return before, after
