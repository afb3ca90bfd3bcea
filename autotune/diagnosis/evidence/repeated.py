"""A programme played more than once: what repeats do not share is noise, all else could be explained."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from autotune.diagnosis.candidates import FittedCandidate, ScreenedCandidate, error_left
from autotune.diagnosis.evidence.evidence import Evidence, HoldoutResult
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.policy import Policy
from autotune.estimation.problem import CHUNK, Problem

STRUCTURE_WITHOUT_TWIN = 1.0
"""Of the noise: the least rest where no twin takes out the bias of the measurement chain, a third of the noise."""


class RepeatedProgramme(Evidence):
    """A candidate must explain nearly all that can be explained, on a veto trajectory too."""

    repeats = True

    def worth_fitting(
        self, problem: Problem, model_fit: ModelFit, ranked: Sequence[ScreenedCandidate]
    ) -> list[ScreenedCandidate]:
        policy = problem.policy
        least = policy.least_gain if problem.twin else policy.least_gain_without_twin
        return [
            item
            for item in ranked
            if item.gain >= least and (item.z >= policy.least_z or item.gain >= policy.clear_gain)
        ]

    def best(self, problem: Problem, fitted: Sequence[FittedCandidate]) -> FittedCandidate:
        return min(fitted, key=lambda item: error_left(problem, item.model_fit))

    def accepts(self, policy: Policy, chosen: FittedCandidate) -> bool:
        return chosen.named

    def apart(self, problem: Problem, better: ModelFit, worse: ModelFit) -> bool:
        """Second by second of training and veto."""
        weight = problem.weight * problem.data.role(TRAINING, VETO)
        surplus = weight * (worse.fitted.error**2 - better.fitted.error**2)
        seconds = np.array([part.sum() for part in np.array_split(surplus, max(3, len(surplus) // CHUNK))])
        error = float(seconds.std(ddof=1)) / math.sqrt(len(seconds))
        return float(seconds.mean()) > problem.policy.apart_z * error

    def structure_left(self, problem: Problem, model_fit: ModelFit) -> bool:
        """Repeatable, beyond doubt, and not next to nothing beside the noise, nor the bias that no twin takes out."""
        variance, error = problem.repeatable(model_fit.fitted.error, model_fit.correction, TRAINING)
        noise = problem.noise_variance(model_fit.fitted.error, TRAINING)
        policy = problem.policy
        part = policy.structure_part if problem.twin else STRUCTURE_WITHOUT_TWIN
        beyond = variance > policy.structure_errors * error and variance > part * noise
        return math.isfinite(variance) and beyond

    def confirms(self, problem: Problem, effects: Sequence[str], carried: Sequence[HoldoutResult]) -> bool:
        """By the veto trajectory, which was never fitted; without a twin not at all."""
        return problem.twin and problem.has_veto

    def noise_rms(self, problem: Problem, model_fit: ModelFit) -> float:
        return math.sqrt(max(problem.noise_variance(model_fit.fitted.error, TRAINING, plain=True), 0.0))

    def explains(self, candidate: FittedCandidate) -> str:
        veto = f", {100 * candidate.veto.share:.0f} % on the veto trajectory" if candidate.veto else ""
        return f"explains {100 * candidate.training.share:.0f} % of the explainable error{veto}"

    def explains_part(self, chosen: FittedCandidate) -> str:
        return f"explains {100 * chosen.share:.0f} % of it"
