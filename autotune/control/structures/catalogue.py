"""The catalogue (section 6.3.8, Table 6.4): every structure on the twin of one axis, in figures and in words.

Sine of the benchmark, small and large step with saturation, robustness over the intervals, sensor noise in the
torque, dead time, effort of identification. What closes a loop on friction through the host is shown, not offered.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.control.feedforward import LugreParameters
from autotune.control.gains.hunting import recognised
from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.members import Family, Member
from autotune.control.gains.steps import BEFORE, HORIZON, StepSizes, settled_after
from autotune.control.gains.twin import Motion, smoothed, step_reference
from autotune.control.structures import laws
from autotune.control.structures.structure import (
    EFFORTS,
    STRUCTURES,
    Bench,
    Structure,
    bristle_of_all,
    run,
    tuned,
)
from autotune.core.arrays import Floats
from autotune.models.drive_model import DriveModel

PERIODS, LOOKED_AT = 6, 3
ADAPTED_PERIODS = 60
WORSE = 1.5
"""Times the nominal error of the sine: more, and worse than PID, on some member is not robust."""
CORRECTIONS = (0.0, 2.0, 5.0, 10.0, 20.0)
"""k of (5.17) [1/s] that are tried; the thesis does not name its own."""
NEARLY = 1.1
"""Errors within this factor are one: then the lesser effort is recommended."""
LATE = (0.5, 1.0, 2.0, 3.0, 4.0)
"""Cycles of dead time that are tried."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One structure's figures.

    Attributes:
        sine_peak_error: largest error of the last periods [rad or m]; inf where it runs away.
        small_settling, large_settling: to ±10 % [s].
        robustness: part of the family on which it neither oscillates nor loses more than half of its accuracy.
        torque_noise: rms of what the sensor puts into the torque from sample to sample [N m or N].
        dead_time: cycles more that it bears, of `LATE`.
        oscillates: it hunts after a step, or swings on within the sine.
    """

    structure: Structure
    sine_peak_error: float
    small_settling: float
    large_settling: float
    robustness: float
    torque_noise: float
    dead_time: float
    oscillates: bool
    sine: Motion
    step: Motion

    @property
    def step_settling(self) -> float:
        return max(self.small_settling, self.large_settling)

    def as_json(self) -> dict[str, object]:
        return {
            "name": self.structure.name,
            "sine_peak_error": self.sine_peak_error,
            "step_settling": self.step_settling,
            "step_settling_small": self.small_settling,
            "step_settling_large": self.large_settling,
            "robustness": self.robustness,
            "torque_noise": self.torque_noise,
            "dead_time_cycles": self.dead_time,
            "oscillates": self.oscillates,
            "effort": self.structure.effort,
            "offered": not self.structure.in_host,
        }


@dataclass(frozen=True, slots=True)
class Catalogue:
    """All entries, in the order of `STRUCTURES`, and which is recommended and why."""

    entries: tuple[Entry, ...]
    recommended: str
    why: str

    def as_json(self) -> dict[str, object]:
        return {
            "structures": [entry.as_json() for entry in self.entries],
            "recommended": self.recommended,
            "why": self.why,
        }


@dataclass(frozen=True, slots=True)
class Trials:
    """The motions that every structure is run on."""

    amplitude: float
    frequency: float
    steps: StepSizes


def catalogue(kin: Family, gains: Gains, trials: Trials) -> Catalogue:
    """Runs every structure; some seconds."""
    member = kin.nominal
    bench = Bench(member.model, bristle_of_all(member.model), gains, member.timing, trials.frequency)
    bench = tuned(bench, bench.lugre)
    adapted = _adapted(bench, member, trials)
    plain = _peak(_sine(STRUCTURES[1], bench, member, trials), trials)
    found = []
    for structure in STRUCTURES:
        used = tuned(bench, adapted)
        if structure.kind == laws.LUND_GRENOBLE:
            used = _best_correction(structure, used, member, trials)
        found.append(_entry(structure, used, kin, trials, plain))
    name, why = recommended(found)
    return Catalogue(tuple(found), name, why)


def sine_of(trials: Trials, timing: LoopTiming, periods: int) -> Floats:
    """Whole periods of the benchmark from rest, behind the reference's filter; shape (n,)."""
    time = np.arange(round(periods / (trials.frequency * timing.period))) * timing.period
    fade = np.minimum(time * trials.frequency, 1.0)
    raw = trials.amplitude * fade * np.sin(2.0 * math.pi * trials.frequency * time)
    return smoothed(raw, timing.reference_filter)


def _adapted(bench: Bench, member: Member, trials: Trials) -> LugreParameters:
    """LuGre's parameters as (5.14)–(5.16) leave them after many periods on the twin."""
    structure = next(one for one in STRUCTURES if one.kind == laws.ADAPTIVE_FEEDFORWARD)
    motion, adapted = run(
        structure, bench, member.model, member.timing, sine_of(trials, member.timing, ADAPTED_PERIODS)
    )
    return adapted if motion.bounded else bench.lugre


def _best_correction(structure: Structure, bench: Bench, member: Member, trials: Trials) -> Bench:
    """k of (5.17) with the least error on the sine."""
    tried = []
    for correction in CORRECTIONS:
        own = bench.own.copy()
        own[laws.CORRECTION] = (
            correction * bench.lugre.coulomb / bench.lugre.stiffness / trials.amplitude * 10.0
        )
        other = replace(bench, own=own)
        tried.append((_peak(_sine(structure, other, member, trials), trials), correction, other))
    return min(tried, key=lambda one: one[:2])[2]


