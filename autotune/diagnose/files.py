"""Diagnosis for the command line, the library and the run: only on recordings of the model's own axis."""

from __future__ import annotations

from collections.abc import Sequence

from autotune.diagnose.baseline import quiet
from autotune.diagnose.candidates import Progress
from autotune.diagnose.compare import check_same_axis
from autotune.diagnose.verdict import Diagnosis, diagnose
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording


def diagnose_recordings(
    recordings: Sequence[Recording], model: DriveModel, progress: Progress = quiet
) -> Diagnosis:
    """The verdict on a model."""
    check_same_axis(model, recordings)
    return diagnose(recordings, model, progress)
