"""Stage `prove`: windows of the benchmark with and without compensation, in turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from autotune.control.feedforward import FeedforwardLaw
from autotune.core.axis import Benchmark
from autotune.core.recording import Recording
from autotune.experiments.sines import BenchmarkSine
from autotune.service.proof import Proof, TrackingError, prove, tracking_error
from autotune.service.session import Session

ENABLED = "feedforward.enabled"
COMMITTED_REPEATS = 2
GIVEN_BACK = 0.5  # share of the proved gain that the committed drive must show at least


@dataclass(frozen=True, slots=True)
class Proved:
    """The proof and the windows that it rests on."""

    proof: Proof
    before: tuple[Recording, ...]
    after: tuple[Recording, ...]


def prove_stage(session: Session, law: FeedforwardLaw, own: Mapping[str, float], least: float) -> Proved:
    """Measures before and after in turn.

    Args:
        session: of the run; the drive's own feedforward is off.
        law: to be proved, played by the host.
        own: parameters that switch the drive's own feedforward on, which belongs to "before"; empty for none.
        least: share of the peak error before that must be gained.
    """
    benchmark = session.axis.benchmark
    session.begin("prove", proof_seconds(benchmark))
    if own:
        windows = [_pair_with_own(session, law, own, repeat) for repeat in range(benchmark.repeats)]
        before, after = tuple(w[0] for w in windows), tuple(w[1] for w in windows)
    else:
        before, after = _all_pairs(session, law)
    proof = prove(before, after, benchmark.frequency, least, session.axis.acceptance.confidence)
    return Proved(proof, before, after)


def proof_seconds(benchmark: Benchmark) -> float:
    """Machine time of the proof [s]."""
    return 2 * benchmark.repeats * (benchmark.periods + 2) / benchmark.frequency


def committed_seconds(benchmark: Benchmark) -> float:
    """Machine time of the measurement after a commit [s]."""
    return (COMMITTED_REPEATS * benchmark.periods + 2) / benchmark.frequency


def measure_committed(session: Session, host: FeedforwardLaw | None = None) -> TrackingError:
    """The benchmark as the drive runs it by itself, with nothing but `host` from the host."""
    periods = session.axis.benchmark.periods
    sine = BenchmarkSine(session.motion, COMMITTED_REPEATS, periods, host, label="committed")
    recording, _ = session.play("committed", [sine])
    return tracking_error(windows_of(recording, "committed"), session.axis.benchmark.frequency)


def holds_what_was_proved(proof: Proof, committed: TrackingError) -> bool:
    """The committed drive gives at least half of the proved gain."""
    gain = proof.before.peak_error - proof.after.peak_error
    return committed.peak_error <= proof.before.peak_error - GIVEN_BACK * gain


def windows_of(recording: Recording, label: str) -> tuple[Recording, ...]:
    """The measured windows under a label, in order."""
    return tuple(rows for segment, rows in recording.split() if segment.experiment == label)


def _window(session: Session, label: str, repeat: int, law: FeedforwardLaw | None) -> BenchmarkSine:
    periods = session.axis.benchmark.periods
    return BenchmarkSine(session.motion, 1, periods, law, first_repeat=repeat, label=label)


def _all_pairs(session: Session, law: FeedforwardLaw) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    experiments = [
        _window(session, label, repeat, played)
        for repeat in range(session.axis.benchmark.repeats)
        for label, played in (("before", None), ("after", law))
    ]
    recording, _ = session.play("proof", experiments)
    return windows_of(recording, "before"), windows_of(recording, "after")


def _pair_with_own(
    session: Session, law: FeedforwardLaw, own: Mapping[str, float], repeat: int
) -> tuple[Recording, Recording]:
    """The drive's own feedforward is on for "before" only; it is switched at rest."""
    session.loop.write_parameters(own)
    try:
        before, _ = session.play(f"proof-{repeat}-before", [_window(session, "before", repeat, None)])
    finally:
        session.loop.write_parameters(dict.fromkeys(own, 0.0))
    after, _ = session.play(f"proof-{repeat}-after", [_window(session, "after", repeat, law)])
    return windows_of(before, "before")[0], windows_of(after, "after")[0]
