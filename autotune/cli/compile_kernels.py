"""`make install`: compiles the kernels once, so that no program after it waits for them.

numba keeps what it compiles beside the sources. Without this step the first program to need a kernel compiles it,
about a minute in all; programs that start together would each do so.
"""

from __future__ import annotations

import math

import numpy as np

import autotune
from autotune.cli.output import say
from autotune.control.adaptation import AdaptiveFeedforward, Bounds
from autotune.control.closed_loop import steady_error
from autotune.control.feedforward import FixedFeedforward, LugreParameters, feedforward_along
from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.twin import follow
from autotune.control.structures import laws, structure
from autotune.core.paths import config_directory
from autotune.identify.dahl import dahl_curve
from autotune.models.kinetic import KineticAxis, pulled
from autotune.recordings.recording import Controller
from autotune_sim.inertial_drive import InertialDrive

PERIOD, FREQUENCY = 1e-3, 10.0
LUGRE = LugreParameters(7e-4, 4e-3, 0.3, 30.0, 0.05, 0.05, 0.35, 0.3)
GAINS = (16.0, 0.02, 1000.0)


def main() -> None:
    """Calls every kernel as programs do, on little data."""
    say("compiling the kernels, about a minute …")
    model = _simulated_and_fitted()
    _controlled()
    _compared(model)
    _others()


def _simulated_and_fitted() -> autotune.DriveModel:
    """The simulated drive, its recording, and everything that fits and judges one; the model fitted."""
    recording = autotune.simulate("sim://edm-vertical", programme="high-speed")
    model = autotune.fit(recording).model
    if model is None:
        raise autotune.AutotuneError("the simulated axis was not identified: this installation is broken")
    autotune.diagnose(recording, model)
    return model


def _controlled() -> None:
    """Feedforward, its adaptation, and the loop that refines it."""
    time = PERIOD * np.arange(round(1.0 / (FREQUENCY * PERIOD)))
    omega = 2.0 * math.pi * FREQUENCY
    reference = 0.01 * np.sin(omega * time)
    torque = feedforward_along(LUGRE, np.gradient(reference, PERIOD), -(omega**2) * reference, PERIOD)
    steady_error(LUGRE, Controller(*GAINS), reference, torque, PERIOD)
    FixedFeedforward(LUGRE, PERIOD).prepare()
    bounds = Bounds.around(LUGRE, (LUGRE.stiffness / 2.0, LUGRE.stiffness * 2.0))
    AdaptiveFeedforward(LUGRE, bounds, FREQUENCY, PERIOD).prepare()


def _compared(model: autotune.DriveModel) -> None:
    """The loops that gains and control structures are judged in."""
    timing = LoopTiming(PERIOD, 1e-4, 1.34)
    gains = Gains(*GAINS)
    reference = np.zeros(20)
    own = structure.own_numbers(LUGRE, gains, timing)
    follow(model, gains, timing, reference)
    bench = structure.Bench(model, LUGRE, gains, timing, FREQUENCY, own)
    structure.run(structure.Structure("PID", laws.PID, structure.NONE), bench, model, timing, reference)


def _others() -> None:
    """Dahl's curve, kinetic friction, and the simulated machine of several bodies."""
    dahl_curve(np.linspace(0.0, 1e-3, 20), 30.0, 0.3, 1.0, 0.0)
    pulled(KineticAxis(7e-4, 4e-3, 0.3, 0.35, 0.3, 0.05), 1.0, 0.02, 1.0, 1e-3)
    InertialDrive(config_directory() / "machines" / "inertial-drive.toml").play(np.zeros(2))


if __name__ == "__main__":
    main()
