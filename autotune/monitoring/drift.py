"""Has the axis drifted? One check against the committed model and against the checks before it.

Friction counts as drifted where the whole 95 % interval of its relative change, widened by what model
and check differ by on a sound axis, lies beyond the configured size; temperature is taken out where its
influence is known from the history. One check alone only raises suspicion.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from autotune.core.configuration import Strict
from autotune.tuning.committed import Committed

if TYPE_CHECKING:
    from autotune.monitoring.check_figures import CheckFigures

SYSTEMATIC = 0.02
"""Check and identification agree on a sound axis to about this, relative (standard error)."""
ROUGH = 4.0
SOUND_COUNTS = 3.0
Share = Annotated[float, Field(gt=0, le=10)]


class DriftSettings(Strict):
    """What counts as drift.

    Attributes:
        size: relative change of friction that is worth a re-tune.
        tracking: relative growth of the tracking error over what was committed.
        confirmations: checks in a row that must agree before anything is done.
        gain: share of the peak error that a re-tune must gain; 0: whatever is better beyond doubt.
    """

    size: Share = 0.15
    tracking: Share = 0.5
    confirmations: Annotated[int, Field(ge=1, le=10)] = 2
    gain: Annotated[float, Field(ge=0, lt=1)] = 0.0


class Drift(StrEnum):
    """What a check says."""

    NONE = "none"
    SUSPECTED = "suspected"
    DRIFTED = "drifted"
    HARMFUL = "harmful"
    SIGNAL = "signal"
    LOST = "lost"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Before:
    """An earlier check, as far as a verdict needs it; `run`: what it compared with, by `change`."""

    at: str
    run: str
    change: float | None
    beyond: bool
    level: float
    temperature: float
    position_noise: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on one check.

    Attributes:
        change, interval: of friction, relative to the committed model, temperature taken out where known.
        beyond: this check by itself says that friction or tracking has drifted beyond the size.
        sentence: in plain words.
        advice: what a person can do; "" where there is nothing.
    """

    drift: Drift
    sentence: str
    advice: str = ""
    change: float | None = None
    interval: tuple[float, float] | None = None
    beyond: bool = False
    notes: tuple[str, ...] = ()

    @property
    def wants_tuning(self) -> bool:
        """Beyond doubt, and a tuning can help."""
        return self.drift in (Drift.DRIFTED, Drift.HARMFUL, Drift.LOST)


@dataclass(frozen=True, slots=True)
class Evidence:
    """Everything a verdict rests on.

    Attributes:
        held: whether the drive holds what was committed; None where nothing was.
        earlier: checks before this one, oldest first.
        temperature_coefficient: relative change of friction a kelvin, where the history tells it.
        reference_temperature: at which the committed model holds [°C], nan if unknown.
        resolution: one count of the encoder [motion unit].
    """

    figures: CheckFigures
    committed: Committed | None
    held: bool | None
    earlier: Sequence[Before]
    resolution: float
    temperature_coefficient: float | None = None
    reference_temperature: float = math.nan


def judge(evidence: Evidence, settings: DriftSettings) -> Verdict:
    """The verdict: signal quality first, as nothing else can be trusted without it."""
    rough = _rough_signal(evidence)
    if rough is not None:
        return rough
    if evidence.committed is None:
        return Verdict(
            Drift.UNKNOWN,
            "Nothing has been committed to this axis yet, so there is nothing to compare with; friction is "
            f"{_figure(evidence)}.",
            "Run 'autotune run' once.",
        )
    return _compared(evidence, settings)


def _compared(evidence: Evidence, settings: DriftSettings) -> Verdict:
    change, interval, notes = friction_change(evidence)
    friction_moved = interval is not None and (interval[0] > settings.size or interval[1] < -settings.size)
    growth = tracking_growth(evidence)
    tracking_lost = growth is not None and growth > settings.tracking
    if evidence.held and harmful(evidence.figures):
        return Verdict(
            Drift.HARMFUL,
            "The axis follows worse with the committed compensation than without it: friction is "
            f"{_words(change)} {_baseline(evidence)}.",
            "Tune again now, or switch the compensation off ('autotune rollback').",
            change, interval, True, notes,
        )  # fmt: skip
    if evidence.held is False and not friction_moved:
        return Verdict(
            Drift.LOST,
            f"The drive does not hold what was committed in {_run(evidence)}: it was exchanged, reset, or set by "
            f"another hand. Friction is {_words(change)} {_baseline(evidence)}.",
            "Tune again ('autotune run'), or find out who changed it.",
            change, interval, False, notes,
        )  # fmt: skip
    if not friction_moved and not tracking_lost:
        return Verdict(
            Drift.NONE, f"No drift: friction is {_words(change)} {_baseline(evidence)}{_followed(growth)}.", "",
            change, interval, False, notes,
        )  # fmt: skip
    return _moved(evidence, settings, change, interval, growth, friction_moved, notes)


