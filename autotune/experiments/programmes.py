"""Programmes by name: what `autotune record AXIS PROGRAMME` can play, and in which order."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.experiments.dahl import dahl
from autotune.experiments.deciding import deciding
from autotune.experiments.diagnosis import diagnosis
from autotune.experiments.experiment import Experiment
from autotune.experiments.high_speed import high_speed
from autotune.experiments.path import Motion
from autotune.experiments.presliding import Presliding
from autotune.experiments.sines import BenchmarkSine
from autotune.experiments.steady_state import steady_state


@dataclass(frozen=True, slots=True)
class Choices:
    """What a programme may know beforehand.

    Attributes:
        seed: of every random order and signal.
        centre: position round which the axis moves; None is the middle of its travel.
        friction: level for presliding [N m or N]; None lets it measure it in a slow move.
        torque_mode: the drive can be commanded in torque.
        rivals: effects that programme `decide` is to tell apart, the likeliest first; None where nothing is asked.
    """

    seed: int = 0
    centre: float | None = None
    friction: float | None = None
    torque_mode: bool = True
    rivals: tuple[str, ...] | None = None


Builder = Callable[[Axis, Choices], tuple[Experiment, ...]]


def _steady_state(axis: Axis, choices: Choices) -> tuple[Experiment, ...]:
    return (steady_state(_motion(axis, choices), np.random.default_rng(choices.seed)),)


def _presliding(axis: Axis, choices: Choices) -> tuple[Experiment, ...]:
    return (Presliding(_motion(axis, choices), choices.friction, choices.torque_mode),)


def _dahl(axis: Axis, choices: Choices) -> tuple[Experiment, ...]:
    return (dahl(_motion(axis, choices)),)


def _high_speed(axis: Axis, choices: Choices) -> tuple[Experiment, ...]:
    return (high_speed(_motion(axis, choices)),)


def _benchmark(axis: Axis, choices: Choices) -> tuple[Experiment, ...]:
    return (BenchmarkSine(_motion(axis, choices), axis.benchmark.repeats, axis.benchmark.periods),)


def _diagnosis(axis: Axis, choices: Choices) -> tuple[Experiment, ...]:
    return diagnosis(_motion(axis, choices), np.random.default_rng(choices.seed))


def _decide(axis: Axis, choices: Choices) -> tuple[Experiment, ...]:
    if choices.rivals is None:
        raise ConfigurationError(
            "programme 'decide' needs a diagnosis whose verdict is in doubt: --from diagnosis.json, as written by "
            "'autotune model diagnose … --json > diagnosis.json'"
        )
    return deciding(_motion(axis, choices), choices.rivals, np.random.default_rng(choices.seed))


def _identification(axis: Axis, choices: Choices) -> tuple[Experiment, ...]:
    """The four experiments of section 3.4; presliding measures its own friction where none is known."""
    parts = (_steady_state, _dahl, _presliding, _high_speed)
    return tuple(experiment for part in parts for experiment in part(axis, choices))


def _motion(axis: Axis, choices: Choices) -> Motion:
    return Motion.of(axis, choices.centre)


PROGRAMMES: Mapping[str, Builder] = MappingProxyType(
    {
        "identification": _identification,
        "steady-state": _steady_state,
        "presliding": _presliding,
        "dahl": _dahl,
        "high-speed": _high_speed,
        "benchmark": _benchmark,
        "diagnosis": _diagnosis,
        "decide": _decide,
    }
)


def build(name: str, axis: Axis, choices: Choices | None = None) -> tuple[Experiment, ...]:
    """The experiments of a programme.

    Raises:
        ConfigurationError: no such programme (with the nearest right name), or limits too small.
    """
    if name not in PROGRAMMES:
        near = difflib.get_close_matches(name, PROGRAMMES, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ConfigurationError(
            f"there is no programme {name!r}; {hint}there are {', '.join(sorted(PROGRAMMES))}"
        )
    return PROGRAMMES[name](axis, choices or Choices())
