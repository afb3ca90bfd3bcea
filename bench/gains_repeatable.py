"""Fixed parameters against converged learning in what repeats: chance is averaged away, in learning and in judging.

    python -m bench.gains_repeatable --seed S --axes 10

Each axis (presets varied by ±20 %) is tuned in process. Learning is iterative, of the kind that the tool has (the
controller's own torque, advanced, behind a low-pass), but with `PERIODS` periods in each trial where the tool has
three, and in three designs: its own, and two gentler ones that reach further up; each begins from what the fixed
parameters play, and from nothing. What a design converges to is the mean of its last torques; the ceiling is the best
of all by the encoder. Then the fixed parameters, that ceiling, and what the tool's own design learns from nothing are
played `BLOCKS` times `PERIODS` periods, under other noises: the peak and the root mean square of the error's mean
period, by the true position and by the encoder, and the standard error of their ratio (jackknife over the blocks).

On the ten sines that neither has seen, what was learnt is played as it is (largest single error) and stretched to their
period (peak of the mean period of `PERIODS`).
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autotune.control.feedforward import FeedforwardLaw
from autotune.control.learning import LearntFeedforward, by_phase
from autotune.experiments.path import Motion
from autotune.experiments.sines import period_samples
from autotune.tuning.ceiling import UNSEEN, fixed_law, played_by, unseen_motion
from autotune.tuning.links import open_link
from autotune.tuning.progress import Silent
from autotune.tuning.run import Request, tune
from autotune_sim.presets import Preset, preset
from bench.gains_ceiling import played
from bench.gains_identified import KINDS, axis_in

Floats = NDArray[np.float64]
PERIODS, BLOCKS, CHOOSING = 48, 16, 96
TRIALS, LAST = 30, 10
LOST = 3.0
"""Times the error that learning began with, from which on a design has diverged."""


@dataclass(frozen=True)
class Design:
    """u ← Q·(u + gain·C·e(t + ahead)): part of the controller's torque, samples ahead, cut-off of Q [Hz]."""

    gain: float
    ahead: int
    cut_off: float

    def next(self, torque: Floats, feedback: Floats, period: float) -> Floats:
        rates = np.fft.rfftfreq(len(torque), period)
        keep = 1.0 / (1.0 + (rates / self.cut_off) ** 4)
        wanted = torque + self.gain * np.roll(feedback, -self.ahead)
        return np.asarray(np.fft.irfft(keep * np.fft.rfft(wanted), len(torque)))


DESIGNS = (Design(0.5, 2, 60.0), Design(0.2, 4, 120.0), Design(0.1, 2, 200.0))


def peak(error: Floats) -> float:
    return float(np.abs(error).max())


def rms(error: Floats) -> float:
    return math.sqrt(float(np.mean(error**2)))


def converged(axis: Preset, motion: Motion, start: Floats, design: Design) -> Floats | None:
    """The mean of the last torques, shape (n,); None where learning diverges."""
    torque, first, last = start, math.inf, []
    for number in range(TRIALS):
        found = played(axis, motion, LearntFeedforward(torque), PERIODS, 200 + number)
        now = peak(found.seen.mean(axis=0))
        first = min(first, now) if number else now
        if now > LOST * max(first, axis.plant.resolution):
            return None
        last.append(torque)
        torque = design.next(torque, found.feedback.mean(axis=0), axis.period)
    return np.asarray(np.mean(last[-LAST:], axis=0))


def ceilings(axis: Preset, motion: Motion, fixed: Floats) -> tuple[Floats, Floats | None, str]:
    """The best that any design has converged to, by the encoder; what the tool's own has, from nothing; in words."""
    found: list[tuple[float, Floats, str]] = []
    own = None
    for start, begun in ((fixed, "fixed"), (np.zeros(len(fixed)), "nothing")):
        for one in DESIGNS:
            torque = converged(axis, motion, start, one)
            own = torque if one == DESIGNS[0] and begun == "nothing" else own
            if torque is not None:
                error = played(axis, motion, LearntFeedforward(torque), CHOOSING, 400).seen.mean(axis=0)
                found.append((peak(error), torque, f"{one.gain:g}, {one.cut_off:g} Hz from {begun}"))
    _, torque, what = min(found, key=lambda one: one[0])
    return torque, own, f"{what} ({len(found)} of {2 * len(DESIGNS)} converge)"


def blocks(axis: Preset, motion: Motion, law: FeedforwardLaw) -> tuple[Floats, Floats]:
    """Mean periods of each block by the true position and by the encoder, shapes (BLOCKS, n)."""
    found = [played(axis, motion, law, PERIODS, 500 + number) for number in range(BLOCKS)]
    return np.array([one.true.mean(axis=0) for one in found]), np.array([
        one.seen.mean(axis=0) for one in found
    ])  # fmt: skip


