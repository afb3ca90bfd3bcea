"""What is left of a case for the judge: the plant's log, the program's words and its exit code."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autotune_sim.presets import preset
from autotune_sim.truth import Event, TruthFile
from bench.faults.cases import Case
from bench.faults.policy import LOST_CYCLES

Rows = NDArray[np.void]
Column = NDArray[np.float64]
_CONTROLLERS_OWN = frozenset({"605A:00"})
"""Objects inside a simulated moteus controller that no host can see."""
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\r")
PROCESS_DATA = frozenset(
    {"6040:00", "6060:00", "607A:00", "60FF:00", "6071:00", "60B1:00", "60B2:00", "2200:03", "2200:04"}
)
"""Objects that a master writes in every cycle: no settings."""


@dataclass(frozen=True)
class Ending:
    """How the program ended.

    Attributes:
        code: exit code, negative for a signal, None where it had to be killed by the rig.
        output: all that it printed.
        began, ended: monotonic clock [s].
        cpu: processor time of the case, idle: wall time in which it neither worked nor wanted to [s].
        killed: the case itself killed it.
    """

    code: int | None
    output: str
    began: float
    ended: float
    cpu: float = 0.0
    idle: float = 0.0
    killed: bool = False

    @property
    def words(self) -> str:
        """The output without escapes, in one line."""
        return " ".join(_ESCAPES.sub(" ", self.output).split())


@dataclass(frozen=True)
class Evidence:
    """One case, and all that is known of it.

    Attributes:
        put_right: settings after the next start, where one was tried; `next_words`: what it said.
        repairable: the case allows settings to be left for the next start.
        missed: cycles that the recordings which the run left tell as lost; only of cases behind a wire.
    """

    case: Case
    ending: Ending
    truth: TruthFile
    put_right: Mapping[str, float] | None = None
    next_words: str = ""
    notes: Sequence[str] = field(default_factory=tuple)
    missed: int = 0

    def column(self, name: str) -> Column:
        """One column of the log."""
        return np.asarray(self.truth.rows[name], float)

    def events(self, kind: str) -> list[Event]:
        return [event for event in self.truth.events if event.kind == kind]

    @property
    def put_in(self) -> list[Event]:
        """Faults that did happen."""
        return self.events("fault put in")

    @property
    def limits(self) -> dict[str, float]:
        """Limits of the axis, SI."""
        usual = {"torque": 1.34, "following_error": 0.15, "temperature": 80.0}
        return usual | dict(self.case.limits)

    @property
    def inertia(self) -> float:
        """Of the axis as it was built [kg m²]."""
        return preset("edm-vertical", self.case.plant).plant.inertia

    def settings(self, kind: str) -> dict[str, float] | None:
        """Settings as an event of that kind tells them, process data left out; None where there is none."""
        events = self.events(kind)
        if not events:
            return None
        details: Mapping[str, Any] = events[-1].details if kind != "open" else events[0].details
        values = dict(details.get("parameters") or details.get("objects") or {})
        values.update({f"stored {name}": value for name, value in (details.get("stored") or {}).items()})
        _forget_unused(values)
        own = PROCESS_DATA | (_CONTROLLERS_OWN if self.case.kind == "line" else frozenset())
        return {name: float(value) for name, value in values.items() if name not in own}


def _forget_unused(values: dict[str, Any]) -> None:
    """Entries of a PDO mapping beyond its number have no effect: they are no settings."""
    for name in [name for name in values if name[:2] in ("16", "1A") and name[4:5] == ":"]:
        if int(name[5:], 16) > int(values.get(f"{name[:4]}:00", 0)):
            values[name] = 0


def different(before: Mapping[str, float], after: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Settings that are not as before: name → (before, after)."""
    changed = {}
    for name, value in before.items():
        now = after.get(name, value)
        if not np.isclose(now, value, rtol=1e-6, atol=1e-12):
            changed[name] = (value, now)
    return changed


def told_as_lost(evidence: Evidence, since: float) -> bool:
    """Whether a silence took no more cycles of the axis than may be lost in a row, and the recording says so.

    Behind a line whose simulator waits for its host, 50 ms of silence are one cycle of the axis: the plant's log shows
    that nothing moved meanwhile. Nothing is hidden from who reads a recording that counts it as missed.
    """
    event = next(one for one in evidence.put_in if one.details.get("name") == "silent" and one.time == since)
    seconds = float(event.details.get("value") or np.inf)
    wall = evidence.column("wall")
    powered = evidence.truth.rows["mode"] >= 0
    ran = np.count_nonzero((wall > event.wall) & (wall < event.wall + seconds) & powered)
    return int(ran) <= LOST_CYCLES and evidence.missed > 0