def _sine(structure: Structure, bench: Bench, member: Member, trials: Trials) -> Motion:
    return run(structure, bench, member.model, member.timing, sine_of(trials, member.timing, PERIODS))[0]


def _peak(motion: Motion, trials: Trials) -> float:
    """Largest error of the last periods; inf where the loop ran away."""
    if not motion.bounded:
        return math.inf
    rows = round(LOOKED_AT / (trials.frequency * motion.period))
    return float(np.max(np.abs(motion.error[-rows:])))


def _step(
    structure: Structure, bench: Bench, member: Member, size: float, seconds: float = HORIZON
) -> Motion:
    reference = step_reference(size, BEFORE, seconds, member.timing)
    return run(structure, bench, member.model, member.timing, reference)[0]


def _entry(structure: Structure, bench: Bench, kin: Family, trials: Trials, plain: float) -> Entry:
    member, start = kin.nominal, round(BEFORE / bench.timing.period)
    sine = _sine(structure, bench, member, trials)
    peak = _peak(sine, trials)
    small, large = (
        _step(structure, bench, member, size) for size in (trials.steps.small, trials.steps.large)
    )
    oscillates = _swings(structure, bench, member, trials)
    robust = [_robust(structure, bench, one, trials, peak, plain) for one in kin.members]
    return Entry(
        structure,
        peak,
        settled_after(small, trials.steps.small, start, HORIZON),
        settled_after(large, trials.steps.large, start, HORIZON),
        float(np.mean(robust)),
        _noise(sine, trials),
        _bearable(structure, bench, member, trials, peak, plain),
        oscillates,
        sine,
        large,
    )


def _swings(structure: Structure, bench: Bench, member: Member, trials: Trials) -> bool:
    """A limit cycle after the large step."""
    motion = _step(structure, bench, member, trials.steps.large, 4.0)
    if not motion.bounded:
        return True
    after = motion.position[round(BEFORE / motion.period) :]
    return recognised(after, motion.period, member.timing.resolution) is not None


def _robust(
    structure: Structure, bench: Bench, member: Member, trials: Trials, peak: float, plain: float
) -> bool:
    """Neither swings, nor tracks worse than PID does, or by more than `WORSE`."""
    if _swings(structure, bench, member, trials):
        return False
    floor = WORSE * peak + 4.0 * member.timing.resolution
    return _peak(_sine(structure, bench, member, trials), trials) <= max(floor, plain)


def _bearable(
    structure: Structure, bench: Bench, member: Member, trials: Trials, peak: float, plain: float
) -> float:
    """The most of `LATE` with which it still does not swing nor loses its accuracy."""
    for last, cycles in zip((0.0, *LATE), LATE, strict=False):
        dead = member.timing.dead_time + cycles * member.timing.period
        if not _robust(
            structure,
            bench,
            replace(member, timing=replace(member.timing, dead_time=dead)),
            trials,
            peak,
            plain,
        ):
            return last
    return LATE[-1]


def _noise(motion: Motion, trials: Trials) -> float:
    """What changes from sample to sample: second differences of white noise have √6 times its rms."""
    if not motion.bounded:
        return math.inf
    rows = round(LOOKED_AT / (trials.frequency * motion.period))
    return float(np.sqrt(np.mean(np.diff(motion.torque[-rows:], 2) ** 2) / 6.0))


def recommended(entries: Sequence[Entry]) -> tuple[str, str]:
    """The most accurate of those offered that neither oscillate nor are fragile; of equals the least effort."""
    sound = [
        one for one in entries if not one.structure.in_host and not one.oscillates and one.robustness > 0.99
    ]
    if not sound:
        return "", (
            "Nothing can be recommended with today's gains: every structure oscillates somewhere within the intervals. "
            "See 'autotune gains' first."
        )
    best = min(one.sine_peak_error for one in sound)
    near = [one for one in sound if one.sine_peak_error <= NEARLY * best]
    chosen = min(near, key=lambda one: (EFFORTS.index(one.structure.effort), one.sine_peak_error))
    plain = next((one for one in entries if one.structure.name == "PID"), chosen)
    gain = plain.sine_peak_error / chosen.sine_peak_error if chosen.sine_peak_error > 0 else math.inf
    host = [one for one in entries if one.structure.in_host and one.sine_peak_error < chosen.sine_peak_error]
    beside = (
        f" {', '.join(one.structure.name for one in host)} would track closer on the twin, but they close a "
        "loop on friction "
        "through the host and are not offered."
        if host
        else ""
    )
    if chosen is plain:
        return chosen.structure.name, (
            f"PID as it is: nothing else that is offered tracks the benchmark's sine closer by a tenth.{beside}"
        )
    return chosen.structure.name, (
        f"{chosen.structure.name}: {gain:.1f} times closer than PID on the benchmark's sine with the model as it is. "
        "On every axis within the intervals it does not swing, and errs no more than PID does, or than half as much "
        f"again; it needs {chosen.structure.effort}.{beside}"
    )


def of_model(model: DriveModel) -> bool:
    """Whether there is friction to compensate at all."""
    return bristle_of_all(model).coulomb > 1e-9