def _moved(
    evidence: Evidence,
    settings: DriftSettings,
    change: float | None,
    interval: tuple[float, float] | None,
    growth: float | None,
    friction_moved: bool,
    notes: tuple[str, ...],
) -> Verdict:
    agreeing = 1 + _agreeing(evidence, change if friction_moved else None)
    sure = agreeing >= settings.confirmations
    what = (
        f"friction is {_words(change)} {_baseline(evidence)}"
        if friction_moved
        else "the tracking error has grown"
    )
    count = f"seen in {agreeing} checks in a row" if agreeing > 1 else "seen once"
    return Verdict(
        Drift.DRIFTED if sure else Drift.SUSPECTED,
        f"{'Drift' if sure else 'Suspicion of drift'}: {what}{_followed(growth)}; {count}.",
        _advice(change, friction_moved),
        change, interval, True, notes,
    )  # fmt: skip


def friction_change(
    evidence: Evidence,
) -> tuple[float | None, tuple[float, float] | None, tuple[str, ...]]:
    """Relative change against the model with its 95 % interval, at the same temperature where possible."""
    figures, coefficient = evidence.figures, evidence.temperature_coefficient
    if figures.expected is None or figures.expected <= 0.0:
        return None, None, ("the committed run has no model to compare with",)
    change = figures.level.value / figures.expected - 1.0
    error = math.hypot(figures.level.standard_error / figures.expected, SYSTEMATIC)
    notes: tuple[str, ...] = ()
    warmer = figures.temperature - evidence.reference_temperature
    if coefficient is not None and math.isfinite(warmer):
        change = (1.0 + change) / max(1.0 + coefficient * warmer, 0.2) - 1.0
        notes = (f"compared at the same temperature ({100 * coefficient:+.1f} % a kelvin, {warmer:+.1f} K)",)
    reach = 1.96 * error
    return change, (change - reach, change + reach), notes


def tracking_growth(evidence: Evidence) -> float | None:
    """How much the peak error exceeds what was committed, relative, less twice its own scatter."""
    committed, tracking = evidence.committed, evidence.figures.tracking
    if committed is None or not committed.peak_error or not evidence.held:
        return None
    sure = tracking.error.peak_error - 2.0 * tracking.spread
    return sure / committed.peak_error - 1.0


def harmful(figures: CheckFigures) -> bool:
    """With compensation the axis follows worse than without, beyond the scatter of both."""
    spread = math.hypot(figures.tracking.spread, figures.uncompensated.spread)
    difference = figures.tracking.error.peak_error - figures.uncompensated.error.peak_error
    return difference > max(2.0 * spread, 0.05 * figures.uncompensated.error.peak_error)


def _agreeing(evidence: Evidence, change: float | None) -> int:
    """Checks directly before this one that were beyond the size as well, in the same direction."""
    count = 0
    run = evidence.committed.baseline if evidence.committed else ""
    for before in reversed(evidence.earlier):
        same_sign = change is None or before.change is None or (before.change > 0) == (change > 0)
        if before.run != run or not before.beyond or not same_sign:
            break
        count += 1
    return count


def _rough_signal(evidence: Evidence) -> Verdict | None:
    noise = evidence.figures.position_noise
    usual = median_of([before.position_noise for before in evidence.earlier[-30:]])
    allowed = max(ROUGH * (usual or 0.0), SOUND_COUNTS * evidence.resolution)
    if not math.isfinite(noise) or noise <= allowed:
        return None
    return Verdict(
        Drift.SIGNAL,
        f"The position signal is rough: {noise:.2g} rms from sample to sample, {noise / evidence.resolution:.0f} "
        "counts; friction and tracking of this check cannot be trusted.",
        "Check encoder, cable, plug and shielding. No tuning is started on such a signal.",
    )


def _baseline(evidence: Evidence) -> str:
    """What friction is compared with, in words."""
    committed = evidence.committed
    if committed is None or not committed.accepted:
        return "what was committed"
    return f"what the run {committed.accepted} found"


def _run(evidence: Evidence) -> str:
    return evidence.committed.run if evidence.committed else "an earlier run"


def median_of(values: Sequence[float]) -> float | None:
    """Median of the finite values; None where there are fewer than three."""
    finite = [value for value in values if math.isfinite(value)]
    return statistics.median(finite) if len(finite) >= 3 else None


def _figure(evidence: Evidence) -> str:
    level = evidence.figures.level
    return f"{level.value:.3g} ± {1.96 * level.standard_error:.1g} {level.unit}"


def _words(change: float | None) -> str:
    if change is None:
        return "not comparable with"
    if abs(change) < 0.005:
        return "the same as"
    return f"{abs(change):.0%} {'above' if change > 0 else 'below'}"


def _followed(growth: float | None) -> str:
    return f", the peak error {1.0 + growth:.1f} times the committed one" if growth and growth > 0.05 else ""


def _advice(change: float | None, friction_moved: bool) -> str:
    if not friction_moved:
        return "Look for backlash, loose couplings or changed controller gains."
    if change is not None and change > 0:
        return "Check lubrication, seals and guideways."
    return "As after re-greasing or running-in; a re-tune fits the compensation to it."
