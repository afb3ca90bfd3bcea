"""What a run came to: one object, the same on the screen, in run.json and in the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from autotune.tuning.proof import TrackingError

SCHEMA_VERSION = 1


class Outcome(StrEnum):
    """How a run ended.

    `kept`: something that was proved is in the drive; `host_only`: proved, and the drive can hold none of it.
    """

    KEPT = "kept"
    HOST_ONLY = "host_only"
    ROLLED_BACK = "rolled_back"
    NOT_APPLIED = "not_applied"
    ABORTED = "aborted"


EXIT_CODES = {Outcome.KEPT: 0, Outcome.HOST_ONLY: 3, Outcome.ROLLED_BACK: 3, Outcome.NOT_APPLIED: 3}


@dataclass(frozen=True, slots=True)
class RunResult:
    """All that a run says.

    Attributes:
        verdict: one to three sentences in plain words.
        in_drive: what is in the drive and acts without a host: `keeps` (names), `peak_error` before and with it,
            `ripple_removed` (share, as measured); empty `keeps` where nothing is.
        host_adds: what a host reaches beyond that while it plays: `peak_error`, `file`, what it has to play.
        before, after: on the benchmark, without and with what is proposed (played by the host); None where not
            measured.
        improvement: mean fall of the peak error and its interval, or None.
        parameters: {name → {value, standard_error, unit}} of the identified model.
        feedforward: what was proved, as the drive's block names it.
        adaptation: the thesis's laws alone (`thesis`) and the refinement (`refined`).
        diagnosis: verdict, effects, confidence, error before, after and floor; what the model's feedforward gave.
        given: the model that the run was given: its error beside those of the run's own, what its feedforward gave;
            empty where none was. `diagnosis` is then that of the model that the run identified.
        reduction: what the drive cannot hold: predicted and measured loss; empty where it holds all.
        committed: what the drive does by itself with what was written; None where nothing was.
        with_host: with what the host plays beside it, where the drive holds a part only.
        held_out: peak and rms of each window of a motion that nothing was adapted to, before and after.
        refused: the axis or what was measured did not allow what was asked, see `verdict`.
        guard: the guard's sentence, where a refusal rests on its stop.
        only: the single stage that was asked for; None for a whole run.
        notes: sentences on validity, recovery, limits.
    """

    outcome: Outcome
    verdict: str
    axis: str
    fingerprint: str
    started: str
    machine_seconds: float
    run_directory: Path
    in_drive: Mapping[str, Any] = field(default_factory=dict)
    host_adds: Mapping[str, Any] = field(default_factory=dict)
    before: TrackingError | None = None
    after: TrackingError | None = None
    improvement: Mapping[str, Any] | None = None
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    feedforward: Mapping[str, float] = field(default_factory=dict)
    adaptation: Mapping[str, Any] = field(default_factory=dict)
    diagnosis: Mapping[str, Any] = field(default_factory=dict)
    given: Mapping[str, Any] = field(default_factory=dict)
    reduction: Mapping[str, Any] = field(default_factory=dict)
    committed: TrackingError | None = None
    with_host: TrackingError | None = None
    held_out: Mapping[str, Any] = field(default_factory=dict)
    only: str | None = None
    refused: bool = False
    guard: str = ""
    notes: Sequence[str] = ()
    stages: Mapping[str, float] = field(default_factory=dict)
    motion_unit: str = "rad"

    @property
    def stage_done(self) -> bool:
        """A stage by itself, done as asked; that nothing is written is no failure then."""
        alone = self.only is not None and self.only != "commit"
        return alone and self.outcome is Outcome.NOT_APPLIED and not self.refused

    @property
    def exit_code(self) -> int:
        """Of the command line; an aborted run's code is that of the error that ended it."""
        return 0 if self.stage_done else EXIT_CODES.get(self.outcome, 5)

    def as_json(self) -> dict[str, Any]:
        """The object of `run --json` and run.json."""
        content: dict[str, Any] = {"outcome": self.outcome.value, "verdict": self.verdict}
        content |= {"in_drive": dict(self.in_drive), "host_adds": dict(self.host_adds)} | asdict(self)
        content |= {
            "schema": SCHEMA_VERSION,
            "outcome": self.outcome.value,
            "run_directory": str(self.run_directory),
            "notes": list(self.notes),
        }
        return content
