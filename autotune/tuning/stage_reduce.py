"""What of the proved feedforward goes into the drive: all of it, or what the drive can hold.

A reduction is predicted before the commit and compared with what is measured afterwards.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from autotune.control.feedforward import FeedforwardLaw, FixedFeedforward, LugreParameters
from autotune.control.model_feedforward import ModelFeedforward, beyond_lugre, periodic_model_feedforward
from autotune.control.reduction import (
    LUGRE,
    DrivePart,
    Reduction,
    Remainder,
    level_for_block,
    reduce,
    reduces,
    rises,
    with_one_level,
)
from autotune.control.refinement import PeriodAverage, periodic_feedforward
from autotune.control.velocity_table import TableBlock, is_point
from autotune.core.errors import ConfigurationError
from autotune.core.friction_table import in_words
from autotune.core.ripple_parameters import GAIN, is_ripple, moved
from autotune.models.torque_ripple import TORQUE_RIPPLE
from autotune.recordings.recording import Controller
from autotune.tuning.findings import Findings, PlannedValues
from autotune.tuning.proof import TrackingError
from autotune.tuning.session import Session
from autotune.tuning.stage_adapt import period_average
from autotune.tuning.stage_prove import ENABLED, GIVEN_BACK
from autotune.tuning.stage_ripple import RipplePlan

RIPPLE = TORQUE_RIPPLE.name
PREFIX = "feedforward."


@dataclass(frozen=True)
class Plan:
    """What will be committed.

    Attributes:
        values: complete set of the drive's feedforward parameters that are written, SI; empty where the
            drive holds none.
        reduction: None where the drive holds all.
        host: law that the host has to play beside the drive; None for none.
        ripple: what the drive takes of torque ripple, among `values`; None for nothing.
        why: where `values` are empty, why the drive holds nothing.
        again: among `values`, what acted before the run and only acts again.
    """

    values: Mapping[str, float]
    reduction: Reduction | None = None
    host: Remainder | None = None
    ripple: RipplePlan | None = None
    why: str = "this drive cannot hold a feedforward"
    again: frozenset[str] = frozenset()

    @property
    def only_ripple(self) -> bool:
        """Nothing of friction is written."""
        return self.ripple is not None and all(is_ripple(name) or name in self.again for name in self.values)


def plan_commit(
    session: Session, findings: Findings, held: Mapping[str, float], ripple: RipplePlan | None = None
) -> Plan:
    """Decides from what the drive holds now (`held`), what was proved, and what it takes of ripple.

    Raises:
        ConfigurationError: a reduction is needed and nothing says how the controller acts.
    """
    plan = _plan_friction(session, findings, {n: v for n, v in held.items() if not is_ripple(n)}, ripple)
    if ripple is None:
        return plan
    reduction = plan.reduction
    if reduction is not None:
        lost = tuple(name for name in reduction.lost if name != RIPPLE)
        reduction = replace(reduction, lost=lost)
    return replace(plan, values={**plan.values, **ripple.values}, reduction=reduction, ripple=ripple)


def same_commutation(session: Session, planned: PlannedValues | None) -> None:
    """Raises ConfigurationError: ripple that was planned would act at the wrong places."""
    if planned is None or not planned.alignment or not planned.values.get(GAIN):
        return
    changed = moved(planned.alignment, session.loop.read_parameters(list(planned.alignment)))
    if changed:
        raise ConfigurationError(
            f"the torque over position that was planned was aligned with another commutation ({'; '.join(changed)}); "
            "nothing was written. Run 'autotune run' anew, which aligns it"
        )


def with_what_acted(plan: Plan, before: Mapping[str, float]) -> Plan:
    """The same, with what acted in the drive before the run acting as it did, where nothing is planned in its place.

    Args:
        before: what the run has switched off for its own duration, with the values that it had.
    """
    if not plan.values:
        return plan
    again = {
        name: value
        for name, value in before.items()
        if name.startswith(PREFIX) and name not in plan.values and (name == GAIN or plan.only_ripple)
    }
    return replace(plan, values={**plan.values, **again}, again=frozenset(again))


def _plan_friction(
    session: Session, findings: Findings, held: Mapping[str, float], ripple: RipplePlan | None
) -> Plan:
    if findings.planned is not None:
        law = findings.law(session.axis.cycle)
        planned = findings.planned.values
        values = {name: value for name, value in planned.items() if name in held}
        part = {name.removeprefix(PREFIX): value for name, value in values.items() if name != ENABLED}
        host = Remainder(law, part, session.axis.cycle) if findings.planned.host else None
        return Plan(values, findings.planned.reduction, host)
    full = findings.need_proposed()
    names = {name.removeprefix(PREFIX) for name in held}
    if not reduces(names):
        block, reduction = _for_block(full, findings, session)
        wanted = block.drive_parameters() | {ENABLED: 1.0}
        values = {name: value for name, value in wanted.items() if name in held}
        return Plan(values, lugre_part(findings, block) or reduction)
    if not names - {"enabled", "reference_filter"}:
        return Plan({})
    table = _table(session, names)
    if why := _nothing_fits(session, full, names, table):
        return Plan({}, why=why)
    reduction = _of_the_whole(_reduced(session, full, names, _measured(findings, session), table), findings)
    values = {PREFIX + name: value for name, value in reduction.values.items()}
    if ENABLED in held:
        values[ENABLED] = 1.0
    law = host_law(findings, session.axis.cycle, ripple)
    host = Remainder(law, reduction.values, session.axis.cycle) if reduction.host else None
    return Plan(values, reduction, host)


def _table(session: Session, names: Collection[str]) -> TableBlock | None:
    """The drive's table over velocity."""
    return TableBlock.of(session.loop.read_parameters()) if any(map(is_point, names)) else None


