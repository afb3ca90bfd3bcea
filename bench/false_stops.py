"""Bench of the guard's false stops: random ordinary axes, sound in every part, play whole programmes.

    python -m bench.false_stops --seed 70000 --runs 140

Inertia over two decades, friction from 1 to 50 % of the torque limit, gravity, sticking, tight spots, torque ripple,
2 000 to 300 000 counts a revolution, controllers between a half and one and a half times the factory's, an axis
file that states half to all of the deceleration that there is. A third of the axes have one more thing that real ones
have: an elastic transmission, a lag of the torque, backlash, friction that falls with speed. Nothing fails on any of
them, so every stop is a false one, but for those where the axis really meets a limit (following error, torque).
One line an axis; the summary is at the end. Seeds below 70000 may be looked at.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.axis import Axis, read_axis
from autotune.core.errors import AutotuneError, GuardStop, NotEnoughExcitation
from autotune.experiments.programmes import Choices, build
from autotune.experiments.runner import Programme
from autotune_sim.inprocess import SimDrive
from autotune_sim.plant import Bristle, PlantParameters, Wave
from autotune_sim.presets import Gains, Preset
from autotune_sim.truth import Truth
from tests.support.identification_programme import AXIS

PROGRAMMES = ("benchmark", "steady-state", "dahl", "presliding", "high-speed")
MET = ("limits.following_error", "limits.torque", "limits.position", "limits.temperature")
"""What a stop names where the axis has truly met a limit, which is no false stop."""
_INERTIA = (1e-4, 5e-3)  # kg m²
_FRICTION = (0.01, 0.5)  # of the torque limit
_COUNTS = (2_000, 300_000)
_GAINS = (0.5, 1.5)
_REFERENCE = 6.66e-4  # kg m², that the factory's gains belong to
_EXTRAS = 0.33
_TORQUE = 1.34
_CYCLE = 1e-3
_SHAKE = 0.2  # of the torque limit, that one count may make
_NEAR = 0.7  # of the speed limit: a guard that looks two cycles ahead has met it


@dataclass(frozen=True)
class Stop:
    """How one axis ended: `what` is empty where it went through."""

    seed: int
    axis: str
    what: str
    blind: bool
    fast: float
    seconds: float

    @property
    def false(self) -> bool:
        """Stopped, and neither was a limit met nor did the axis nearly run at its limit of speed."""
        return (
            bool(self.what)
            and (self.blind or not any(name in self.what for name in MET))
            and self.fast < _NEAR
        )


def _log(random: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(np.exp(random.uniform(*np.log(bounds))))


def draw(seed: int) -> tuple[Preset, Axis]:
    """An axis and its file."""
    random = np.random.default_rng([seed, 72])
    inertia, friction = _log(random, _INERTIA), _TORQUE * _log(random, _FRICTION)
    counts = round(_log(random, _COUNTS))
    plant = PlantParameters(
        inertia=inertia,
        viscous=_log(random, (0.002, 0.03)) * _TORQUE,
        offset=float(random.uniform(-0.15, 0.15)) * _TORQUE,
        bristle=Bristle(
            coulomb=friction,
            break_away=friction * float(random.uniform(1.0, 1.4)),
            velocity=_log(random, (0.05, 1.0)),
            stiffness=friction / _log(random, (0.5e-3, 10e-3)),
            damping=0.3 * math.sqrt(friction / 3e-3 * inertia),
        ),
        ripple=(Wave(float(random.integers(1, 80)), 0.02 * _TORQUE * float(random.uniform()), 1.0),),
        counts=counts,
        bump=float(random.uniform(0.0, 0.3)),
    )
    if random.uniform() < _EXTRAS:
        plant = _extra(plant, random)
    share = float(random.uniform(*_GAINS))
    factory, factor = Gains(), inertia / _REFERENCE
    # as fast as the encoder allows: a count must not shake the axis
    slower = min(_SHAKE * _TORQUE * _CYCLE / (share * factor * factory.kd * 2.0 * math.pi / counts), 1.0)
    gains = Gains(
        factor * share * factory.kp * slower**2,
        factor * share * factory.kd * slower,
        factor * share * factory.ki * slower**3,
    )
    axis = _file(inertia, counts, random)
    return Preset("random", plant, gains, period=axis.cycle, seed=seed), axis


def _extra(plant: PlantParameters, random: np.random.Generator) -> PlantParameters:
    size, what = float(random.uniform(0.3, 1.0)), int(random.integers(0, 3))
    if what == 0:
        return replace(plant, lag=0.5e-3 * size)
    if what == 1:
        share = {"load_inertia": 0.3 * size, "load_friction": 0.2}
        return replace(
            plant, transmission_stiffness=plant.inertia * (2.0 * math.pi * 60.0 / size) ** 2, **share
        )
    return replace(plant, asymmetry=0.15 * size)


def _file(inertia: float, counts: int, random: np.random.Generator) -> Axis:
    """The axis file of somebody who knows his machine."""
    axis = read_axis(AXIS)
    able = min(_TORQUE / inertia, 2000.0)
    limits = axis.limits.model_copy(
        update={
            "torque": _TORQUE,
            "speed": float(random.uniform(12.0, 20.0)),
            "deceleration": able * float(random.uniform(0.3, 0.8)),
            "machine_seconds": 1000.0,
        }
    )
    mechanics = axis.mechanics.model_copy(update={"counts_per_revolution": counts})
    return axis.model_copy(update={"limits": limits, "mechanics": mechanics})


def play(seed: int) -> Stop:
    """One axis through all programmes, as one session."""
    began = time.process_time()
    preset, axis = draw(seed)
    plant = preset.plant
    friction = plant.bristle.coulomb if plant.bristle is not None else 0.0
    told = (
        f"J {plant.inertia:.2e} F {friction / _TORQUE:.3f} counts {plant.counts} gains "
        f"{preset.gains.kp / (60.0 * plant.inertia / _REFERENCE):.2f} lag {plant.lag:.1e} elastic "
        f"{plant.transmission_stiffness:.3g}"
    )
    what, blind, fast = "", False, 0.0
    try:
        drive = SimDrive(preset, seed)
        drive.keep_truth(truth := Truth(capacity=1024))
        learnt = None
        for name in PROGRAMMES:
            experiments = build(name, axis, Choices(seed=seed, centre=0.0))
            learnt = Programme(experiments, axis.limits, 1000.0, learnt)(drive, lambda *_: None).learnt
    except NotEnoughExcitation:
        pass  # an axis that cannot be excited is told, not stopped
    except GuardStop as stop:
        what, blind = str(stop), stop.blind
        fast = float(np.max(np.abs(truth.rows()["velocity"]), initial=0.0)) / axis.limits.speed
    except AutotuneError as error:
        told += f" [{type(error).__name__}: {str(error)[:80]}]"
    return Stop(seed, told, what, blind, fast, time.process_time() - began)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=60_000)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--case", type=int, nargs="+", metavar="SEED", help="these alone")
    options = parser.parse_args()
    stops = []
    for seed in options.case or range(options.seed, options.seed + options.runs):
        stops.append(one := play(seed))
        said = f"{'FALSE' if one.false else 'limit'}: {one.what}" if one.what else "through"
        sys.stdout.write(f"{one.seed} {one.axis} {one.seconds:.1f} s: {said}\n")
        sys.stdout.flush()
    false, met = sum(one.false for one in stops), sum(bool(one.what) and not one.false for one in stops)
    sys.stdout.write(f"\n{len(stops)} axes: {false} stopped falsely, {met} at a limit that they met\n")
    return int(false > 0)


if __name__ == "__main__":
    sys.exit(main())
