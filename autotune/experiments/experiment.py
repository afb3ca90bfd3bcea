"""What an experiment is: a generator of commands that receives samples, and what it needs.

An experiment yields a `Command` for each cycle and is sent the sample of that cycle; a `Mark` between
commands names what the next samples belong to, a `Switch` asks for another mode. It knows nothing of
drives, so it can be tested without one. What `run` returns (an adapted feedforward, say) reaches the
owner in `Played`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.axis import Limits
from autotune.core.drive import Mode, Sample
from autotune.core.errors import ConfigurationError
from autotune.experiments.guard import REACTION_CYCLES
from autotune.experiments.path import Item, Motion, Path, Plan, Steps, labels_of

TRACKING_MARGIN = 0.01  # part of the path by which the axis may overshoot its reference
SPEED_MARGIN = 1.1
NO_DISTANCE = 1e-12


@dataclass(frozen=True, slots=True)
class Needs:
    """What an experiment asks of an axis; SI, motor side.

    Attributes:
        position_min, position_max: travel, with the braking distance that the guard keeps free.
        speed: peak velocity, with a margin for overshoot.
        acceleration: peak; the axis must be able to brake with at least as much.
        torque: that the experiment adds by itself; what the motion takes is not known beforehand.
    """

    position_min: float
    position_max: float
    speed: float
    acceleration: float
    torque: float


@dataclass(frozen=True)
class Experiment(ABC):
    """Base of all experiments; `name` is its label in recordings."""

    motion: Motion

    @property
    @abstractmethod
    def name(self) -> str:
        """In messages and progress; also the label of its samples where it has only one."""

    @property
    def mode(self) -> Mode:
        """How the drive is commanded at first; it must be so again at the end."""
        return Mode.POSITION

    @property
    @abstractmethod
    def labels(self) -> tuple[str, ...]:
        """Every label that it marks."""

    @property
    @abstractmethod
    def duration(self) -> float:
        """Predicted machine time [s], without the way from where the axis happens to be."""

    @abstractmethod
    def needs(self, limits: Limits) -> Needs:
        """What it takes on an axis that brakes with `limits.deceleration`."""

    @abstractmethod
    def run(self, start: Sample) -> Steps:
        """Commands, from the axis at rest as `start` says, to rest again."""

    def prepare(self) -> None:
        """Does, before power comes on, what the first cycles would otherwise wait for."""
        return

    def __getstate__(self) -> dict[str, object]:
        """Only the fields travel to another process, not what was worked out from them."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def requirements(self, limits: Limits) -> None:
        """Checks that the experiment stays inside `limits`.

        Raises:
            ConfigurationError: names each limit that is too small, and what is needed.
        """
        needs = self.needs(limits)
        shortfalls = (
            ("position_min", needs.position_min, limits.position_min, -1.0),
            ("position_max", needs.position_max, limits.position_max, 1.0),
            ("speed", needs.speed, limits.speed, 1.0),
            ("deceleration", needs.acceleration, limits.deceleration, 1.0),
            ("torque", needs.torque, limits.torque, 1.0),
        )
        problems = [
            f"limits.{name} is {allowed:.6g} but {needed:.6g} is needed"
            for name, needed, allowed, outward in shortfalls
            if outward * (needed - allowed) > 0.0
        ]
        if problems:
            raise ConfigurationError(
                f"the limits are too small for experiment {self.name!r}: {'; '.join(problems)}; widen them "
                "if the machine allows it, or make the benchmark (which scales the experiments) smaller"
            )


@dataclass(frozen=True)
class PlannedExperiment(Experiment):
    """An experiment whose reference is known beforehand.

    The way from where the axis stands to `centre` is added in front of it.
    """

    @abstractmethod
    def trace(self, path: Path) -> None:
        """Builds the reference; `path` stands at rest at the centre."""

    @cached_property
    def plan(self) -> Plan:
        """The whole reference, from rest at the centre."""
        path = Path(self.motion, self.motion.centre)
        self.trace(path)
        return path.plan()

    @property
    def labels(self) -> tuple[str, ...]:
        return labels_of(self.plan)

    @property
    def duration(self) -> float:
        return self.plan.duration

    def needs(self, limits: Limits) -> Needs:
        return needs_of(self.plan, limits)

    def prepare(self) -> None:
        """Makes the plan while power is still off."""
        _ = self.plan

    def run(self, start: Sample) -> Steps:
        yield from approach(self.motion, start.reference)
        yield from self.plan.play()
        return None


def approach(motion: Motion, start: float) -> Generator[Item, Sample, None]:
    """The way to the centre, if there is one."""
    if abs(start - motion.centre) > NO_DISTANCE:
        yield from Path(motion, start).move(motion.centre).plan().play()


def needs_of(plan: Plan, limits: Limits) -> Needs:
    """What a reference needs; the travel is predicted as the guard predicts it."""
    r, v = plan.reference, plan.velocity
    low, high = braking_envelope(r, v, limits.deceleration, REACTION_CYCLES * plan.period)
    margin = TRACKING_MARGIN * float(np.ptp(r))
    return Needs(
        position_min=float(low.min()) - margin,
        position_max=float(high.max()) + margin,
        speed=SPEED_MARGIN * float(np.abs(np.diff(r, prepend=r[0])).max()) / plan.period,
        acceleration=float(np.abs(plan.acceleration).max()),
        torque=float(np.abs(plan.torque).max()),
    )


def together(needs: Sequence[Needs]) -> Needs:
    """What several references need, one after the other."""
    return Needs(
        position_min=min(one.position_min for one in needs),
        position_max=max(one.position_max for one in needs),
        speed=max(one.speed for one in needs),
        acceleration=max(one.acceleration for one in needs),
        torque=max(one.torque for one in needs),
    )


def braking_envelope(
    position: Floats,
    velocity: Floats,
    deceleration: float,
    reaction: float,
) -> tuple[Floats, Floats]:
    """Lowest and highest place where the guard expects the axis to stop (see `guard`); shape (n,) each."""
    gain = deceleration * reaction
    drift = 0.5 * gain * reaction
    up = np.maximum(velocity + gain, 0.0) ** 2 / (2.0 * deceleration)
    down = np.minimum(velocity - gain, 0.0) ** 2 / (2.0 * deceleration)
    return (
        position + velocity * reaction - drift - down,
        position + velocity * reaction + drift + up,
    )
