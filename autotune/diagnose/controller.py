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
from autotune.diagnose.prepared import Prepared, Rows
from autotune.models.lugre import Flags, Floats

USABLE = 0.999
SHORTEST_RUN = 50  # samples between two clamps
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
    if rows.sum() < SHORTEST_RUN:
        return Found(None, nothing, 0.0, "none", "the torque is clamped nearly everywhere")
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
    return _of_long_runs(data, np.asarray(rows))


def _terms(data: Prepared, smoothing: float) -> dict[str, Floats]:
    """Regressors by sample: e, its filtered rate, its held sum, and the rate of the reference."""
    h = data.period
    error = data.reference - data.measured
    limit = data.metadata.torque_limit or np.inf
    free = np.abs(data.torque) < 0.999 * limit
    rate, total, rate_r = (np.zeros(len(error)) for _ in range(3))
    for stretch in data.stretches:
        rows = stretch.rows
        change = np.diff(error[rows], prepend=error[stretch.start]) / h
        rate[rows] = signal.lfilter([smoothing], [1.0, smoothing - 1.0], change)
        change = np.diff(data.reference[rows], prepend=data.reference[stretch.start]) / h
        rate_r[rows] = change
        total[rows] = np.cumsum(error[rows] * free[rows]) * h
    return {"kp": error, "kd": rate, "ki": total, "rate": rate_r}


def _explained(data: Prepared, controller: Controller, rows: Flags) -> float:
    terms = _terms(data, controller.derivative_filter)
    known = sum(getattr(controller, name) * terms[name] for name in ("kp", "kd", "ki"))
    rest = data.torque - data.feedforward - known
    for run in _runs(data, rows):
        rest[run] -= np.median(rest[run])
    return 1.0 - float(np.var(rest[rows]) / max(np.var(data.torque[rows]), 1e-300))


def _runs(data: Prepared, rows: Flags) -> list[slice]:
    """Contiguous parts of `rows`, each within one stretch.

    What an integral holds after its torque was clamped differs from drive to drive; between two clamps
    it is known but for a constant.
    """
    runs: list[slice] = []
    for stretch in data.stretches:
        inside = np.concatenate([[False], rows[stretch.rows], [False]])
        edges = np.flatnonzero(np.diff(inside.astype(np.int8))) + stretch.start
        runs += [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return runs


def _of_long_runs(data: Prepared, rows: Flags) -> Flags:
    """The rows without runs so short that their constant would explain them."""
    kept = np.zeros_like(rows)
    for run in _runs(data, rows):
        kept[run] = run.stop - run.start >= SHORTEST_RUN
    return kept


def _centred(values: Floats, run: Rows) -> Floats:
    """Values of shape (m, k) less their mean in the run that each row belongs to; `run` of shape (m,)."""
    count = np.maximum(np.bincount(run), 1)
    means = np.column_stack([np.bincount(run, column) / count for column in values.T])
    return np.asarray(values - means[run])


def _regress(data: Prepared, smoothing: float, rows: Rows, run: Rows) -> tuple[float, dict[str, float]]:
    """Gains by least squares with a constant for every run, and the share of the torque they explain."""
    terms = _terms(data, smoothing)
    demand = (data.torque - data.feedforward)[rows]
    centred = _centred(np.column_stack([*(term[rows] for term in terms.values()), demand]), run)
    table, target = centred[:, :-1], centred[:, -1]
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    solution = np.linalg.lstsq(table / size, target, rcond=1e-12)[0] / size
    rest = target - table @ solution
    share = 1.0 - float(np.var(rest) / max(np.var(demand), 1e-300))
    return share, dict(zip(terms, solution.tolist(), strict=True))


def _identified(data: Prepared, rows: Flags) -> Found:
    if len(data.stretches) > 40:
        return Found(None, data.feedforward, 0.0, "none", "the recording is in too many pieces")
    number = np.zeros(len(rows), dtype=np.int64)
    for index, run in enumerate(_runs(data, rows)):
        number[run] = index
    chosen = np.flatnonzero(rows)[:: max(1, int(rows.sum()) // 40_000)]
    scan = [(*_regress(data, a, chosen, number[chosen]), a) for a in _FILTERS]
    best = max(scan, key=lambda item: item[0])
    fine = np.clip(best[2] + np.linspace(-0.05, 0.05, 11), 0.01, 1.0)
    best = max(
        [(*_regress(data, float(a), chosen, number[chosen]), float(a)) for a in fine],
        key=lambda item: item[0],
    )
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
