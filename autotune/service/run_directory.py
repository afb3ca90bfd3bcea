"""`runs/<time>-<axis>/`: what a run leaves, and the lock that lets one run at a time have an axis."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from autotune.core.errors import ConfigurationError
from autotune.core.recording import Recording
from autotune.core.recording_files import write_recording
from autotune.service.files import file_lock, stamp_after
from autotune.service.results import run_folders


def make_run_directory(runs: Path, axis: str, now: datetime) -> Path:
    """Makes the folder of a run. The folders of an axis sort by name in the order in which they were made.

    Raises:
        ConfigurationError: the folder cannot be made.
    """
    there = [path.name for path in run_folders(runs, axis)]
    directory = runs / f"{stamp_after(there, now)}-{axis}"
    try:
        (directory / "recordings").mkdir(parents=True)
    except OSError as error:
        raise ConfigurationError(
            f"the run's folder {directory} cannot be made ({error.strerror}); choose another with --runs"
        ) from error
    return directory


def save_recording(directory: Path, name: str, recording: Recording) -> Path:
    """Writes one stage's recording as Parquet; returns where."""
    path = directory / "recordings" / f"{name}.parquet"
    write_recording(recording, path)
    return path


@contextmanager
def axis_lock(runs: Path, axis: str) -> Iterator[None]:
    """Holds the axis for this process; the lock goes with the process, however it ends.

    Raises:
        ConfigurationError: another process has the axis.
    """
    taken = f"axis {axis} is being tuned by process {{owner}}; wait until it has ended"
    with file_lock(runs / f".{axis}.lock", unusable="choose another with --runs", taken=taken):
        yield
