"""The error of a model as the authors of the EMPS benchmark measure it."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, decimate, filtfilt

from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording


def authors_error(recording: Recording, model: DriveModel, held: bool = False) -> float:
    """Relative force error [%] as the authors of EMPS measure it: 100 Hz, differences, decimated by 10.

    `held`: the command acts from its sample to the next, so that what acts at a sample is the mean of two.
    """
    period = recording.period
    b, a = butter(4, 100 * 2 * period)
    position = filtfilt(b, a, recording["position"])
    velocity = np.gradient(position, period)
    acceleration = np.gradient(velocity, period)
    inner = slice(50, -50)
    predicted = model.torque(position, velocity, acceleration, period)[inner]
    command = recording["torque"]
    acted = 0.5 * (command + np.concatenate([command[:1], command[:-1]])) if held else command
    measured = acted[inner]
    error = decimate(measured, 10, zero_phase=True) - decimate(predicted, 10, zero_phase=True)
    return 100 * float(np.linalg.norm(error) / np.linalg.norm(decimate(measured, 10, zero_phase=True)))


def held_error(recording: Recording, model: DriveModel) -> float:
    """The authors' metric with the command held from sample to sample, as the drive does."""
    return authors_error(recording, model, held=True)