def _nothing_fits(
    session: Session, full: LugreParameters, names: Collection[str], table: TableBlock | None
) -> str:
    """Why a drive with a table and nothing else takes none of it; "" where it takes something."""
    return table.refuses(full, session.limits.speed) if table is not None and not LUGRE & {*names} else ""


def _reduced(
    session: Session,
    full: LugreParameters,
    names: Collection[str],
    measured: PeriodAverage,
    table: TableBlock | None,
) -> Reduction:
    limits = session.limits
    return reduce(full, names, measured, _controller(session), limits.torque, table, limits.speed)


def host_law(findings: Findings, period: float, ripple: RipplePlan | None) -> FeedforwardLaw:
    """What was proved, without the ripple that the drive plays."""
    model = findings.proposed_model
    if model is None or ripple is None:
        return findings.law(period)
    return ModelFeedforward(model.without_effect(RIPPLE), period)


def plan_retune(session: Session, findings: Findings, held: Mapping[str, float]) -> FeedforwardLaw | None:
    """Law of what this drive will hold by itself; decides on it for the commit. None where that does not suffice.

    Nobody plays the rest at night, so it is this that has to be better than what the drive holds now.
    """
    full, period = findings.need_proposed(), session.axis.cycle
    names = {name.removeprefix(PREFIX) for name in held if not is_ripple(name)}
    if not reduces(names):
        block = with_one_level(full) if rises(full) else full
        findings.planned = PlannedValues({PREFIX + n: v for n, v in _named(block).items()} | {ENABLED: 1.0})
        return FixedFeedforward(block, period)
    if findings.adapted is None or not names - {"enabled", "reference_filter"}:
        return None
    measured, table = findings.adapted.best.measured, _table(session, names)
    if _nothing_fits(session, full, names, table):
        return None
    reduction = _reduced(session, full, names, measured, table)
    if reduction.host:
        return None
    enabled = {ENABLED: 1.0} if ENABLED in held else {}
    findings.planned = PlannedValues({PREFIX + n: v for n, v in reduction.values.items()} | enabled)
    return DrivePart(reduction.values, period)


def _for_block(
    full: LugreParameters, findings: Findings, session: Session
) -> tuple[LugreParameters, Reduction | None]:
    """What the drive's own LuGre block plays of it, and what that loses; None where it plays all.

    Without gains of the controller nothing predicts a better level than the block's own.
    """
    if not rises(full):
        return full, None
    if session.controller is None or findings.proved is None:
        return with_one_level(full), None
    found = level_for_block(full, _measured(findings, session), session.controller, session.limits.torque)
    return with_one_level(full, found.values["coulomb"]), found


def _named(full: LugreParameters) -> dict[str, float]:
    return {name.removeprefix(PREFIX): value for name, value in full.drive_parameters().items()}


def lugre_part(findings: Findings, block: LugreParameters) -> Reduction | None:
    """What a drive that plays `block` loses of a model with more effects; None for a model without.

    Nothing has to be simulated: the refined LuGre feedforward was measured on its way here.
    """
    model, proved, adapted = findings.proposed_model, findings.proved, findings.adapted
    if model is None or proved is None or adapted is None:
        return None
    best = adapted.best
    whole = periodic_model_feedforward(model, best.measured.reference, best.measured.period)
    part = periodic_feedforward(block, best.measured.reference, best.measured.period)
    held = _named(block)
    return _of_the_whole(
        Reduction(
            held,
            (),
            0.0,
            0.0,
            best.peak_error,
            float(np.sqrt(np.mean(best.measured.error**2))),
            float(np.sqrt(np.mean((whole - part) ** 2))),
        ),
        findings,
    )


