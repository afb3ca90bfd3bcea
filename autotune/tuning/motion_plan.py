"""What is going to move, in numbers, before a person is asked: travel, speed and time of the programme itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.experiments.deciding import LONGEST as DECIDING_SECONDS
from autotune.experiments.deciding import deciding
from autotune.experiments.diagnosis import confirmation
from autotune.experiments.experiment import Experiment
from autotune.experiments.held_out import HeldOut
from autotune.experiments.path import Motion
from autotune.experiments.programmes import Choices, build
from autotune.experiments.ripple_sweep import RippleSweep, sweep_of
from autotune.experiments.sines import BenchmarkSine
from autotune.models.table import looking_alike
from autotune.tuning.holdings import holding_of
from autotune.tuning.request import STAGES
from autotune.tuning.stage_adapt import LONGEST_SECONDS, REFINEMENT_STEPS, window_seconds
from autotune.tuning.stage_diagnose import SECONDS, SEED
from autotune.tuning.stage_identify import BASELINE_PERIODS
from autotune.tuning.stage_prove import committed_seconds, proof_seconds
from autotune.tuning.stage_ripple import SWEEPS


@dataclass(frozen=True, slots=True)
class MotionPlan:
    """Travel and peak speed, each with the margin that the guard keeps [motion unit, /s], and machine time [s]."""

    low: float
    high: float
    speed: float
    seconds: float

    def sentence(self, axis: Axis) -> str:
        """For the person at the machine."""
        unit = axis.motion_unit
        return (
            f"Axis {axis.name} at {axis.link} will move between {self.low:.3g} and {self.high:.3g} {unit} (and there "
            f"from where it stands), at up to {self.speed:.3g} {unit}/s, for about {self.seconds:.0f} s."
        )


def planned_run(axis: Axis, only: str | None = None, decide: bool = False) -> MotionPlan | None:
    """Of a run, or of a stage alone; None where nothing moves. `decide`: a diagnosis in doubt may be decided.

    Raises:
        ConfigurationError: the limits leave no room for an experiment.
    """
    stages = STAGES if only is None else (only,)
    parts = [part for stage in stages if (part := _stage(axis, stage)) is not None]
    if decide and "diagnose" in stages:
        parts.append((_deciding(axis), DECIDING_SECONDS))
    if not parts:
        return None
    whole = planned([experiment for experiments, _ in parts for experiment in experiments], axis)
    seconds = min(sum(seconds for _, seconds in parts), axis.limits.machine_seconds)
    return MotionPlan(whole.low, whole.high, whole.speed, seconds)


def planned_programme(axis: Axis, programme: str, rivals: tuple[str, ...] | None = None) -> MotionPlan:
    """Of a programme that is played for its recording; `rivals`: what `decide` is to tell apart."""
    return planned(build(programme, axis, Choices(rivals=rivals)), axis)


def _stage(axis: Axis, stage: str) -> tuple[Sequence[Experiment], float] | None:
    """Experiments and machine time of a stage; of what depends on results, the longest."""
    motion, benchmark = Motion.of(axis), axis.benchmark
    sine, held_out = BenchmarkSine(motion, 1, BASELINE_PERIODS), HeldOut(motion)
    if stage == "experiment":
        experiments = (sine, *build("identification", axis))
        return experiments, sum(one.duration for one in experiments)
    if stage == "diagnose":
        trajectory = confirmation(motion, SECONDS, np.random.default_rng(SEED))
        return trajectory, sum(one.duration for one in trajectory)
    if stage == "adapt":
        return (sine,), LONGEST_SECONDS + (REFINEMENT_STEPS + 1) * window_seconds(benchmark.frequency)
    if stage == "prove":
        return (sine, held_out), proof_seconds(motion, benchmark)
    if stage == "commit":
        sweeps = sweeps_of(axis, motion)
        seconds = committed_seconds(motion, benchmark) + sum(sweep.duration for sweep in sweeps)
        return (sine, held_out, *sweeps), seconds
    return None


def _deciding(axis: Axis) -> list[Experiment]:
    """Whatever a diagnosis may ask for; without those that the limits leave no room for, which are not played."""
    found: list[Experiment] = []
    for rivals in ((), *map(sorted, looking_alike().values())):
        try:
            played = deciding(Motion.of(axis), tuple(rivals), np.random.default_rng(SEED))
            for experiment in played:
                experiment.requirements(axis.limits)
        except ConfigurationError:
            continue
        found += played
    return found


def sweeps_of(axis: Axis, motion: Motion) -> list[RippleSweep]:
    """Those that align torque ripple, at the highest speed that they may have; none where the drive holds none."""
    holding = holding_of(axis.profile)
    if motion.revolution is None or holding is None or not holding.ripple:
        return []
    sweep = sweep_of(motion, 1)
    try:
        sweep.requirements(axis.limits)
    except ConfigurationError:
        return []  # no room for a turn: the ripple stays with the host, and nothing is swept
    return [sweep] * SWEEPS


def planned(experiments: Sequence[Experiment], axis: Axis) -> MotionPlan:
    """Of experiments one after the other."""
    needs = [one.needs(axis.limits) for one in experiments]
    return MotionPlan(
        min(one.position_min for one in needs),
        max(one.position_max for one in needs),
        max(one.speed for one in needs),
        sum(one.duration for one in experiments),
    )
