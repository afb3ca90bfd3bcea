"""How far a run has come; what its stages hand on and its result is made from."""

from __future__ import annotations

from dataclasses import dataclass, field

from autotune.identify.run import Identification
from autotune.tuning.findings import Findings
from autotune.tuning.outcome import Outcome


@dataclass
class RunState:
    """Filled stage by stage.

    `nothing_to_gain`: everything was done, and what the drive holds now is as good. `whole`: stages done to their end.
    `acting`: what of a feedforward acted in the drive before the run, by name.
    """

    findings: Findings = field(default_factory=Findings)
    identification: Identification | None = None
    outcome: Outcome = Outcome.NOT_APPLIED
    verdict: str = ""
    notes: list[str] = field(default_factory=list)
    nothing_to_gain: bool = False
    refused: bool = False
    guard: str = ""
    whole: list[str] = field(default_factory=list)
    acting: tuple[str, ...] = ()
