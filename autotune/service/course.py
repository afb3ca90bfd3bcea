"""How far a run has come; what its stages hand on and its result is made from."""

from __future__ import annotations

from dataclasses import dataclass, field

from autotune.identify.run import Identification
from autotune.service.findings import Findings
from autotune.service.outcome import Outcome
from autotune.service.proof import TrackingError


@dataclass
class Course:
    """Filled stage by stage. `nothing_to_gain`: everything was done, and what the drive holds now is as good."""

    findings: Findings = field(default_factory=Findings)
    identification: Identification | None = None
    baseline: TrackingError | None = None
    outcome: Outcome = Outcome.NOT_APPLIED
    verdict: str = ""
    notes: list[str] = field(default_factory=list)
    nothing_to_gain: bool = False
