"""The programme that makes missing physics visible (see the study behind `autotune model diagnose`).

Seven trajectories, each played twice, in two rounds so that slow drifts differ between the repeats:
presliding sines, the user's sine, triangles, scans over several revolutions, dwells, a multisine,
point-to-point moves. Before them a `conditioning` move that is never fitted; after them `veto`, twice,
which only gates a verdict, and `test`, which is only reported on. About three minutes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from autotune.core.arrays import Floats
from autotune.experiments.experiment import Experiment, PlannedExperiment
from autotune.experiments.path import Motion, Path, times
from autotune.recordings.recording import CONDITIONING
from autotune.signals.excitation import multisine, smooth_step

SMALL_SINES = (0.002, 0.006, 0.02, 0.06, 0.2)  # of the user's amplitude
TRIANGLES = (0.024, 0.06, 0.15, 0.38, 0.95, 2.4)  # of the user's peak speed
SCANS = ((2.0, 1.5), (8.0, 4.0))  # (of the user's peak speed, revolutions)
SCAN_SECONDS = 8.0
DWELLS = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 2.5)  # s
LINES = (2.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.0, 19.0, 21.0, 23.0, 27.0, 31.0)  # Hz
MIXTURE_DRAWS = 40
CONDITIONING_SECONDS = 8.0
PAUSE = 0.15  # s between trajectories


@dataclass(frozen=True)
class Trajectory(PlannedExperiment):
    """One trajectory from rest at `centre` to rest there.

    Attributes:
        label, repeat: of its samples.
        positions: round the centre, unfiltered, shape (n,).
    """

    label: str
    positions: Floats = field(compare=False, repr=False)
    repeat: int = 0

    @property
    def name(self) -> str:
        return self.label

    def trace(self, path: Path) -> None:
        path.dwell(PAUSE)
        path.mark(self.label, self.repeat).add(self.motion.centre + self.positions)


def diagnosis(motion: Motion, rng: np.random.Generator) -> tuple[Experiment, ...]:
    """The whole programme, in the order played."""
    training = {
        "presliding_sines": presliding_sines(motion),
        "sine": sine(motion, motion.amplitude, motion.frequency, 4.0 / motion.frequency),
        "triangles": triangles(motion),
        "scans": scans(motion),
        "dwells": dwells(motion, rng),
        "multisine": sweep(motion, rng),
        "point_to_point": point_to_point(motion),
    }
    rounds = [Trajectory(motion, name, positions, k) for k in (0, 1) for name, positions in training.items()]
    veto, unseen = mixture(motion, rng, 16.0), mixture(motion, rng, 10.0)
    return (
        Trajectory(motion, CONDITIONING, conditioning(motion)),
        *rounds,
        Trajectory(motion, "veto", veto, 0),
        Trajectory(motion, "veto", veto, 1),
        Trajectory(motion, "test", unseen),
    )


def confirmation(motion: Motion, seconds: float, rng: np.random.Generator) -> tuple[Experiment, ...]:
    """A trajectory that nothing is fitted on, at most `seconds` long, played twice: it confirms a name."""
    positions = mixture(motion, rng, seconds)
    return tuple(Trajectory(motion, "veto", positions, repeat) for repeat in (0, 1))


def conditioning(motion: Motion) -> Floats:
    """Forth and back, briskly, over the travel that the other trajectories use."""
    path, speed = _path(motion), 0.5 * motion.top_speed
    reach = min(motion.travel, _revolution(motion) * SCANS[-1][1] / 2.0, CONDITIONING_SECONDS * speed / 4.0)
    return path.move(reach, speed).move(-reach, speed).move(0.0, speed).positions()


def presliding_sines(motion: Motion) -> Floats:
    """Sines at the user's frequency doubled, from a five-hundredth to a fifth of his amplitude."""
    seconds = 4.0 / (2.0 * motion.frequency)
    parts = [sine(motion, part * motion.amplitude, 2.0 * motion.frequency, seconds) for part in SMALL_SINES]
    return np.concatenate(parts)


def sine(motion: Motion, amplitude: float, frequency: float, seconds: float) -> Floats:
    """Whole periods in about `seconds`, faded in and out over half a period; shape (n,)."""
    frequency = _possible(motion, amplitude, frequency)
    turns = max(round(seconds * frequency), 2)
    phase = times(motion.samples(turns / frequency), motion.period * frequency)
    fade = smooth_step(2.0 * phase) * smooth_step(2.0 * (turns - phase))
    return np.asarray(amplitude * fade * np.sin(2.0 * math.pi * phase))


def triangles(motion: Motion) -> Floats:
    """Constant speeds over two decades, about 1.8 s each; the slow ones over a shorter way."""
    path = _path(motion)
    for part in TRIANGLES:
        speed = min(part * motion.usual_speed, 0.5 * motion.top_speed)
        reach = min(max(0.45 * speed, 0.1 * motion.amplitude), 0.5 * motion.travel)
        path.move(reach, speed=speed).move(-reach, speed=speed).move(0.0, speed=speed)
    return path.positions()


