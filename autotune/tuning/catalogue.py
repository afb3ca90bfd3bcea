"""`autotune catalogue`: the control structures beside each other on the twin of an axis. Nothing moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from autotune.control.gains.members import family
from autotune.control.structures.catalogue import Catalogue, Trials, catalogue, of_model
from autotune.core.axis import Axis
from autotune.core.errors import NotEnoughExcitation
from autotune.tuning.gains import Known, known_of, task_of, timing_of


@dataclass(frozen=True, slots=True)
class Shown:
    """The catalogue, what it rests on, and what it was run with."""

    known: Known
    trials: Trials
    found: Catalogue


def catalogue_of(axis: Axis, runs: Path, held: Mapping[str, float] | None, dead_time: float = 0.0) -> Shown:
    """Runs all structures on the axis's last model; a minute at most.

    Raises:
        ConfigurationError: no model, or no gains. NotEnoughExcitation: the model has no friction to compensate.
    """
    known = known_of(axis, runs, held)
    if not of_model(known.model):
        raise NotEnoughExcitation(
            f"the model {known.source} has no friction: there is nothing that these structures could compensate"
        )
    timing = timing_of(axis, held, dead_time, known.disturbance)
    task = task_of(axis, known.model, timing)
    trials = Trials(axis.benchmark.amplitude, axis.benchmark.frequency, task.steps)
    return Shown(known, trials, catalogue(family(known.model, timing), known.gains, trials))
