"""The position controller: from the metadata if it explains the torque, else identified from the data.

u = kp·e + kd·d + ki·Σe·h with d ← d + α·((Δr − Δy)/h − d). For a fixed α this is linear in the gains, so
that least squares with a scan over α finds them. What depends on the reference alone (velocity or
acceleration feedforward, a derivative on the measurement only) goes into the feedforward of the twin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from autotune.core.recording import Controller
from autotune.diagnose.prepared import Prepared
from autotune.models.lugre import Flags, Floats

USABLE = 0.999
_FILTERS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


@dataclass(frozen=True, slots=True)
class Found:
    """A controller and how much of the torque demand it explains.

    Attributes:
        controller: None where none explains the demand.
        feedforward: what the reference alone causes, shape (n,).
        r_squared: share of the demand's variance explained, 0…1.
        source: `metadata`, `identified` or `none`; `why` in words where there is none.
    """

    controller: Controller | None
    feedforward: Floats
    r_squared: float
    source: str
    why: str = ""


def find_controller(data: Prepared) -> Found:
    """The controller that made the recorded torque demand out of reference and position."""
    nothing = data.feedforward
    if not data.recorded_reference:
        return Found(None, nothing, 0.0, "none", "the recording has no column 'reference'")
    if not all(stretch.closed for stretch in data.stretches):
        return Found(None, nothing, 0.0, "none", "parts were recorded without position control")
    rows = _regular(data)
    if data.metadata.controller is not None:
        share = _explained(data, data.metadata.controller, rows)
        if share > USABLE:
            return Found(data.metadata.controller, nothing, share, "metadata")
    return _identified(data, rows)


def _regular(data: Prepared) -> Flags:
    """Samples that are not clamped, nor just after a stretch began."""
    limit = data.metadata.torque_limit or 1.0001 * float(np.max(np.abs(data.torque)))
    clamped = np.abs(data.torque) >= 0.999 * limit
    rows = ~clamped
    for stretch in data.stretches:
        rows[stretch.start : stretch.start + 20] = False
    return np.asarray(rows)


def _terms(data: Prepared, smoothing: float) -> dict[str, Floats]:
    """Regressors by sample: e, its filtered rate, its held sum, and a constant per stretch."""
    h = data.period
    error = data.reference - data.measured
    limit = data.metadata.torque_limit or np.inf
    free = np.abs(data.torque) < 0.999 * limit
    rate, total, rate_r = (np.zeros(len(error)) for _ in range(3))
    table: dict[str, Floats] = {}
    for number, stretch in enumerate(data.stretches):
        rows = stretch.rows
        change = np.diff(error[rows], prepend=error[stretch.start]) / h
        rate[rows] = signal.lfilter([smoothing], [1.0, smoothing - 1.0], change)
        change = np.diff(data.reference[rows], prepend=data.reference[stretch.start]) / h
        rate_r[rows] = change
        total[rows] = np.cumsum(error[rows] * free[rows]) * h
        one = np.zeros(len(error))
        one[rows] = 1.0
        table[f"start_{number}"] = one
    return {"kp": error, "kd": rate, "ki": total, "rate": rate_r, **table}


def _explained(data: Prepared, controller: Controller, rows: Flags) -> float:
    terms = _terms(data, controller.derivative_filter)
    known = sum(getattr(controller, name) * terms[name] for name in ("kp", "kd", "ki"))
    rest = data.torque - data.feedforward - known
    for stretch in data.stretches:
        inside = np.zeros(len(rest), dtype=np.bool_)
        inside[stretch.rows] = True
        rest[stretch.rows] -= np.median(rest[inside & rows]) if np.any(inside & rows) else 0.0
    return 1.0 - float(np.var(rest[rows]) / max(np.var(data.torque[rows]), 1e-300))


def _regress(data: Prepared, smoothing: float, rows: Flags, extra: bool) -> tuple[float, dict[str, float]]:
    terms = _terms(data, smoothing)
    if not extra:
        del terms["rate"]
    table = np.column_stack(list(terms.values()))[rows]
    target = (data.torque - data.feedforward)[rows]
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    solution = np.linalg.lstsq(table / size, target, rcond=1e-12)[0] / size
    rest = target - table @ solution
    share = 1.0 - float(np.var(rest) / max(np.var(target), 1e-300))
    return share, dict(zip(terms, solution.tolist(), strict=True))


def _identified(data: Prepared, rows: Flags) -> Found:
    if len(data.stretches) > 40:
        return Found(None, data.feedforward, 0.0, "none", "the recording is in too many pieces")
    every = rows.copy()
    thin = max(1, int(rows.sum()) // 40_000)
    chosen = np.flatnonzero(rows)[::thin]
    every[:] = False
    every[chosen] = True
    scan = [(*_regress(data, a, every, True), a) for a in _FILTERS]
    best = max(scan, key=lambda item: item[0])
    fine = np.clip(best[2] + np.linspace(-0.05, 0.05, 11), 0.01, 1.0)
    best = max([(*_regress(data, float(a), every, True), float(a)) for a in fine], key=lambda item: item[0])
    share, gains, smoothing = best
    if share <= USABLE:
        return Found(
            None,
            data.feedforward,
            share,
            "none",
            f"reference and position explain {100 * share:.1f} % of the torque demand as a PID controller "
            f"would; more than {100 * USABLE:.1f} % are needed",
        )
    rate = _terms(data, smoothing)["rate"]
    controller = Controller(gains["kp"], gains["kd"], max(gains["ki"], 0.0), smoothing)
    return Found(controller, data.feedforward + gains["rate"] * rate, share, "identified")


def with_feedforward(data: Prepared, found: Found) -> Prepared:
    """The data with the feedforward that belongs to the controller."""
    return replace(data, feedforward=found.feedforward)