def scans(motion: Motion) -> Floats:
    """Over one and a half and over four revolutions (or what the travel and the time allow)."""
    path = _path(motion)
    for part, turns in SCANS:
        speed = min(part * motion.usual_speed, motion.top_speed)
        reach = min(0.5 * turns * _revolution(motion), motion.travel, SCAN_SECONDS * speed / 4.0)
        path.move(reach, speed=speed).move(-reach, speed=speed).move(0.0, speed=speed)
    return path.positions()


def dwells(motion: Motion, rng: np.random.Generator) -> Floats:
    """Short moves with rests of 0.05 to 2.5 s between them, both directions, in random order."""
    path = _path(motion)
    step = 0.5 * motion.amplitude
    for direction in (1.0, -1.0):
        for seconds in rng.permutation(DWELLS):
            path.dwell(float(seconds)).move(direction * step, speed=0.5 * motion.usual_speed)
            direction = -direction
    return path.move(0.0).positions()


def sweep(motion: Motion, rng: np.random.Generator) -> Floats:
    """Multisine from 2 to 31 Hz of equal velocity at each line, four periods of one second."""
    lines = np.array([line for line in LINES if line < 0.05 / motion.period])
    samples = motion.samples(1.0)
    signal = np.tile(multisine(lines, 1.0 / lines, samples, motion.period, rng), 4)
    seconds = times(len(signal), motion.period)
    signal = np.asarray(signal * smooth_step(2.0 * seconds) * smooth_step(2.0 * (4.0 - seconds)))
    size = min(
        1.5 * motion.usual_speed / _peak_speed(motion, signal),
        0.9 * motion.hardest / _peak_acceleration(motion, signal),
        motion.travel / float(np.abs(signal).max()),
    )
    return np.asarray(signal * size, dtype=np.float64)


def point_to_point(motion: Motion) -> Floats:
    """Fast moves with hard acceleration over distances from a tenth to several of his amplitudes."""
    path = _path(motion)
    reach = min(30.0 * motion.amplitude, motion.travel)
    for part in (0.1, -0.05, 0.4, -0.4, 1.0, -1.0, 0.02, -0.02, 0.7, 0.0):
        path.move(part * reach, motion.top_speed, motion.hardest).dwell(0.1)
    return path.positions()


def mixture(motion: Motion, rng: np.random.Generator, seconds: float) -> Floats:
    """A bit of everything, drawn at random: moves, rests, sines that no other trajectory has."""
    slow, fast = 0.1 * motion.usual_speed, min(9.0 * motion.usual_speed, motion.top_speed)
    pieces = [_random_sine(motion, rng), _random_moves(motion, rng, slow), _random_moves(motion, rng, fast)]
    left = motion.samples(seconds) - sum(len(piece) for piece in pieces)
    for _ in range(MIXTURE_DRAWS):
        speed = motion.usual_speed * float(np.exp(rng.uniform(math.log(0.05), math.log(8.0))))
        piece = _random_sine(motion, rng) if rng.random() < 0.3 else _random_moves(motion, rng, speed)
        if len(piece) <= left:
            pieces.append(piece)
            left -= len(piece)
    return np.concatenate(pieces)


def _random_sine(motion: Motion, rng: np.random.Generator) -> Floats:
    amplitude = motion.amplitude * float(np.exp(rng.uniform(math.log(0.02), math.log(2.0))))
    frequency = motion.frequency * float(rng.uniform(0.6, 2.5))
    return sine(motion, min(amplitude, motion.travel), frequency, float(rng.uniform(1.0, 2.0)))


def _random_moves(motion: Motion, rng: np.random.Generator, speed: float) -> Floats:
    """A few moves between random places, with rests, and back to the centre."""
    path, speed = _path(motion), min(speed, motion.top_speed)
    for _ in range(int(rng.integers(2, 4))):
        reach = min(speed * float(rng.uniform(0.2, 0.7)), 15.0 * motion.amplitude, motion.travel)
        target = reach * float(rng.choice([-1.0, 1.0]))
        path.move(target, speed, float(rng.uniform(0.3, 1.0)) * motion.hardest)
        path.dwell(float(rng.uniform(0.02, 0.6)))
    return path.move(0.0, max(speed, 0.5 * motion.usual_speed)).dwell(0.05).positions()


def _path(motion: Motion) -> Path:
    return Path(motion, 0.0)


def _revolution(motion: Motion) -> float:
    return motion.revolution or motion.travel / 2.0


def _possible(motion: Motion, amplitude: float, frequency: float) -> float:
    """The frequency, lowered where speed or acceleration would be too high."""
    fastest = min(motion.top_speed / amplitude, math.sqrt(0.5 * motion.hardest / amplitude)) / (2.0 * math.pi)
    return min(frequency, fastest)


def _peak_speed(motion: Motion, positions: Floats) -> float:
    return float(np.abs(np.diff(positions)).max()) / motion.period


def _peak_acceleration(motion: Motion, positions: Floats) -> float:
    return float(np.abs(np.diff(positions, 2)).max()) / motion.period**2
