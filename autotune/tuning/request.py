"""What is asked of a tuning run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel
from autotune.tuning.preparation import SessionRequest

STAGES = ("check", "experiment", "fit", "diagnose", "adapt", "prove", "commit")


@dataclass(frozen=True)
class Request(SessionRequest):
    """What is asked of a run.

    Attributes:
        only: a single stage, or None for all.
        gain: None for a tuning. For a re-tune after drift: what the drive will hold by itself is proved against
            what it holds now, and this share of the peak error must be gained; 0: whatever is better beyond doubt.
        resume: None for a new run; else the name of the run to take up from its last whole stage, "newest" for that.
        decide: whether a diagnosis in doubt may move the axis for a minute more, to decide it.
        model: goes to the proof in place of the one that the run diagnoses; None: that one does.
        approve: asked before anything is written to the drive for good.
    """

    only: str | None = None
    gain: float | None = None
    resume: str | None = None
    decide: bool = False
    model: DriveModel | None = None
    approve: Callable[[str], bool] = field(default=lambda sentence: True)

    def refuse_nonsense(self) -> None:
        """Raises ConfigurationError where no such run can be."""
        if self.only is not None and self.only not in STAGES:
            raise ConfigurationError(f"--only is {self.only!r}; the stages are {', '.join(STAGES)}")
        if self.only is not None and self.resume is not None:
            raise ConfigurationError(
                "--only and --resume exclude one another: --resume does all the stages that are left"
            )
        if self.model is not None:
            self._refuse_model(self.model)

    def _refuse_model(self, model: DriveModel) -> None:
        if self.only is not None or self.resume is not None:
            raise ConfigurationError(
                "a model that is given goes through a whole run, without --only and --resume: it is compared with "
                "what the run itself finds"
            )
        axis = self.axis
        if model.motion_unit != axis.motion_unit or model.torque_unit:
            raise ConfigurationError(
                f"the model is in {model.motion_unit} and {model.torque_symbol}, axis {axis.name} in "
                f"{axis.motion_unit}: fit one from recordings of this axis"
            )
        if model.fingerprint and model.fingerprint != axis.fingerprint:
            raise ConfigurationError(
                f"the model is of axis {model.axis or model.fingerprint}, or of another state of its axis file; "
                f"this is {axis.name} ({axis.fingerprint}): fit one from recordings of this axis"
            )
