"""The run's results as the plain data of run.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from autotune.control.feedforward import LugreParameters
from autotune.core.friction_table import in_words
from autotune.core.ripple_parameters import is_ripple
from autotune.identify.run import Identification
from autotune.models.drive_model import DriveModel, surface_parameter
from autotune.models.torque_ripple import TORQUE_RIPPLE
from autotune.models.total_friction import total_friction
from autotune.tuning.findings import HOST_FILE, Findings
from autotune.tuning.given_model import as_json
from autotune.tuning.proof import HeldOutError, Proof
from autotune.tuning.stage_adapt import Adapted
from autotune.tuning.stage_model import ModelAdapted
from autotune.tuning.stage_prove import Proved


def parameters(found: Identification, motion_unit: str) -> dict[str, dict[str, Any]]:
    """{name → {value, standard_error, unit}} of the combined estimate."""
    return {
        name: {
            "value": quantity.value,
            "standard_error": quantity.standard_error,
            "unit": surface_parameter(name).unit_for(motion_unit),
            "interval": list(quantity.interval),
            "identified": quantity.identified,
        }
        for name, quantity in found.joint.parameters.items()
    }


def in_drive(findings: Findings, kept: bool, acting: Sequence[str] = ()) -> dict[str, Any]:
    """What acts without a host, first of all that a run says; `acting`: what did before the run, and does again."""
    before = findings.yardstick.before.peak_error if findings.yardstick else None
    if not kept:
        return {"keeps": [*acting], "peak_error_before": before, "peak_error": before, "ripple_removed": None}
    alone = findings.committed.peak_error if findings.committed else None
    names = {name.removeprefix("feedforward.") for name in findings.held if not is_ripple(name)}
    friction = in_words(names) or [name for name in acting if name != TORQUE_RIPPLE.name]
    ripple = findings.ripple is not None or TORQUE_RIPPLE.name in acting
    keeps = friction + ([TORQUE_RIPPLE.name] if ripple else [])
    return {
        "keeps": keeps,
        "peak_error_before": before,
        "peak_error": alone,
        "ripple_removed": findings.ripple_removed,
        "alignment": dict(findings.ripple.settings) if findings.ripple else {},
        "ripple_left_out": [one.order for one in findings.ripple.kept.left_out] if findings.ripple else [],
    }


def host_adds(findings: Findings) -> dict[str, Any]:
    """What a host reaches beyond it while it plays; empty where nothing was proved."""
    if findings.yardstick is None or not findings.better:
        return {}
    with_host, reduction = findings.with_host, findings.reduction
    reached = (with_host or findings.yardstick.after).peak_error
    plays = [*reduction.host, *reduction.lost] if reduction else []
    if findings.held and all(map(is_ripple, findings.held)):
        plays = ["friction", "inertia"]
    model = findings.proposed_model is not None
    return {"peak_error": reached, "plays": plays, "file": HOST_FILE if model else None}


def improvement(proof: Proof, confidence: float) -> dict[str, Any]:
    """Mean fall of the peak error over the pairs, with its interval [motion unit]."""
    return {
        "mean": proof.improvement,
        "interval": list(proof.interval),
        "confidence": confidence,
        "pairs": proof.pairs.tolist(),
        "better": proof.better,
    }


def held_out(proved: Proved | None, committed: HeldOutError | None) -> dict[str, Any]:
    """Each window of the held-out motion [motion unit]; `harmful` says why the feedforward was refused for it."""
    found: dict[str, Any] = {"committed": committed.as_json()} if committed is not None else {}
    if proved is not None:
        found |= {
            "before": proved.held_out_before.as_json(),
            "after": proved.held_out_after.as_json(),
            "harmful": proved.harmful,
        }
    return found


def adaptation(adapted: Adapted) -> dict[str, Any]:
    """What the thesis's laws alone came to, and what refinement made of it."""
    laws = adapted.laws
    return {
        "thesis": {
            **_adapted_values(laws.parameters),
            "settled": laws.settled,
            "frozen": laws.frozen,
            "valid": laws.valid,
            "reason": laws.reason,
            "seconds": float(laws.time[-1]) if len(laws.time) else 0.0,
            "peak_error": adapted.steps[0].peak_error if adapted.steps else None,
        },
        "refined": {**_adapted_values(adapted.best.parameters), "peak_error": adapted.best.peak_error},
        "steps": [
            {"peak_error": step.peak_error, "parameters": asdict(step.parameters)} for step in adapted.steps
        ],
    }


def diagnosis(findings: Findings) -> dict[str, Any]:
    """The verdict, what became of the model, and what its feedforward gave on the benchmark; {} without a diagnosis."""
    found = findings.diagnosed
    if found is None:
        return {}
    model, modelled = found.model, findings.modelled if findings.given is None else None
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "confidence": found.confidence,
        "error_rms": found.error_rms,
        "relative_error": found.relative_error,
        "error_before": found.error_before,
        "error_after": found.error_after,
        "noise_floor_rms": found.noise_floor_rms,
        "disturbance": found.disturbance,
        "torque_late": found.torque_late,
        "unseen": found.unseen,
        "twin": found.twin,
        "candidates": [dict(candidate) for candidate in found.candidates],
        "next_experiment": found.next_experiment,
        "stiffness": found.stiffness,
        "not_fed_forward": dict(found.not_fed_forward),
        "parameters": {
            name: {"value": v.value, "standard_error": v.standard_error, "unit": model.unit(name)}
            for name, v in model.parameters.items()
        }
        if model is not None
        else {},
        "total_friction": _total_friction(model) if model is not None else None,
        "feedforward": _modelled(modelled) if modelled is not None else None,
    }


def given(findings: Findings) -> dict[str, Any]:
    """The model that the run was given; {} without one."""
    if findings.given is None:
        return {}
    modelled = findings.modelled
    return as_json(findings.given, modelled, _modelled(modelled) if modelled is not None else None)


def _total_friction(model: DriveModel) -> dict[str, Any]:
    total = total_friction(model)
    return {"value": total.value, "standard_error": total.standard_error, "unit": model.unit("coulomb")}


def _modelled(modelled: ModelAdapted) -> dict[str, Any]:
    return {
        "chosen": modelled.chosen,
        "reason": modelled.reason,
        "steps": [
            {"peak_error": step.measured.peak_error, "smooth_peak": step.measured.smooth_peak}
            for step in modelled.steps
        ],
    }


def _adapted_values(parameters: LugreParameters) -> dict[str, float]:
    return {name: getattr(parameters, name) for name in ("stiffness", "coulomb", "offset")}