def _of_the_whole(reduction: Reduction, findings: Findings) -> Reduction:
    """The same, measured against the feedforward that was proved, where that is a model with more effects."""
    model, proved = findings.proposed_model, findings.proved
    if model is None or proved is None:
        return reduction
    lost = beyond_lugre(model)
    after = proved.proof.after
    if reduction.host:  # the host then plays all that the drive does not
        return replace(
            reduction,
            full_peak=after.peak_error,
            full_rms=after.rms_error,
            predicted_peak=after.peak_error,
            predicted_rms=after.rms_error,
        )
    return replace(reduction, full_peak=after.peak_error, full_rms=after.rms_error, lost=lost)


def _measured(findings: Findings, session: Session) -> PeriodAverage:
    if findings.proved is None:
        raise ConfigurationError(
            "this drive cannot hold the whole feedforward, and what it loses is predicted from the windows of "
            "the proof; run 'autotune run' with all stages"
        )
    if findings.proposed_model is not None and findings.adapted is not None:
        return findings.adapted.best.measured
    frequency = session.axis.benchmark.frequency
    parts = [period_average(window, frequency) for window in findings.proved.after]
    return PeriodAverage(
        parts[0].reference,
        np.mean([part.error for part in parts], axis=0),
        np.mean([part.feedback for part in parts], axis=0),
        np.mean([part.feedforward for part in parts], axis=0),
        parts[0].period,
        sum(part.count for part in parts),
    )


def _controller(session: Session) -> Controller:
    if session.controller is None:
        raise ConfigurationError(
            "this drive cannot hold the whole feedforward, and its profile does not say where its controller's "
            "gains are (controller.kp, kd, ki); add them to predict what is lost"
        )
    return session.controller


def announcement(reduction: Reduction, unit: str) -> str:
    """What a person is told before the commit."""
    parts = ", ".join(in_words(reduction.values)) + (f" ({reduction.note})" if reduction.note else "")
    if not reduces(reduction.values) and not reduction.lost:
        return "this drive holds the LuGre part of the feedforward"
    if not reduces(reduction.values):
        return (
            f"this drive holds the LuGre part of the feedforward; {', '.join(reduction.lost)} would have to come "
            f"from the host by the torque offset: without it the peak error is predicted to be "
            f"{1e3 * reduction.predicted_peak:.2f} m{unit} instead of {1e3 * reduction.full_peak:.2f} m{unit}"
        )
    if reduction.host:
        return (
            f"this drive holds {parts} only; {', '.join(reduction.host)} (with presliding) must come from the "
            "host by the torque offset, else it is lost"
        )
    return (
        f"this drive holds {parts} only: the peak error is predicted to be "
        f"{1e3 * reduction.predicted_peak:.2f} m{unit} instead of {1e3 * reduction.full_peak:.2f} m{unit}"
    )


def is_worth_it(reduction: Reduction, before: TrackingError, least: float) -> bool:
    """True where the reduced feedforward is predicted to be better than none by what was asked for."""
    return reduction.predicted_peak <= (1.0 - least) * before.peak_error


def holds_reduced(before: TrackingError, committed: TrackingError, least: float) -> bool:
    """The drive with its reduced feedforward is better than before by what was asked for."""
    return (
        committed.peak_error <= (1.0 - least) * before.peak_error and committed.rms_error <= before.rms_error
    )


def holds_predicted(before: TrackingError, committed: TrackingError, reduction: Reduction) -> bool:
    """The drive by itself gives at least half of the gain that was measured for what it holds."""
    gain = before.peak_error - reduction.predicted_peak
    return committed.peak_error <= before.peak_error - GIVEN_BACK * gain


def comparison(reduction: Reduction, committed: TrackingError | None) -> dict[str, Any]:
    """For run.json: predicted beside measured. `agreement` is measured over predicted loss."""
    content: dict[str, Any] = {
        "drive": dict(reduction.values),
        "host": list(reduction.host),
        "lost": list(reduction.lost),
        "full_peak_error": reduction.full_peak,
        "predicted_peak_error": reduction.predicted_peak,
        "predicted_rms_error": reduction.predicted_rms,
        "predicted_loss": reduction.predicted_loss,
        "measured_peak_error": None,
        "measured_rms_error": None,
        "measured_loss": None,
        "agreement": None,
        "residual_rms": reduction.residual_rms,
    }
    if committed is not None:
        loss = committed.peak_error - reduction.full_peak
        content["measured_peak_error"] = committed.peak_error
        content["measured_rms_error"] = committed.rms_error
        content["measured_loss"] = loss
        if reduction.predicted_loss:
            content["agreement"] = loss / reduction.predicted_loss
    return content
