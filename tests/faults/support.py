"""Logs that were made up, to see that the judge finds what is wrong in them and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from autotune_sim.truth import ROW, Event, TruthFile
from bench.faults.cases import Case
from bench.faults.evidence import Ending, Evidence, Rows

H = 1e-3
WALL = 1000.0  # s, of the monotonic clock when the log begins
LIMITS = (("position_min", -5.0), ("position_max", 5.0), ("speed", 10.0), ("deceleration", 300.0))


def rows_of(velocity: np.ndarray, powered: np.ndarray | None = None) -> Rows:
    """A log with that velocity; the encoder tells the truth, power is off in the last 100 rows."""
    rows = np.zeros(len(velocity), ROW)
    rows["time"] = H * np.arange(len(velocity))
    rows["wall"] = WALL + rows["time"]
    rows["velocity"] = velocity
    rows["position"] = rows["reading"] = H * np.cumsum(velocity)
    rows["temperature"] = rows["shown_temperature"] = 25.0
    on = np.arange(len(velocity)) < len(velocity) - 100 if powered is None else powered
    rows["mode"] = np.where(on, 0, -1)
    rows["live"] = on
    return rows


def ramp(top: float, rows: int = 2000, begin: int = 500, acceleration: float = 200.0) -> np.ndarray:
    """Speed up from rest to `top` and brake again [rad/s]."""
    t = H * (np.arange(rows) - begin)
    up = np.clip(acceleration * t, 0.0, top)
    down = np.clip(top - 300.0 * (t - top / acceleration), 0.0, top)
    return np.asarray(np.where(t < top / acceleration, up, down), float)


def case(*orders: str, kind: str = "plant") -> Case:
    return Case(1, kind, "record dahl", 7, LIMITS, orders)


def put_in(order: str) -> Event:
    """A fault as the drive's log tells it."""
    what, _, when = order.partition("@")
    name, _, value = what.partition("=")
    return Event("fault put in", float(when), WALL + float(when), {"name": name, "value": value})


def evidence(
    rows: Rows,
    orders: Sequence[str] = (),
    output: str = "",
    code: int | None = 4,
    settings: tuple[Mapping[str, float], Mapping[str, float]] | None = None,
    events: Sequence[Event] = (),
    idle: float = 0.0,
    late: float = 0.5,
    missed: int = 0,
) -> Evidence:
    """What a case has left."""
    end = float(rows["wall"][-1]) if len(rows) else WALL
    told = [put_in(order) for order in orders] + list(events)
    if settings is not None:
        before, after = settings
        told = [
            Event("open", 0.0, WALL, {"parameters": dict(before)}),
            *told,
            Event("closed", 0.0, end, {"parameters": dict(after)}),
        ]
    ending = Ending(code, output, WALL - 1.0, end + late, idle=idle)
    return Evidence(case(*orders), ending, TruthFile(rows, tuple(told)), missed=missed)
