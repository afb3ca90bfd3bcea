"""What the stages of a run found, kept in `findings.json` so that a later run can take up a stage alone."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from autotune.control.feedforward import FeedforwardLaw, FixedFeedforward, LugreParameters
from autotune.control.model_feedforward import ModelFeedforward
from autotune.control.reduction import Reduction
from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import read_model
from autotune.service.files import read_json, write_json
from autotune.service.proof import TrackingError
from autotune.service.results import run_folders
from autotune.service.stage_adapt import Adapted
from autotune.service.stage_diagnose import Diagnosed
from autotune.service.stage_identify import Start
from autotune.service.stage_model import ModelAdapted
from autotune.service.stage_prove import Proved

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
class Planned:
    """Parameters that go into the drive, decided in an earlier stage or run; `host`: it plays the rest."""

    values: dict[str, float]
    host: bool = False


@dataclass
class Findings:
    """Filled stage by stage.

    `model` is the diagnosed one. `proposed` is what a drive's block can hold; `proposed_model` goes to the
    proof in its place where it is better beyond doubt. `better` is the verdict; `planned` goes into the drive,
    where that is not just what is proposed; `held` is in the drive then.
    """

    start: Start | None = None
    diagnosed: Diagnosed | None = None
    model: DriveModel | None = None
    proposed: LugreParameters | None = None
    proposed_model: DriveModel | None = None
    modelled: ModelAdapted | None = None
    better: bool = False
    adapted: Adapted | None = None
    proved: Proved | None = None
    committed: TrackingError | None = None
    reduction: Reduction | None = None
    planned: Planned | None = None
    held: dict[str, float] = field(default_factory=dict)

    def need_start(self) -> Start:
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


def save_findings(directory: Path, findings: Findings) -> None:
    """Writes what later runs may take up."""
    content: dict[str, Any] = {"schema": SCHEMA_VERSION, "better": findings.better}
    if findings.start is not None:
        content["start"] = asdict(findings.start.parameters)
        content["stiffness_range"] = list(findings.start.stiffness_range)
    if findings.proposed is not None:
        content["proposed"] = asdict(findings.proposed)
    if findings.planned is not None:
        content["planned"] = asdict(findings.planned)
    content["diagnosed"] = findings.model is not None
    content["law"] = "model" if findings.proposed_model is not None else "lugre"
    write_json(directory / FILE_NAME, content)


def load_findings(runs: Path, axis: Axis, stage: str) -> Findings:
    """What the newest run of the axis found, for a stage by itself; empty where the stage needs nothing.

    Raises:
        ConfigurationError: no earlier run has what the stage needs, or the axis file has changed since.
    """
    if NEEDS.get(stage) != FILE_NAME:
        return Findings()
    directory = latest_run(runs, axis, FILE_NAME)
    content = read_json(directory / FILE_NAME, "findings file")
    journal = read_json(directory / "journal.json", "journal")
    if journal.get("fingerprint") != axis.fingerprint:
        raise ConfigurationError(
            f"{directory} was made with another axis file (fingerprint {journal.get('fingerprint')}, now "
            f"{axis.fingerprint}); run all stages again"
        )
    findings = Findings(better=bool(content.get("better", False)))
    if "start" in content:
        low, high = content["stiffness_range"]
        findings.start = Start(LugreParameters(**content["start"]), (low, high))
    if "proposed" in content:
        findings.proposed = LugreParameters(**content["proposed"])
    if stage == "commit" and "planned" in content:
        findings.planned = Planned(**content["planned"])
    if content.get("diagnosed"):
        findings.model = read_model(latest_run(runs, axis, "model.toml") / "model.toml")
    if content.get("law") == "model":
        findings.proposed_model = read_model(latest_run(runs, axis, HOST_FILE) / HOST_FILE)
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
