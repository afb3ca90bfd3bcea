"""The programme that decides between effects which the recordings so far cannot tell apart: a minute at most.

Every set of effects that look alike (`models.look_alikes`) has trajectories of its own, in which their torques part.
They are played twice, in two rounds, so that what repeats can be told from noise; a mixture that nothing is fitted on
comes last, twice, so that a name can be confirmed. Sizes follow the user's motion and the limits of the axis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.experiments.diagnosis import (
    Trajectory,
    conditioning,
    mixture,
    point_to_point,
    sine,
    sweep,
)
from autotune.experiments.experiment import Experiment
from autotune.experiments.path import Motion, Path
from autotune.models import look_alikes
from autotune.models.look_alikes import LookAlikes
from autotune.models.table import EFFECTS, looking_alike
from autotune.recordings.recording import CONDITIONING

LONGEST = 60.0
"""The whole programme [s]."""
ROUNDS = 2
GATE_SECONDS = 6.0
"""Of the mixture, each time [s]."""
WAY_SECONDS = 2.0
"""Kept for the way to the centre and back [s]."""
SLOW, USUAL, FAST = 0.1, 1.0, 3.0  # of the user's peak speed
RESTS = (0.05, 0.15, 0.45, 1.0, 2.0)  # s
LOOPS = (0.3, 0.1, 0.035, 0.012)  # of the user's amplitude

Draw = Callable[[Motion, float, np.random.Generator], Floats]
"""Positions round the centre in about so many seconds, from rest to rest."""


def _scan(part: float) -> Draw:
    """Once forth and back over all the way that speed and time allow."""

    def draw(motion: Motion, seconds: float, _: np.random.Generator) -> Floats:
        speed = min(part * motion.usual_speed, motion.top_speed)
        reach = min(motion.travel, speed * seconds / 4.0)
        path = Path(motion, 0.0)
        return path.move(reach, speed).move(-reach, speed).move(0.0, speed).positions()

    return draw


def _speeds(motion: Motion, seconds: float, _: np.random.Generator) -> Floats:
    """Both directions at five speeds over a decade and a half, as far as the limits go."""
    path = Path(motion, 0.0)
    for speed in np.geomspace(SLOW * motion.usual_speed, min(4.0 * motion.usual_speed, motion.top_speed), 5):
        reach = min(float(speed) * seconds / 20.0, motion.travel)
        path.move(reach, float(speed)).move(-reach, float(speed)).move(0.0, float(speed))
    return path.positions()


def _loops(motion: Motion, seconds: float, _: np.random.Generator) -> Floats:
    """Loops inside loops, ever smaller: what reversals remember."""
    path = Path(motion, 0.0)
    for part in LOOPS:
        reach = part * motion.amplitude
        speed = max(min(4.0 * reach * len(LOOPS) / seconds, 0.5 * motion.usual_speed), 1e-9)
        path.move(reach, speed).move(-reach, speed)
    return path.move(0.0).positions()


def _small_sines(motion: Motion, seconds: float, _: np.random.Generator) -> Floats:
    """Inside presliding and just out of it."""
    parts = (0.006, 0.02, 0.06)
    frequency = max(2.0 * motion.frequency, 2.0 * len(parts) / seconds)
    return np.concatenate(
        [sine(motion, part * motion.amplitude, frequency, seconds / len(parts)) for part in parts]
    )


def _rests(motion: Motion, _: float, rng: np.random.Generator) -> Floats:
    """Short moves with rests of 0.05 to 2 s between them, both directions, in random order."""
    path, way = Path(motion, 0.0), 0.5 * motion.amplitude
    for direction in (1.0, -1.0):
        for seconds in rng.permutation(RESTS):
            path.dwell(float(seconds)).move(direction * way, speed=0.5 * motion.usual_speed)
            direction = -direction
    return path.move(0.0).positions()


def _triangles(motion: Motion, seconds: float, _: np.random.Generator) -> Floats:
    """Slow, without any rest."""
    path, speed = Path(motion, 0.0), SLOW * motion.usual_speed
    reach = min(speed * seconds / 8.0, motion.travel)
    for target in (reach, -reach, reach, -reach, 0.0):
        path.move(target, speed)
    return path.positions()


def _hard(motion: Motion, _: float, rng: np.random.Generator) -> Floats:
    del rng
    return point_to_point(motion)


def _quick(motion: Motion, _: float, rng: np.random.Generator) -> Floats:
    return sweep(motion, rng)


def _warm(motion: Motion, seconds: float, _: np.random.Generator) -> Floats:
    """Brisk motion that heats: what time changes, changes faster after it."""
    path, speed = Path(motion, 0.0), min(FAST * motion.usual_speed, motion.top_speed)
    reach = min(motion.travel, speed)
    way = max(round(seconds * speed / (4.0 * reach)), 1)
    for _once in range(way):
        path.move(reach, speed).move(-reach, speed)
    return path.move(0.0, speed).positions()


TRAJECTORIES: Mapping[LookAlikes, Mapping[str, Draw]] = MappingProxyType(
    {
        look_alikes.IN_PLACE: {"slow_scan": _scan(USUAL), "scan": _scan(FAST)},
        look_alikes.IN_A_PART_OF_A_TURN: {"slow_scan": _scan(USUAL), "scan": _scan(FAST)},
        look_alikes.IN_SPEED: {"speeds": _speeds, "moves": _hard, "multisine": _quick},
        look_alikes.IN_TORQUE: {"moves": _hard, "multisine": _quick},
        look_alikes.AT_REVERSALS: {"loops": _loops, "small_sines": _small_sines, "moves": _hard},
        look_alikes.IN_QUICK_MOTION: {"multisine": _quick, "moves": _hard},
        look_alikes.AT_STARTS: {"rests": _rests, "slow_triangles": _triangles},
        look_alikes.IN_TIME: {"slow_triangles": _triangles, "brisk": _warm, "slow_again": _triangles},
    }
)
"""Of each set: label to how it is drawn."""
EVERYTHING: Mapping[str, Draw] = MappingProxyType(
    {"loops": _loops, "speeds": _speeds, "scan": _scan(FAST), "multisine": _quick, "moves": _hard}
)
"""Where nothing is known of what may be missing."""


def trajectories_for(rivals: Sequence[str]) -> Mapping[str, Draw]:
    """What tells most pairs of these effects apart; of everything where no set holds two of them.

    Raises:
        ConfigurationError: one of them is no effect that there is.
    """
    for name in rivals:
        if name not in EFFECTS:
            raise ConfigurationError(f"there is no effect {name!r}; there are {', '.join(sorted(EFFECTS))}")
    wanted, chosen = set(rivals), dict[str, Draw]()
    sets = {one: effects & wanted for one, effects in looking_alike().items()}
    for one in sorted(sets, key=lambda one: -len(sets[one])):
        if len(sets[one]) > 1 or (len(wanted) == 1 and sets[one]):
            chosen |= TRAJECTORIES[one]
    return chosen or EVERYTHING


def deciding(motion: Motion, rivals: Sequence[str], rng: np.random.Generator) -> tuple[Experiment, ...]:
    """The programme that tells `rivals` apart, in the order played, at most `LONGEST` seconds.

    Args:
        rivals: effects, the likeliest first; none where nothing is known of what is missing.

    Raises:
        ConfigurationError: no such effect, or an axis so slow that nothing of it fits into the time.
    """
    warm = Trajectory(motion, CONDITIONING, conditioning(motion))
    unseen = mixture(motion, rng, GATE_SECONDS)
    gates = [Trajectory(motion, "veto", unseen, k) for k in range(ROUNDS)]
    left = LONGEST - WAY_SECONDS - sum(one.duration for one in (warm, *gates))
    wanted = trajectories_for(rivals)
    seconds = left / (ROUNDS * len(wanted))
    drawn = {label: draw(motion, 0.8 * seconds, rng) for label, draw in wanted.items()}
    rounds: list[Trajectory] = []
    for label, positions in drawn.items():
        both = [Trajectory(motion, label, positions, k) for k in range(ROUNDS)]
        if sum(one.duration for one in (*rounds, *both)) <= left:
            rounds += both
    if not rounds:
        raise ConfigurationError(
            f"no trajectory that decides fits into {LONGEST:g} s on this axis; record programme 'diagnosis' instead"
        )
    return (warm, *sorted(rounds, key=lambda one: one.repeat), *gates)
