"""Mean torques at constant speeds: the curve of friction over speed, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence

from autotune.core.arrays import Flags, Floats
from autotune.diagnosis.candidates import FittedCandidate, ScreenedCandidate
from autotune.diagnosis.evidence.evidence import Effort, Evidence
from autotune.diagnosis.evidence.single import SingleRecording
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.problem import Study
from autotune.models.effect import Kind


class SpeedCurve(SingleRecording):
    """Few points without noise: every start is followed, chance and size are not asked."""

    def candidates(self, study: Study) -> list[Kind]:
        return [kind for kind in Evidence.candidates(self, study) if kind.at_constant_speed]

    def effort(self, study: Study) -> Effort:
        return Effort(0.0, 9, 15, follows_promises=False)

    def worth_fitting(
        self, study: Study, level: Level, ranked: Sequence[ScreenedCandidate]
    ) -> list[ScreenedCandidate]:
        return self._likely(study, ranked, study.policy.least_gain)

    def best(self, study: Study, fitted: Sequence[FittedCandidate]) -> FittedCandidate:
        return max(fitted, key=lambda item: item.gain)

    def alike(self, study: Study) -> float:
        return study.policy.alike

    def other_trajectories(self, study: Study) -> list[Flags]:
        return []

    def aligned(self, study: Study, level: Level) -> Study:
        return study

    def weights(self, study: Study, error: Floats) -> Floats | None:
        return None
