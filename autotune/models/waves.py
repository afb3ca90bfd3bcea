"""The torque ripple of a model as people read it: order, amplitude and phase of every wave.

s·sin(N·q) + c·cos(N·q) = A·sin(N·q + φ) with A = √(s² + c²), φ = atan2(c, s). The standard error of A is
that of (s·δs + c·δc)/A, with the errors of s and c taken as independent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from autotune.models.drive_model import DriveModel
from autotune.models.torque_ripple import TORQUE_RIPPLE


@dataclass(frozen=True, slots=True)
class Wave:
    """One wave: `number` in the model, order [cycles/rev or cycles/m], amplitude [N m or N], phase [rad]."""

    number: int
    order: float
    amplitude: float
    phase: float
    standard_error: float | None = None


def ripple_waves(model: DriveModel) -> Iterator[Wave]:
    """All waves of a model's torque ripple, as they stand in it."""
    for effect in model.effects:
        if effect.kind is not TORQUE_RIPPLE:
            continue
        for name, order in effect.values.items():
            number = name.removeprefix("order_")
            if number != name:
                sine, cosine = effect.values[f"sin_{number}"], effect.values[f"cos_{number}"]
                size = math.hypot(sine.value, cosine.value)
                error = None
                if sine.standard_error is not None and cosine.standard_error is not None and size > 0.0:
                    error = (
                        math.hypot(sine.value * sine.standard_error, cosine.value * cosine.standard_error)
                        / size
                    )
                phase = math.atan2(cosine.value, sine.value)
                yield Wave(int(number), order.value, size, phase, error)
