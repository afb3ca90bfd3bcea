"""A model's numbers as they are written to JSON."""

from __future__ import annotations

from typing import Any

from autotune.models.drive_model import DriveModel
from autotune.models.waves import ripple_waves


def parameters_json(model: DriveModel) -> dict[str, Any]:
    """name → {value, standard_error, unit}."""
    return {
        name: {"value": value.value, "standard_error": value.standard_error, "unit": model.unit(name)}
        for name, value in model.parameters.items()
    }


def waves_json(model: DriveModel) -> list[dict[str, Any]]:
    """The torque ripple as waves: order, amplitude and phase of amplitude·sin(order·q + phase)."""
    return [
        {
            "order": wave.order,
            "amplitude": wave.amplitude,
            "standard_error": wave.standard_error,
            "phase": wave.phase,
        }
        for wave in ripple_waves(model)
    ]


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
            "unseen": e.unseen,
        }
        for e in model.history
    ]
    return {
        "axis": model.axis,
        "motion_unit": model.motion_unit,
        "torque_unit": model.torque_symbol,
        "parameters": parameters_json(model),
        "effects": [effect.name for effect in model.effects],
        "waves": waves_json(model),
        "history": history,
    }
