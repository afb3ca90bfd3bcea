"""What one kind of recordings allows to be said of candidates: the methods that all kinds have."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from autotune.core.arrays import Flags, Floats
from autotune.diagnosis.candidates import (
    FittedCandidate,
    Gain,
    ScreenedCandidate,
    error_left,
    explained_of_rest,
)
from autotune.diagnosis.evidence.torque_path import is_longer
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.least_squares import standard_errors
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Problem
from autotune.models.effect import Kind
from autotune.models.table import EFFECTS
from autotune.models.torque_lag import TIME_CONSTANT, TORQUE_LAG

CLOSE_START = 0.4
"""Of the best start's fall: starts that come so near are followed too, as gaps and speeds have several minima."""
NEXT_TO_ALL = 0.99
"""Of what a rival leaves: who explains so much of that is told from it, however little it is of all."""
MOST_UNEXPLAINED = 0.25
"""Of a recording's torque variance: where more is left, it confirms nothing (an arm's joints, others moving)."""


@dataclass(frozen=True, slots=True)
class HoldoutResult:
    """What an effect does to the error on trajectories that were not fitted.

    Attributes:
        gain: relative fall of the squared error there; below 0 it rose.
        lowers: whether it lowers it beyond chance.
        rivals: effects in its place that do nearly as well there.
        refuted: whether it raises it; beyond chance, where something was refitted there.
    """

    effect: str
    gain: float
    z: float
    lowers: bool = False
    rivals: tuple[str, ...] = ()
    refuted: bool = False

    @property
    def confirmed(self) -> bool:
        return self.lowers and not self.rivals


@dataclass(frozen=True, slots=True)
class Effort:
    """How far screening follows the starts of a candidate.

    Attributes:
        close: of the best start's fall; starts that come so near are followed too.
        starts, rounds: at most.
        follows_promises: whether a start that is worse is followed where its linear model promises more.
    """

    close: float
    starts: int
    rounds: int
    follows_promises: bool = True


