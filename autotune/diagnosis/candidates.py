"""Candidates: an effect that may be what the model lacks, after a first fit and after a fit inside the twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.cross_validation import Explained
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.least_squares import Fitted
from autotune.estimation.problem import Problem
from autotune.models.drive_model import Packed

Progress = Callable[[str], None]
"""Is told what begins."""


def no_progress(_: str) -> None:
    """Progress that nobody wants to see."""


@dataclass(frozen=True, slots=True)
class ScreenedCandidate:
    """An effect fitted on the measured motion, with the bias of the model without it.

    Attributes:
        fall: of the mean square [(N m)²]; gain, z: on experiments held out.
        others: where else it could begin: shorter fits, and their starts.
    """

    effect: str
    fitted: Fitted
    fall: float
    gain: float
    z: float
    others: tuple[Packed, ...] = ()


@dataclass(frozen=True, slots=True)
class FittedCandidate:
    """A model with one effect more, fitted inside the twin, and what it explains of training and veto.

    Attributes:
        gain: fall of the squared error on unseen data, relative to the model without the effect.
        named: whether so much is explained that the effects can be named.
    """

    effect: str
    model_fit: ModelFit
    gain: float
    training: Explained
    veto: Explained | None
    named: bool

    @property
    def share(self) -> float:
        """Of what can be explained: the lesser of training and veto."""
        return min(self.training.share, self.veto.share if self.veto else 1.0)


def error_left(problem: Problem, model_fit: ModelFit) -> float:
    """Error on training and veto together, each by its own share of the rows [(N m)²]."""
    error = model_fit.fitted.error
    total = problem.mean_square(error, TRAINING)
    return total + (problem.mean_square(error, VETO) if problem.has(VETO) else 0.0)
