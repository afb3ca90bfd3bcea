"""Mean torques at constant speeds: the curve of friction over speed, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence

from autotune.core.arrays import Flags, Floats
from autotune.diagnosis.candidates import FittedCandidate, ScreenedCandidate
from autotune.diagnosis.evidence.evidence import Effort, Evidence
from autotune.diagnosis.evidence.single import SingleRecording
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.problem import Problem
from autotune.models.effect import Kind


class SpeedCurve(SingleRecording):
    """Few points without noise: every start is followed, chance and size are not asked."""

    def candidates(self, problem: Problem) -> list[Kind]:
        return [kind for kind in Evidence.candidates(self, problem) if kind.at_constant_speed]

    def effort(self, problem: Problem) -> Effort:
        return Effort(0.0, 9, 15, follows_promises=False)

    def worth_fitting(
        self, problem: Problem, model_fit: ModelFit, ranked: Sequence[ScreenedCandidate]
    ) -> list[ScreenedCandidate]:
        return self._likely(problem, ranked, problem.policy.least_gain)

    def stopped_by(self, problem: Problem, model_fit: ModelFit, item: ScreenedCandidate) -> str:
        least = problem.policy.least_gain
        return "" if self._likely(problem, [item], least) else f"{100 * least:.0f} % beyond chance are needed"

    def best(self, problem: Problem, fitted: Sequence[FittedCandidate]) -> FittedCandidate:
        return max(fitted, key=lambda item: item.gain)

    def alike(self, problem: Problem) -> float:
        return problem.policy.alike

    def other_trajectories(self, problem: Problem) -> list[Flags]:
        return []

    def aligned(self, problem: Problem, model_fit: ModelFit) -> Problem:
        return problem

    def weights(self, problem: Problem, error: Floats) -> Floats | None:
        return None
