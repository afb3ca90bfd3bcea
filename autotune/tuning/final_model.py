"""The final model against the benchmark as it was measured first, for the run's report.

The model runs in the loop that was recorded, its controller alone: nothing is fitted, and nothing of the feedforward
that the run has found is in either of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from autotune.core.axis import Benchmark
from autotune.core.errors import AutotuneError
from autotune.diagnosis.compare import simulate_closed_loop
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import read_model
from autotune.recordings.files import read_recording
from autotune.recordings.recording import Recording
from autotune.tuning.outcome import RunResult
from autotune.tuning.proof import fold
from autotune.view.data import Simulated
from autotune.view.report import Picture
from autotune.view.scale import quantity

BASELINE, BENCHMARK = "baseline", "benchmark"


def result_model(result: RunResult) -> DriveModel | None:
    """The model that the run has left; None where it has left none."""
    try:
        return read_model(result.run_directory / "model.toml")
    except AutotuneError:
        return None


def final_model_pictures(
    recordings: Sequence[Path],
    model: DriveModel | None,
    benchmark: Benchmark,
    *,
    diagnosed: bool = True,
    given: bool = False,
) -> list[Picture]:
    """Model against measurement on the benchmark; empty where either is missing, or the loop cannot be simulated.

    `diagnosed`: the run has come so far that its model is the final one; `given`: that is one that it was given.
    """
    from autotune.view import figures

    path = next((path for path in recordings if path.stem == BASELINE), None)
    if model is None or path is None:
        return []
    try:
        shown = simulated(read_recording(path), model, benchmark.frequency)
    except AutotuneError:
        return []
    if shown is None:
        return []
    left = float(np.sqrt(np.mean((shown.error.mean(axis=0) - shown.model_error) ** 2)))
    which, title = "final model", "Final model and measurement"
    if given:
        which, title = "model that was given", "The model that was given, and measurement"
    elif not diagnosed:
        which = "model as identified (the run did not come to its diagnosis)"
        title = "Model as identified, and measurement"
    caption = (
        "The benchmark before anything was changed: measured (mean, with the spread of its periods) and as the "
        f"{which} does it in the same loop. Below, the error round both reversals. The simulated error "
        f"differs from the measured one by {quantity(left, shown.motion_unit)} rms."
    )
    return [Picture(title, caption, figures.as_simulated(shown))]


def simulated(recording: Recording, model: DriveModel, frequency: float) -> Simulated | None:
    """One period of the benchmark, measured and simulated; None where the model does not follow.

    Raises:
        AutotuneError: the loop cannot be simulated.
    """
    window = recording.experiment == BENCHMARK
    samples = round(1.0 / (frequency * recording.period))
    if int(window.sum()) < samples or "reference" not in recording:
        return None
    loop = simulate_closed_loop(recording, model)
    if not np.isfinite(loop.position[window]).all():
        return None
    reference = recording["reference"][window]
    error, torque = reference - recording["position"][window], recording["torque"][window]
    model_error = reference - loop.position[window]
    return Simulated(
        np.asarray(np.arange(samples) * recording.period, dtype=np.float64),
        fold(reference, samples).mean(axis=0),
        fold(error, samples),
        fold(torque, samples),
        fold(model_error, samples)[-1],  # the first ones also hold how the simulation begins
        fold(loop.torque[window], samples)[-1],
        recording.metadata.motion_unit,
        recording.metadata.torque_unit,
    )