def compared(of: Callable[[Floats], float], fixed: Floats, learnt: Floats) -> tuple[float, float]:
    """Ratio of a figure of two mean periods, each of blocks (m, n), and its standard error (jackknife)."""
    whole = of(fixed.mean(axis=0)) / of(learnt.mean(axis=0))
    m = len(fixed)
    less = np.array([
        of(np.delete(fixed, k, 0).mean(axis=0)) / of(np.delete(learnt, k, 0).mean(axis=0)) for k in range(m)
    ])  # fmt: skip
    return whole, math.sqrt((m - 1) / m * float(np.sum((less - less.mean()) ** 2)))


def on_unseen(
    axis: Preset, motion: Motion, fixed: FeedforwardLaw, learnt: Floats
) -> list[tuple[float, float]]:
    """What was learnt to the fixed parameters on each sine: by time, stretched."""
    rows = []
    for number in range(len(UNSEEN)):
        other = unseen_motion(motion, number)
        own = played(axis, other, fixed, PERIODS, 600 + number)
        turned = LearntFeedforward(by_phase(learnt, period_samples(other)))
        stretched = played(axis, other, turned, PERIODS, 600 + number)
        by_time = played(axis, other, LearntFeedforward(learnt), PERIODS, 600 + number)
        rows.append((by_time.raw / own.raw, peak(stretched.true.mean(axis=0)) / peak(own.true.mean(axis=0))))
    return rows


FIGURES = ("true peak", "true rms", "peak by the encoder", "rms by the encoder")
Ratios = list[tuple[float, float]]


def ratios_of(fixed: tuple[Floats, Floats], learnt: tuple[Floats, Floats]) -> Ratios:
    """Of `FIGURES`, each with its standard error."""
    return [compared(of, fixed[k], learnt[k]) for k in (0, 1) for of in (peak, rms)]


def one(seed: int, number: int) -> tuple[Ratios, Ratios | None, list[tuple[float, float]]]:
    """One axis: the fixed parameters to the ceiling, and to the tool's own design from nothing; its unseen sines."""
    kind, vary = KINDS[number % len(KINDS)], seed + number
    with tempfile.TemporaryDirectory() as folder:
        told, runs = axis_in(Path(folder), kind, vary), Path(folder) / "runs"
        tune(Request(told, lambda: open_link(told, Path(folder)), runs, Silent(), datetime.now))
        law, motion = fixed_law(told, runs), Motion.of(told)
    axis = preset(kind, vary)
    best, own, what = ceilings(axis, motion, played_by(law, motion))
    fixed = blocks(axis, motion, law)
    print(f"{kind} {vary}: count {1e3 * axis.plant.resolution:.4f} mrad; fixed {in_words(fixed)}")
    found: list[Ratios | None] = []
    for name, torque in ((what, best), ("the tool's own design, from nothing", own)):
        learnt = None if torque is None else blocks(axis, motion, LearntFeedforward(torque))
        found.append(None if learnt is None else ratios_of(fixed, learnt))
        print(f"  {name}: {'diverges' if learnt is None else in_words(learnt)}")
    for ratios in found:
        told_by = (f"{100 * (ratio - 1):+.1f} ± {100 * error:.1f} %" for ratio, error in ratios or [])
        print("  fixed to it:", "; ".join(f"{n} {t}" for n, t in zip(FIGURES, told_by, strict=False)))
    unseen = on_unseen(axis, motion, law, best)
    for name, column in (("as it is", 0), ("stretched", 1)):
        print(f"  unseen, {name}:", " ".join(f"{row[column]:.1f}" for row in unseen), flush=True)
    return found[0] or [], found[1], unseen


def in_words(found: tuple[Floats, Floats]) -> str:
    peaks = ", ".join(f"{1e3 * of(part.mean(axis=0)):.4f}" for part in found for of in (peak, rms))
    return f"true peak and rms, by the encoder: {peaks} mrad"


def summary(what: str, rows: list[Ratios]) -> None:
    table = np.array(rows)
    for column, name in enumerate(FIGURES):
        off, error = 100.0 * (table[:, column, 0] - 1.0), 100.0 * table[:, column, 1]
        print(
            f"fixed to {what}, {name}: {off.min():+.1f} to {off.max():+.1f} %, mean {off.mean():+.1f} %, standard "
            f"errors {error.min():.1f} to {error.max():.1f} %; at most 10 % more on {np.sum(off <= 10.0)} of "
            f"{len(off)}, more by two standard errors on {np.sum(off - 2.0 * error > 10.0)}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--axes", type=int, default=10)
    wanted = parser.parse_args()
    found = [one(wanted.seed, number) for number in range(wanted.axes)]
    summary("the best learnt", [best for best, _, _ in found])
    summary("the tool's own design from nothing", [own for _, own, _ in found if own is not None])
    rows = np.array([row for _, _, unseen in found for row in unseen])
    for name, column in (("as it is", 0), ("stretched", 1)):
        values = rows[:, column]
        print(
            f"unseen sines, what was learnt {name}: {values.min():.1f} to {values.max():.1f} times the fixed "
            f"parameters, median {np.median(values):.1f}, 3 and more on {np.sum(values >= 3.0)} of {len(values)}"
        )


if __name__ == "__main__":
    main()
