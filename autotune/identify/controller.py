"""Which controller made this torque: from the metadata, or by least squares from the data.

u = kp·e + kd·d + ki·Σe·h with d ← d + derivative_filter·((b·Δr − Δy)/h − d). Everything but the filter
enters linearly; the filter is searched. A drive with cascaded loops shows as b ≠ 1. Only a law that
explains more than 99.9 % of the torque may drive a twin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from autotune.core.recording import Recording
from autotune.identify.checks import clipped, torque_of

Floats = NDArray[np.float64]
EXPLAINED = 0.999
_FILTERS = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0)


@dataclass(frozen=True, slots=True)
class ControlLaw:
    """A position controller.

    Attributes:
        reference_rate: b, the part of the reference's rate in the derivative.
        explained: R² of the torque, 1 where the law was given.
    """

    kp: float
    kd: float
    ki: float
    derivative_filter: float = 1.0
    reference_rate: float = 1.0
    explained: float = 1.0
    constant: float = 0.0

    @property
    def usable(self) -> bool:
        return self.explained > EXPLAINED and self.kp > 0

    @property
    def gains(self) -> Floats:
        """As the compiled twin takes them."""
        return np.array([self.kp, self.kd, self.ki, self.derivative_filter, self.reference_rate])


def is_closed(recording: Recording) -> bool:
    """Whether the axis followed a reference of its own (in torque mode the measured position is logged)."""
    if "reference" not in recording:
        return False
    return bool(np.mean(recording["reference"] != recording["position"]) > 0.05)


def control_law(recording: Recording) -> ControlLaw | None:
    """The law of the metadata, else the one identified; None where there is nothing to identify it from."""
    known = recording.metadata.controller
    if known is not None:
        return ControlLaw(known.kp, known.kd, known.ki, known.derivative_filter)
    parts = [part for _, part in recording.split() if len(part) >= 100 and is_closed(part)]
    return identify_controller(parts) if parts else None


def identify_controller(parts: list[Recording]) -> ControlLaw:
    """Least squares over contiguous parts; the start of each integral is free."""
    found = minimize_scalar(
        lambda x: _fit(parts, float(x))[1],
        bounds=_bracket(parts),
        method="bounded",
        options={"xatol": 1e-4},
    )
    best = float(found.x)
    at_one = _fit(parts, 1.0)
    law, cost = _fit(parts, best)
    if at_one[1] <= cost * 1.0001:
        return at_one[0]
    return law


def _bracket(parts: list[Recording]) -> tuple[float, float]:
    costs = [_fit(parts, value)[1] for value in _FILTERS]
    best = int(np.argmin(costs))
    return _FILTERS[max(best - 1, 0)], _FILTERS[min(best + 1, len(_FILTERS) - 1)]


def _fit(parts: list[Recording], smoothing: float) -> tuple[ControlLaw, float]:
    """Law and unexplained mean square for one derivative filter."""
    designs, targets = [], []
    for number, part in enumerate(parts):
        design, target = _columns(part, smoothing)
        loose = np.zeros((len(target), len(parts)))
        loose[:, number] = 1.0
        designs.append(np.hstack([design, loose]))
        targets.append(target)
    design, target = np.vstack(designs), np.concatenate(targets)
    scale = np.maximum(np.abs(design).max(axis=0), 1e-300)
    solution = np.linalg.lstsq(design / scale, target, rcond=1e-12)[0] / scale
    rest = target - design @ solution
    power = float(np.var(target)) or 1.0
    kp, minus_kd, ki, kd_reference = (float(x) for x in solution[:4])
    kd = -minus_kd
    weight = kd_reference / kd if kd != 0.0 else 0.0
    constant = float(np.mean(solution[4:])) if abs(ki) < 1e-9 * abs(kp) else 0.0
    explained = 1.0 - float(np.mean(rest**2)) / power
    return ControlLaw(kp, kd, ki, smoothing, weight, explained, constant), float(np.mean(rest**2))


def _columns(part: Recording, smoothing: float) -> tuple[Floats, Floats]:
    """e, filtered rate of y, Σe·h, filtered rate of r; and the torque that feedback made."""
    reference, position, period = part["reference"], part["position"], part.period
    error = reference - position
    rates = [
        lfilter([smoothing], [1.0, smoothing - 1.0], np.diff(signal, prepend=signal[:1])) / period
        for signal in (position, reference)
    ]
    design = np.stack([error, rates[0], np.cumsum(error) * period, rates[1]], axis=1)
    target = torque_of(part)
    if "torque_feedforward" in part:
        target = target - part["torque_feedforward"]
    settle = min(len(error) // 4, round(10.0 / smoothing))
    keep = ~clipped(part).rows
    keep[:settle] = False
    return design[keep], target[keep]
