"""`autotune check`: the gentle daily look. At most a minute of motion, nothing written for good.

The result is `check.json` in the run's folder, the same object that `autotune check --json` prints.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from autotune.monitoring.check_figures import CheckFigures, Figure, figures
from autotune.monitoring.check_file import FILE_NAME, before_of, earlier_checks, sound_checks
from autotune.monitoring.check_plan import COMPENSATED, UNCOMPENSATED, CheckPlan, plan_check
from autotune.monitoring.drift import Before, DriftSettings, Evidence, Verdict, judge
from autotune.monitoring.friction_scale import UNKNOWN, Background, FrictionScale, course_of, scale_in_words
from autotune.monitoring.trend import trend_over
from autotune.recordings.recording import Recording
from autotune.tuning.committed import Committed, InForce, in_force
from autotune.tuning.files import finite, write_json
from autotune.tuning.journal import Journal
from autotune.tuning.preparation import SessionRequest, connected, own_feedforward, own_run, prepared
from autotune.tuning.recovery import recover
from autotune.tuning.session import Session

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class CheckRequest(SessionRequest):
    """What is asked of a check; `history`: earlier checks as their JSON objects, None: those in `runs`."""

    settings: DriftSettings = field(default_factory=DriftSettings)
    history: Sequence[dict[str, Any]] | None = None
    seed: int = 0


@dataclass(frozen=True, slots=True)
class CheckResult:
    """All that a check says. `at` is UTC."""

    axis: str
    fingerprint: str
    at: str
    machine_seconds: float
    run_directory: Path
    motion_unit: str
    figures: CheckFigures
    verdict: Verdict
    committed: Committed | None
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """The object of `check --json` and check.json."""
        measured, verdict = self.figures, self.verdict
        friction = {name: _figure(one) for name, one in measured.parameters.items()}
        return {
            "schema": SCHEMA_VERSION,
            "axis": self.axis,
            "fingerprint": self.fingerprint,
            "at": self.at,
            "verdict": verdict.sentence,
            "advice": verdict.advice,
            "drift": {
                "state": verdict.drift.value,
                "change": verdict.change,
                "interval": list(verdict.interval) if verdict.interval else None,
                "beyond": verdict.beyond,
                "wants_tuning": verdict.wants_tuning,
            },
            "friction": {"level": _figure(measured.level), **friction},
            "expected_friction": measured.expected,
            "friction_scale": measured.scale.as_json() if measured.scale else None,
            "tracking_error": asdict(measured.tracking.error),
            "uncompensated": asdict(measured.uncompensated.error),
            "committed": self.committed.as_json() if self.committed else None,
            "temperature": measured.temperature,
            "position_noise": measured.position_noise,
            "torque_noise": measured.torque_noise,
            "missed": measured.missed,
            "samples": measured.samples,
            "motion_unit": self.motion_unit,
            "machine_seconds": self.machine_seconds,
            "run_directory": str(self.run_directory),
            "notes": list(self.notes),
        }


def check_axis(request: CheckRequest) -> CheckResult:
    """Looks at an axis.

    Raises:
        NotEnoughExcitation: the legs could not tell friction.
        AutotuneError, KeyboardInterrupt: after everything was put back; the axis is at rest.
    """
    axis = request.axis
    plan = plan_check(axis, request.seed)
    with own_run(request, _outcome) as run:
        request.reporter.stage("connect", 3.0)
        with connected(run.opening, run.journal, request.reporter) as loop:
            notes = recover(loop, request.runs, run.journal)
            parameters = loop.read_parameters()
            present = _forgiving(axis.link, in_force(request.runs, axis, parameters))
            own = own_feedforward(parameters)
            with prepared(request, loop, run.journal) as session:
                measured = _measure(session, plan, present, own)
        result = _result(request, run.started, session, measured, present, notes)
        write_json(run.directory / FILE_NAME, finite(result.as_json()))
    return result


def _forgiving(link: str, present: InForce) -> InForce:
    """A simulated drive in process without a memory file forgets at every end: that is not a finding."""
    forgets = link.startswith("sim:") and "memory=" not in link
    return replace(present, held=None) if forgets and present.held is False else present


def _outcome(journal: Journal, whole: bool) -> Mapping[str, str]:
    return {"stage": "look", "outcome": "not_applied" if whole else "aborted"}


def _measure(session: Session, plan: CheckPlan, present: InForce, own: Mapping[str, float]) -> CheckFigures:
    session.begin("look", plan.duration)
    legs, _ = session.play("legs", [plan.legs])
    uncompensated, _ = session.play(UNCOMPENSATED, [plan.window(UNCOMPENSATED)])
    with _as_committed(session, own):
        compensated, _ = session.play(COMPENSATED, [plan.window(COMPENSATED)])
    return figures(
        legs,
        _window(compensated, COMPENSATED),
        _window(uncompensated, UNCOMPENSATED),
        plan.motion.frequency,
        present.model,
    )


def _window(recording: Recording, label: str) -> Recording:
    return recording.select(label)


@contextmanager
def _as_committed(session: Session, own: Mapping[str, float]) -> Iterator[None]:
    """The drive's own feedforward as it was found; `prepared` has switched it off and journalled that."""
    if not own:
        yield
        return
    session.loop.write_parameters(own)
    try:
        yield
    finally:
        session.loop.write_parameters(dict.fromkeys(own, 0.0))


