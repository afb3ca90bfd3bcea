"""Fixed parameters against converged learning, by where the axis truly is: what the encoder hides of the difference.

    python -m bench.gains_ceiling --seed S --axes 10

Each axis (presets varied by ±20 %) is tuned in process and learns its benchmark under the guard, as `autotune catalogue
--ceiling` has it. What the run proposed, what was learnt and the plant's own inverse are then played again on the
simulator's servo, each under several noises, and judged

- as the tool sees it: the peak of the averaged period by the encoder, and how far this comparison scatters by itself;
- by the true position, with the noise averaged away;
- by the true position with an encoder a hundred times finer and no noise: what is left is the model's own error.

Beside them stands what is learnt from nothing, to see that learning comes as far, and what is learnt on the axis with
that encoder and no noise: the ceiling that the real encoder hides.

On the ten sines that neither has seen, also what the plant's inverse reaches: no feedforward can be better there.
"""

from __future__ import annotations

import argparse
import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from autotune.control.feedforward import FeedforwardLaw
from autotune.control.learning import LearntFeedforward, by_phase, next_torque
from autotune.control.model_feedforward import ModelFeedforward
from autotune.control.refinement import smooth_peak
from autotune.experiments.path import Motion
from autotune.experiments.sines import BENCHMARK, BenchmarkSine, period_samples
from autotune.tuning.ceiling import UNSEEN, unseen_motion
from autotune_sim.presets import Preset, preset
from autotune_sim.servo import Servo
from bench.gains import told
from bench.gains_identified import KINDS, in_words, tuned
from bench.gains_plant import DrawnAxis

Floats = NDArray[np.float64]
NOISES, AS_MEASURED, LONG, FEW = 8, 6, 24, 2
"""Repeats under other noises; periods as the tool averages, to average noise away, and where there is none."""
REST = 600
FINER = 100
TRIALS = 25


@dataclass(frozen=True)
class Errors:
    """Errors along whole periods by the encoder and by the true position, shape (periods, n) [rad]; `feedback`: the
    controller's own torque [N m]."""

    seen: Floats
    true: Floats
    feedback: Floats

    @property
    def peaks(self) -> tuple[float, float]:
        """Of the averaged period: by the encoder, and true [rad]."""
        return float(np.abs(self.seen.mean(axis=0)).max()), float(np.abs(self.true.mean(axis=0)).max())

    @property
    def raw(self) -> float:
        """Largest single true error: what has not the period of the motion does not average out [rad]."""
        return float(np.abs(self.true).max())


def played(axis: Preset, motion: Motion, law: FeedforwardLaw | None, periods: int, seed: int) -> Errors:
    """Plays a sine with a law on the simulator's servo."""
    servo, own = Servo(axis, seed), copy.deepcopy(law)
    if own is not None:
        own.prepare()
    servo.power(True)
    for _ in range(REST):
        servo.cycle(motion.centre)
    window = BenchmarkSine(motion, 1, periods)
    first = next(at for at, label, _ in window.plan.marks if label == BENCHMARK)
    seen, true, feedback = [], [], []
    for place, speed, change, gain in window.rows:
        torque = gain * own.step(place, speed, change, None) if own is not None else 0.0
        true.append(place - servo.true_position)
        sample = servo.cycle(place, torque_offset=torque)
        seen.append(place - sample.position)
        feedback.append(sample.torque_demand - sample.torque_offset)
    rows, n = slice(first, first + periods * period_samples(motion)), period_samples(motion)
    return Errors(*(np.reshape(column[rows], (periods, n)) for column in (seen, true, feedback)))


