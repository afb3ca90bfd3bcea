"""What `autotune model` prints: JSON for programs, lines for people. The same facts in both."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from autotune.diagnose.adding import Added
from autotune.diagnose.compare import Compared
from autotune.diagnose.verdict import Diagnosis
from autotune.models.drive_model import DriveModel
from autotune.models.table import effect_kind
from autotune.view.scale import quantity

BAR = 40


def parameters_json(model: DriveModel) -> dict[str, Any]:
    """name → {value, standard_error, unit}."""
    return {
        name: {"value": value.value, "standard_error": value.standard_error, "unit": model.unit(name)}
        for name, value in model.parameters.items()
    }


def compared_json(result: Compared, model: DriveModel) -> dict[str, Any]:
    """The object of `compare --json`."""
    return {
        "torque_unit": model.torque_symbol,
        "error_rms": result.error_rms,
        "relative_error": result.relative_error,
        "noise_floor_rms": result.noise_floor_rms,
        "explained": result.explained,
        "worst": [
            {"coordinate": w.coordinate, "range": [w.low, w.high], "share": w.share} for w in result.worst
        ],
        "regimes": dict(result.regimes),
        "where": dict(result.where),
        "position_error_rms": result.position_rms,
        "twin": result.twin,
    }


def diagnosis_json(result: Diagnosis, model: DriveModel) -> dict[str, Any]:
    """The object of `diagnose --json`."""
    return {
        "torque_unit": model.torque_symbol,
        "verdict": result.verdict,
        "effects": list(result.effects),
        "confidence": result.confidence,
        "candidates": [
            {
                "effect": c.effect,
                "gain": c.gain,
                "error_before": c.error_before,
                "error_after": c.error_after,
                "accepted": c.accepted,
                "why": c.why,
            }
            for c in result.candidates
        ],
        "confusable": [list(rivals) for rivals in result.confusable],
        "where": dict(result.where),
        "noise_floor_rms": result.noise_floor_rms,
        "next_experiment": result.next_experiment,
        "twin": result.twin,
        "error_test": result.error_test,
        "notes": list(result.notes),
    }


def added_json(result: Added) -> dict[str, Any]:
    """The object of `add --json`."""
    return {
        "torque_unit": result.model.torque_symbol,
        "error_before": result.error_before,
        "error_after": result.error_after,
        "noise_floor_rms": result.noise_floor_rms,
        "parameters": parameters_json(result.model),
        "unseen": result.unseen,
    }


def shown_json(model: DriveModel) -> dict[str, Any]:
    """The object of `show --json`."""
    history = [
        {
            "when": e.when,
            "action": e.action,
            "data": e.data,
            "error_before": e.error_before,
            "error_after": e.error_after,
            "noise_floor": e.noise_floor,
        }
        for e in model.history
    ]
    return {
        "axis": model.axis,
        "motion_unit": model.motion_unit,
        "torque_unit": model.torque_symbol,
        "parameters": parameters_json(model),
        "effects": [effect.name for effect in model.effects],
        "history": history,
    }


def compared_lines(result: Compared, model: DriveModel) -> Iterator[str]:
    unit = model.torque_symbol
    yield f"error {quantity(result.error_rms, unit)} rms, {100 * result.relative_error:.2f} % of the torque"
    if math.isfinite(result.noise_floor_rms):
        yield f"noise floor {quantity(result.noise_floor_rms, unit)} rms: no model gets below"
    else:
        yield "noise floor unknown: nothing was recorded twice"
    yield f"explained {100 * result.explained:.2f} % of what can be explained"
    for name, value in result.regimes.items():
        if math.isfinite(value):
            yield f"  {name.replace('_', ' '):<14}{quantity(value, unit)}"
    for worst in result.worst[:3]:
        yield (
            f"worst where {worst.coordinate.replace('_', ' ')} is {worst.low:.4g} to {worst.high:.4g}: "
            f"{100 * worst.share:.0f} % of the squared error"
        )


def diagnosis_lines(result: Diagnosis, model: DriveModel) -> Iterator[str]:
    unit = model.torque_symbol
    names = ", ".join(result.effects)
    yield {
        "named": f"missing: {names} ({result.confidence})",
        "none": "nothing is missing that these data could show",
        "unknown": "something is missing that is none of the known effects",
        "ambiguous": f"missing: {names}, or what looks like it",
    }[result.verdict]
    for effect in result.effects:
        kind = effect_kind(effect)
        yield f"  looks like: {kind.looks_like}"
        yield f"  caused by:  {kind.cause}"
        yield f"  what to do: {kind.remedy}"
    for rivals in result.confusable:
        yield f"cannot be told apart for certain: {', '.join(rivals)}"
    yield "candidates, by how far the squared error falls on unseen experiments:"
    for c in sorted(result.candidates, key=lambda item: -item.gain)[:6]:
        mark = "*" if c.accepted else " "
        yield f" {mark} {c.effect:<28}{100 * c.gain:6.1f} %  {c.why}"
    if math.isfinite(result.noise_floor_rms):
        yield f"noise floor {quantity(result.noise_floor_rms, unit)} rms"
    where = sorted(result.where.items(), key=lambda item: -item[1])[:3]
    yield "where it sits: " + ", ".join(f"{n.replace('_', ' ')} {100 * s:.0f} %" for n, s in where)
    if result.next_experiment:
        yield f"next: {result.next_experiment}"
    yield from result.notes


def added_lines(effect: str, result: Added, out: Path | None) -> Iterator[str]:
    unit = result.model.torque_symbol
    fall = 1.0 - result.error_after / result.error_before if result.error_before else 0.0
    yield (
        f"error on {result.unseen}: {quantity(result.error_before, unit)} before, "
        f"{quantity(result.error_after, unit)} after ({-100 * fall:+.0f} %)"
    )
    if math.isfinite(result.noise_floor_rms):
        yield f"noise floor {quantity(result.noise_floor_rms, unit)}"
    kind = effect_kind(effect)
    for name, value in result.model.parameters.items():
        if any(name == kind.surface(p.name) for p in kind.parameters):
            yield "  " + _parameter(result.model, name, value.value, value.standard_error)
    if out is not None:
        yield f"written to {out}"


def parameter_lines(model: DriveModel) -> Iterator[str]:
    for name, value in model.parameters.items():
        yield _parameter(model, name, value.value, value.standard_error)


def model_lines(model: DriveModel) -> Iterator[str]:
    """Parameters, and the story of the model as a falling staircase."""
    yield f"model of {model.axis or 'an axis'}, motion in {model.motion_unit}"
    yield from (f"  {line}" for line in parameter_lines(model))
    steps = [entry for entry in model.history if entry.error_after is not None]
    if not steps:
        yield "no history"
        return
    unit = model.torque_symbol
    yield "error on data that the fit never saw, step by step:"
    largest = max(max(e.error_after or 0.0, e.error_before or 0.0) for e in steps)
    for entry in steps:
        yield _stair(entry.action, entry.error_before, entry.error_after or 0.0, largest, unit)
    floor = steps[-1].noise_floor
    if floor is not None:
        length = min(round(BAR * floor / largest), BAR)
        yield f"  {'noise floor':<30}{'.' * length:<{BAR}} {quantity(floor, unit)}"


def _stair(action: str, before: float | None, after: float, largest: float, unit: str) -> str:
    bar = "█" * max(1, round(BAR * after / largest)) if largest else ""
    change = f" ({100 * (after / before - 1.0):+.0f} %)" if before else ""
    return f"  {action:<30}{bar:<{BAR}} {quantity(after, unit)}{change}"


def _parameter(model: DriveModel, name: str, value: float, error: float | None) -> str:
    spread = f" ± {error:.2g}" if error is not None else ""
    return f"{name:<36}{value:.5g}{spread} {model.unit(name)}"