class Evidence(ABC):
    """A kind of recordings. Every method takes the problem as it is at that moment."""

    repeats: bool = False
    """Whether repeats tell noise from what could be explained: only then a fit knows how far it could get."""

    def candidates(self, problem: Problem) -> list[Kind]:
        """Effects that such recordings can show at all."""
        return list(problem.candidates)

    def effort(self, problem: Problem) -> Effort:
        return Effort(CLOSE_START, 2, 4)

    def borne_out(self, model_fit: ModelFit, found: Sequence[ScreenedCandidate]) -> list[ScreenedCandidate]:
        """Candidates with the gains that their fits bear out."""
        return list(found)

    def in_sight(self, problem: Problem, before: ModelFit, after: ModelFit) -> bool:
        """Whether what a model explains beyond another is as much as what is missing must be."""
        return True

    def bears_out(self, problem: Problem, before: ModelFit, after: ModelFit) -> bool:
        """Whether a law of the base that the data ask for is no chance of such recordings."""
        return True

    @abstractmethod
    def worth_fitting(
        self, problem: Problem, model_fit: ModelFit, ranked: Sequence[ScreenedCandidate]
    ) -> list[ScreenedCandidate]:
        """Candidates worth a fit inside the twin, the best first."""

    @abstractmethod
    def best(self, problem: Problem, fitted: Sequence[FittedCandidate]) -> FittedCandidate:
        """The candidate that explains the recordings best."""

    @abstractmethod
    def accepts(self, policy: Policy, chosen: FittedCandidate) -> bool:
        """Whether enough is explained for a name."""

    def alike(self, problem: Problem) -> float:
        """Of the fall: rivals that come so near cannot be told apart."""
        return problem.policy.alike

    def apart(self, problem: Problem, better: ModelFit, worse: ModelFit) -> bool:
        """Whether one model errs less than another beyond chance."""
        return True

    def comes_near(
        self, problem: Problem, root: ModelFit, chosen: FittedCandidate, item: FittedCandidate
    ) -> bool:
        """Whether another candidate errs no more than the chosen one, but for a small part of its fall or by chance.

        Not where the chosen one explains next to all that the other leaves: an eccentricity that explains 97 % of a
        weight's torque, and leaves 260 times as much as the weight, is told from it.
        """
        if self.explains_rest_of(problem, chosen, item):
            return False
        best = error_left(problem, chosen.model_fit)
        near = self.alike(problem) * (error_left(problem, root) - best)
        close = error_left(problem, item.model_fit) - best < near
        return close or not self.apart(problem, chosen.model_fit, item.model_fit)

    def explains_rest_of(self, problem: Problem, chosen: FittedCandidate, item: FittedCandidate) -> bool:
        """Whether the chosen candidate explains what another leaves, beyond chance and with nothing excused."""
        if not self.apart(problem, chosen.model_fit, item.model_fit):
            return False
        parts = explained_of_rest(problem, item.model_fit, chosen.model_fit)
        return all(part.plain_share >= NEXT_TO_ALL for part in parts)

    def rest_that_is_none(self, problem: Problem, error: Floats, noise: float) -> float:
        """Variance [(N m)²]: where no more of an error comes again in repeats, no further effect is looked for.

        `noise` is the variance of what does not come again.
        """
        return problem.policy.rest_part * noise

    def of_the_chain(self, problem: Problem, candidate: FittedCandidate) -> bool:
        """Whether a candidate is the measurement chain's own, and no effect: a lag that any current loop has."""
        if candidate.effect != TORQUE_LAG.name:
            return False
        fitted = candidate.model_fit.fitted
        errors = standard_errors(fitted, problem.training)
        error = max(
            (e for e, one in zip(errors, fitted.free, strict=True) if one.slot == TIME_CONSTANT), default=0.0
        )
        lag = problem.data.lag + float(fitted.packed.p[TIME_CONSTANT])
        return not is_longer(problem, fitted.error, lag, float(error))

    def look_alikes(self, problem: Problem, effect: str) -> list[str]:
        """Effects that may do as well as a single one that was found, though nothing made them candidates for it."""
        return []

    def only_at_rests(self, problem: Problem, before: ModelFit, candidate: FittedCandidate) -> bool:
        """Whether an effect that rests show explains no more than a bristle's unknown stretch at each rest does."""
        return False

    def telling(self, policy: Policy, generic: Mapping[str, Gain]) -> Mapping[str, float]:
        """Of the gains of free functions of each coordinate those that no disturbance makes."""
        return {name: one.gain for name, one in generic.items()}

    @abstractmethod
    def structure_left(self, problem: Problem, model_fit: ModelFit) -> bool:
        """Whether what the model leaves is large and not noise."""

    def overlooked(
        self, problem: Problem, model_fit: ModelFit, first: Sequence[ScreenedCandidate]
    ) -> ScreenedCandidate | None:
        """A candidate that gains so much on unseen data that something is missing, though it cannot be named."""
        return None

    def doubted(
        self,
        problem: Problem,
        root: ModelFit,
        model_fit: ModelFit,
        first: Sequence[ScreenedCandidate] = (),
        unloaded: ModelFit | None = None,
        bare: ModelFit | None = None,
    ) -> bool:
        """Whether effects that were found may be something else, though they lower the error.

        `first`: all candidates beside the root; `unloaded`: the others of several effects without a second mass, where
        that tells of it; `bare`: the root without the effects that it has, where it has any.
        """
        return False

    def unlike_in_one(self, problem: Problem, root: ModelFit, model_fit: ModelFit) -> str:
        """An experiment in which effects leave what they explain in all others; empty where there is none."""
        return ""

    @abstractmethod
    def confirms(self, problem: Problem, effects: Sequence[str], carried: Sequence[HoldoutResult]) -> bool:
        """Whether data that were not fitted confirm every effect."""

    def other_trajectories(self, problem: Problem) -> list[Flags]:
        """Grid rows of trajectories that a model fitted without them is carried to; empty where there are none."""
        return []

    def aligned(self, problem: Problem, model_fit: ModelFit) -> Problem:
        """The problem with torque and motion aligned as a model suggests; the same where nothing changes."""
        return problem

    def weights(self, problem: Problem, error: Floats) -> Floats | None:
        """Weights of the rows without single events; None where none are left out."""
        return None

    def noise_rms(self, problem: Problem, model_fit: ModelFit) -> float:
        """Of what differs from repeat to repeat [N m or N]; nan where unknown."""
        return float("nan")

    def limits(self, problem: Problem) -> tuple[str, ...]:
        """What these recordings do not allow to be told, in words."""
        return ()

    @abstractmethod
    def stopped_by(self, problem: Problem, model_fit: ModelFit, item: ScreenedCandidate) -> str:
        """What keeps a candidate from a fit inside the twin (`worth_fitting`), in words; empty where nothing does."""

    def needs_twin(self, problem: Problem, item: ScreenedCandidate) -> str:
        """What keeps a candidate that only a twin could tell from a name, in words; empty for all others."""
        if problem.twin or not EFFECTS[item.effect].in_transmission:
            return ""
        return "without a twin it cannot be told from what the drive's loop does, nor from a memory"

    @abstractmethod
    def explains(self, candidate: FittedCandidate) -> str:
        """What a fitted candidate does to the error, in words."""

    @abstractmethod
    def explains_part(self, chosen: FittedCandidate) -> str:
        """The same of one that explains a part of what is unknown."""