def learnt_anew(axis: Preset, motion: Motion, start: Floats, trials: int) -> Floats:
    """The torque of the best of so many trials of learning, by what the encoder shows; shape (n,)."""
    torque, best, least = start, start, np.inf
    for number in range(trials):
        found = played(axis, motion, LearntFeedforward(torque), AS_MEASURED // 2, 200 + number)
        peak = smooth_peak(found.seen.mean(axis=0))
        best, least = (torque, peak) if peak < least else (best, least)
        torque = next_torque(torque, found.feedback.mean(axis=0), axis.period)
    return best


def quiet(axis: Preset) -> Preset:
    """The same axis without noise, behind a much finer encoder."""
    plant = axis.plant
    return replace(
        axis, plant=replace(plant, counts=FINER * plant.counts, process_noise=0.0, torque_noise=0.0)
    )


def inverse_of(axis: Preset) -> FeedforwardLaw:
    """The plant's own inverse, as far as a model's feedforward can have it."""
    model, _ = told(DrawnAxis(axis.plant, 0.0, 0.2, 1.26), None)
    return ModelFeedforward(model, axis.period)


def on_learnt(axis: Preset, motion: Motion, laws: dict[str, FeedforwardLaw | None]) -> None:
    """The benchmark itself."""
    seen = {name: [played(axis, motion, law, AS_MEASURED, 10 + k).peaks[0] for k in range(NOISES)]
            for name, law in laws.items()}  # fmt: skip
    long = {name: played(axis, motion, law, LONG, 90).peaks[1] for name, law in laws.items()}
    fine = {name: played(quiet(axis), motion, law, FEW, 91).peaks[1] for name, law in laws.items()}
    ratio = 100.0 * (np.array(seen["fixed"]) / np.array(seen["learnt"]) - 1.0)
    print(
        f"  by the encoder {ratio.mean():+.0f} % (from {ratio.min():+.0f} to {ratio.max():+.0f} under {NOISES} noises)"
    )
    for what, peaks in (("true position", long), ("fine encoder, no noise", fine)):
        told_by = ", ".join(f"{name} {1e3 * peak:.4f}" for name, peak in peaks.items())
        print(
            f"  {what}: {told_by} mrad; fixed to learnt {100 * (peaks['fixed'] / peaks['learnt'] - 1):+.0f} %, "
            f"{(peaks['fixed'] - peaks['learnt']) / axis.plant.resolution:+.3f} counts"
        )


def on_unseen(axis: Preset, motion: Motion, fixed: FeedforwardLaw, learnt: Floats) -> list[list[float]]:
    """Rows of amplitude and frequency of a sine, and by how much the fixed parameters leave less than what was learnt.

    Stretched: on the axis as it is, with the plant's inverse instead, and without noise behind a fine encoder; by time.
    """
    rows = []
    for number in range(len(UNSEEN)):
        other = unseen_motion(motion, number)
        turned = LearntFeedforward(by_phase(learnt, period_samples(other)))
        laws = {"fixed": fixed, "inverse": inverse_of(axis), "stretched": turned}
        peak = {name: played(axis, other, law, LONG // 4, 92).peaks[1] for name, law in laws.items()}
        raw = {
            name: played(axis, other, law, LONG // 4, 92).raw
            for name, law in (("fixed", fixed), ("by time", LearntFeedforward(learnt)))
        }
        fine = {
            name: played(quiet(axis), other, laws[name], FEW, 93).peaks[1] for name in ("fixed", "stretched")
        }
        rows.append([
            *UNSEEN[number], peak["stretched"] / peak["fixed"], peak["stretched"] / peak["inverse"],
            fine["stretched"] / fine["fixed"], raw["by time"] / raw["fixed"], peak["fixed"] / axis.plant.resolution,
        ])  # fmt: skip
    return rows


def one(seed: int, number: int) -> list[list[float]]:
    """One axis, all told; the rows of its unseen sines."""
    kind = KINDS[number % len(KINDS)]
    found = tuned(seed, number)
    print(kind, seed + number, flush=True)
    if found.ceiling is None:
        print("  learning was stopped")
        return []
    axis, learnt = preset(kind, seed + number), np.array(found.ceiling.torque)
    print("  in the tool:", in_words(found.ceiling, axis.plant.resolution))
    laws: dict[str, FeedforwardLaw | None] = {
        "fixed": found.law, "learnt": LearntFeedforward(learnt), "inverse": inverse_of(axis), "neither": None,
    }  # fmt: skip
    nothing = np.zeros(len(learnt))
    laws["learnt from nothing"] = LearntFeedforward(learnt_anew(axis, found.motion, nothing, TRIALS))
    laws["learnt without noise"] = LearntFeedforward(learnt_anew(quiet(axis), found.motion, learnt, TRIALS))
    on_learnt(axis, found.motion, laws)
    rows = on_unseen(axis, found.motion, found.law, learnt)
    for row in rows:
        print(
            f"  sine x{row[0]:g} at x{row[1]:g}: stretched {row[2]:.1f} (inverse {row[3]:.1f}, "
            f"no noise {row[4]:.1f}), by time {row[5]:.1f}, fixed leaves {row[6]:.2f} counts",
            flush=True,
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--axes", type=int, default=10)
    wanted = parser.parse_args()
    rows = np.array([row for number in range(wanted.axes) for row in one(wanted.seed, number)])
    columns = {"stretched": 2, "stretched, by the plant's inverse": 3, "stretched, no noise": 4, "by time": 5}
    for what, column in columns.items():
        found = rows[:, column]
        print(f"{what}: {found.min():.1f} to {found.max():.1f}, median {np.median(found):.1f}, "
              f"3 x and more on {np.mean(found >= 3.0):.0%} of {len(found)}")  # fmt: skip


if __name__ == "__main__":
    main()
