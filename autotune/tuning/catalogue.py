"""`autotune catalogue`: the control structures beside each other on the twin of an axis. Nothing moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from autotune.control.gains.members import family
from autotune.control.learning import TwinCeiling, ceiling_on_twin
from autotune.control.structures.catalogue import (
    LOOKED_AT,
    PERIODS,
    Catalogue,
    Trials,
    catalogue,
    of_model,
    sine_of,
)
from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError, NotEnoughExcitation
from autotune.tuning.gains import Known, known_of, task_of, timing_of


@dataclass(frozen=True, slots=True)
class Shown:
    """The catalogue, what it rests on, what it was run with, and the ceiling on the twin; None where it runs away."""

    known: Known
    trials: Trials
    found: Catalogue
    ceiling: TwinCeiling | None


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
    timing = timing_of(axis, held, dead_time + known.late, known.disturbance)
    task = task_of(axis, known.model, timing)
    trials = Trials(axis.benchmark.amplitude, axis.benchmark.frequency, task.steps)
    found = catalogue(family(known.model, timing), known.gains, trials)
    reference = sine_of(trials, timing, PERIODS)
    rows = round(LOOKED_AT / (trials.frequency * timing.period))
    try:
        ceiling = ceiling_on_twin(known.model, known.gains, timing, reference, slice(-rows, None))
    except ConfigurationError:
        ceiling = None
    return Shown(known, trials, found, ceiling)
