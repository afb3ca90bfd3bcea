"""What the stages of a run found, kept in `findings.json` so that a later run can take up a stage alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from autotune.control.feedforward import FeedforwardLaw, FixedFeedforward, LugreParameters
from autotune.control.model_feedforward import ModelFeedforward
from autotune.control.reduction import Reduction
from autotune.core.axis import Axis
from autotune.core.documents import numbers_of
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import read_model
from autotune.tuning.files import read_json, write_json
from autotune.tuning.given_model import Given
from autotune.tuning.journal import Journal
from autotune.tuning.proof import HeldOutError, TrackingError
from autotune.tuning.results import run_folders
from autotune.tuning.same_drive import SAME_DRIVE
from autotune.tuning.session import Session
from autotune.tuning.stage_adapt import Adapted
from autotune.tuning.stage_diagnose import Diagnosed
from autotune.tuning.stage_identify import AdaptationStart
from autotune.tuning.stage_model import ModelAdapted
from autotune.tuning.stage_prove import Proved
from autotune.tuning.stage_ripple import RipplePlan

FILE_NAME = "findings.json"
SCHEMA_VERSION = 1
HOST_FILE = "feedforward.toml"
"""The model that the host has to play, where it is more than the drive's block can hold."""
NEEDS = {
    "fit": "recordings/experiment.parquet",
    "diagnose": FILE_NAME,
    "adapt": FILE_NAME,
    "prove": FILE_NAME,
    "commit": FILE_NAME,
}
"""What a stage by itself needs from an earlier run."""


@dataclass(frozen=True, slots=True)
class PlannedValues:
    """Parameters that go into the drive, decided in an earlier stage or run; `host`: it plays the rest.

    `alignment`: what moves the zero of the ripple among them, as it was when that was found. `reduction`: what the
    drive cannot hold of what was proved, and what that is predicted to cost; None where it holds all.
    """

    values: dict[str, float]
    host: bool = False
    alignment: dict[str, float] = field(default_factory=dict)
    reduction: Reduction | None = None

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        reduction = self.reduction.as_json() if self.reduction is not None else None
        return {"values": self.values, "host": self.host, "alignment": self.alignment, "reduction": reduction}

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> PlannedValues:
        """Back from `as_json`, value by value. Raises KeyError, TypeError or ValueError."""
        values, reduction = numbers_of(content["values"]), content.get("reduction")
        return PlannedValues(
            values,
            content.get("host", False) is True,
            numbers_of(content.get("alignment", {})),
            Reduction.from_json(reduction) if reduction is not None else None,
        )


