"""The run's results as the plain data of run.json."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from autotune.control.feedforward import LugreParameters
from autotune.identify.run import Identification
from autotune.models.drive_model import surface_parameter
from autotune.service.proof import Proof
from autotune.service.stage_adapt import Adapted


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


def improvement(proof: Proof, confidence: float) -> dict[str, Any]:
    """Mean fall of the peak error over the pairs, with its interval [motion unit]."""
    return {
        "mean": proof.improvement,
        "interval": list(proof.interval),
        "confidence": confidence,
        "pairs": proof.pairs.tolist(),
        "better": proof.better,
    }


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


def _adapted_values(parameters: LugreParameters) -> dict[str, float]:
    return {name: getattr(parameters, name) for name in ("stiffness", "coulomb", "offset")}