def _result(
    request: CheckRequest,
    started: datetime,
    session: Session,
    measured: CheckFigures,
    present: InForce,
    notes: Sequence[str],
) -> CheckResult:
    axis = request.axis
    history = earlier_checks(request.runs, axis.name) if request.history is None else list(request.history)
    known = [one for content in history if (one := before_of(content)) is not None]
    sound = sound_checks(history)
    trend = trend_over(sound)
    coefficient, reference = (
        (trend.temperature_coefficient if trend else None),
        _reference(known, measured, present),
    )
    evidence = Evidence(
        measured,
        present.committed,
        present.held,
        known,
        axis.position_resolution,
        coefficient,
        reference,
    )
    verdict = judge(evidence, request.settings)
    sentence = _cause(measured, sound, started, reference, present)
    return CheckResult(
        axis.name,
        axis.fingerprint,
        started.astimezone(UTC).isoformat(timespec="seconds"),
        round(session.budget.used, 3),
        session.directory,
        axis.motion_unit,
        measured,
        verdict,
        present.committed,
        (*notes, *verdict.notes, *([sentence[0].upper() + sentence[1:]] if sentence else [])),
    )


def _reference(known: Sequence[Before], measured: CheckFigures, present: InForce) -> float:
    """Temperature at which the committed model holds [°C]."""
    run = present.committed.baseline if present.committed else ""
    return next((one.temperature for one in known if one.run == run), measured.temperature)


def _cause(
    measured: CheckFigures, known: Sequence[Before], started: datetime, reference: float, present: InForce
) -> str:
    """What did it to friction as a whole, by this check and those before it; "" where nothing has."""
    if measured.scale is None:
        return ""
    run = present.committed.baseline if present.committed else ""
    at = started.astimezone(UTC).isoformat()
    today = Before(at, run, None, False, measured.level.value, measured.temperature, math.nan)
    return cause_in_words(measured.scale, known, today, reference)


def cause_in_words(scale: FrictionScale, known: Sequence[Before], today: Before, reference: float) -> str:
    """Preload, temperature or wear, by θ and by how the history came to it; "" where nothing has changed.

    Args:
        known: earlier checks, oldest first; today: this one.
        reference: temperature at which the model holds [°C].
    """
    since = next((datetime.fromisoformat(one.at) for one in known if one.run == today.run), None)
    trend = trend_over([*known, today])
    course = course_of(trend.changes, since, scale.theta < 1.0) if trend else UNKNOWN
    coefficient = trend.temperature_coefficient if trend else None
    return scale_in_words(scale, Background(today.temperature - reference, coefficient, course))


def _figure(figure: Figure) -> dict[str, Any]:
    return {
        "value": figure.value,
        "standard_error": figure.standard_error,
        "unit": figure.unit,
        "interval": list(figure.interval),
    }