@dataclass(frozen=True)
class Yardstick:
    """What a commit is measured against: the proof's numbers, also those of an earlier run."""

    before: TrackingError
    after: TrackingError
    held_out: HeldOutError

    def as_json(self) -> dict[str, Any]:
        return {
            "before": asdict(self.before),
            "after": asdict(self.after),
            "held_out": self.held_out.as_json(),
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Yardstick:
        unknown = content["held_out"]
        return cls(
            TrackingError(**content["before"]),
            TrackingError(**content["after"]),
            HeldOutError(np.array(unknown["peak_error"]), np.array(unknown["rms_error"])),
        )


@dataclass
class Findings:
    """Filled stage by stage. `held_out`: as the drive runs the held-out motion by itself with what was written.

    `model` is the diagnosed one, or the one that the run was `given`. `proposed` is what a drive's block can hold;
    `proposed_model` goes to the proof in its place where it is better beyond doubt. `better` is the verdict;
    `planned` goes into the drive, where that is not just what is proposed; `held` is in the drive then,
    `held_before` was before. `ripple` is what the drive takes of it, `ripple_removed` the share that was gone when
    it was measured after writing.
    """

    start: AdaptationStart | None = None
    diagnosed: Diagnosed | None = None
    model: DriveModel | None = None
    given: Given | None = None
    proposed: LugreParameters | None = None
    proposed_model: DriveModel | None = None
    modelled: ModelAdapted | None = None
    better: bool = False
    adapted: Adapted | None = None
    proved: Proved | None = None
    baseline: TrackingError | None = None
    yardstick: Yardstick | None = None
    committed: TrackingError | None = None
    with_host: TrackingError | None = None
    held_out: HeldOutError | None = None
    reduction: Reduction | None = None
    planned: PlannedValues | None = None
    ripple: RipplePlan | None = None
    ripple_removed: float | None = None
    held: dict[str, float] = field(default_factory=dict)
    held_before: dict[str, float] = field(default_factory=dict)

    def need_start(self) -> AdaptationStart:
        """Raises ConfigurationError where the stage `fit` has not been done."""
        if self.start is None:
            raise ConfigurationError(
                "there are no identified values; run the stages experiment and fit first"
            )
        return self.start

    def need_proposed(self) -> LugreParameters:
        """Raises ConfigurationError where the stage `adapt` has not been done."""
        if self.proposed is None:
            raise ConfigurationError("there are no adapted parameters; run the stage adapt first")
        return self.proposed

    def law(self, period: float) -> FeedforwardLaw:
        """What is proved, and played by the host as far as the drive does not hold it.

        Raises:
            ConfigurationError: the stage `adapt` has not been done.
        """
        proposed = self.need_proposed()
        if self.proposed_model is not None:
            return ModelFeedforward(self.proposed_model, period)
        return FixedFeedforward(proposed, period)


def save_findings(session: Session, findings: Findings, whole: Sequence[str]) -> None:
    """Writes what later runs may take up; `whole` are the stages done to their end."""
    content: dict[str, Any] = {
        "schema": SCHEMA_VERSION,
        "better": findings.better,
        "whole": list(whole),
        "made_with": made_with(session),
    }
    if findings.baseline is not None:
        content["baseline"] = asdict(findings.baseline)
    if findings.start is not None:
        content["start"] = asdict(findings.start.parameters)
        content["stiffness_range"] = list(findings.start.stiffness_range)
    if findings.proposed is not None:
        content["proposed"] = asdict(findings.proposed)
    if findings.adapted is not None:
        content["adapted"] = _adapted(findings.adapted)
    if findings.planned is not None:
        content["planned"] = findings.planned.as_json()
    if findings.yardstick is not None:
        content["proof"] = findings.yardstick.as_json()
    content["diagnosed"] = findings.model is not None
    content["law"] = "model" if findings.proposed_model is not None else "lugre"
    write_json(session.directory / FILE_NAME, content)


def made_with(session: Session) -> dict[str, Any]:
    """What findings rest on, as plain data: the same axis file, limits, controller and drive, and when."""
    axis = session.axis
    return {
        "at": session.journal.state.started,
        "fingerprint": axis.fingerprint,
        "drive": {name: session.identity[name] for name in SAME_DRIVE if name in session.identity},
        "limits": session.limits.model_dump(),
        "benchmark": axis.benchmark.model_dump(),
        "reference": axis.reference.model_dump(),
        "cycle": axis.cycle,
        "controller": asdict(session.controller) if session.controller is not None else None,
    }


def _adapted(adapted: Adapted) -> dict[str, Any]:
    laws = adapted.laws
    return {
        "laws": {
            "parameters": asdict(laws.parameters),
            "settled": laws.settled,
            "frozen": laws.frozen,
            "valid": laws.valid,
            "reason": laws.reason,
        },
        "steps": [asdict(step.parameters) for step in adapted.steps],
    }


def load_findings(runs: Path, axis: Axis, stage: str) -> Findings:
    """What the newest run of the axis found, for a stage by itself; empty where the stage needs nothing.

    Raises:
        ConfigurationError: no earlier run has what the stage needs, or the axis file has changed since.
    """
    if NEEDS.get(stage) != FILE_NAME:
        return Findings()
    directory = latest_run(runs, axis, FILE_NAME)
    content = read_json(directory / FILE_NAME, "findings file")
    fingerprint = Journal.load(directory).state.fingerprint
    if fingerprint != axis.fingerprint:
        raise ConfigurationError(
            f"{directory} was made with another axis file (fingerprint {fingerprint}, now "
            f"{axis.fingerprint}); run all stages again"
        )
    try:
        findings = _taken_up(content, stage)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigurationError(
            f"findings file {directory / FILE_NAME} is damaged: {error}; run all stages again"
        ) from error
    if content.get("diagnosed"):
        findings.model = read_model(latest_run(runs, axis, "model.toml") / "model.toml")
    if content.get("law") == "model":
        findings.proposed_model = read_model(latest_run(runs, axis, HOST_FILE) / HOST_FILE)
    return findings


def _taken_up(content: dict[str, Any], stage: str) -> Findings:
    """What stands in the file itself, checked value by value: it ends in a drive."""
    findings = Findings(better=content.get("better", False) is True)
    if "start" in content:
        low, high = content["stiffness_range"]
        numbers_of({"stiffness_range from": low, "stiffness_range to": high})
        if not 0.0 < low <= high:
            raise ValueError(f"stiffness_range is {low:g} to {high:g}; both must be above 0, in this order")
        findings.start = AdaptationStart(LugreParameters(**numbers_of(content["start"])), (low, high))
    if "proposed" in content:
        findings.proposed = LugreParameters(**numbers_of(content["proposed"]))
    if stage == "commit" and "proof" in content:
        findings.yardstick = Yardstick.from_json(content["proof"])
    if stage == "commit" and "planned" in content:
        findings.planned = PlannedValues.from_json(content["planned"])
    return findings


def latest_run(runs: Path, axis: Axis, name: str) -> Path:
    """The newest run of the axis that has the file `name`.

    Raises:
        ConfigurationError: there is none.
    """
    for directory in run_folders(runs, axis.name):
        if (directory / name).is_file():
            return directory
    raise ConfigurationError(
        f"no earlier run of axis {axis.name} in {runs} has {name}; run 'autotune run' without --only first"
    )
