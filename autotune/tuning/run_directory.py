"""`runs/<time>-<axis>/`: what a run leaves, and the lock that lets one run at a time have an axis."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from autotune.core.errors import ConfigurationError
from autotune.core.loop import Loop
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Recording
from autotune.tuning.files import file_lock, stamp_after
from autotune.tuning.journal import FILES as JOURNALS
from autotune.tuning.journal import Journal
from autotune.tuning.results import run_folders


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


def discard_unused(directory: Path) -> None:
    """Removes the folder of a run that never had the axis: nobody is to look into it for what was not done.

    A folder that holds anything but its journal stays.
    """
    recordings = directory / "recordings"
    with suppress(OSError):  # a folder too many harms nobody
        if {path.name for path in directory.iterdir()} <= {*JOURNALS, recordings.name}:
            recordings.rmdir()
            for name in JOURNALS:
                (directory / name).unlink(missing_ok=True)
            directory.rmdir()


class Opening:
    """Opens a link, and knows whether that has ever succeeded."""

    def __init__(self, open_loop: Callable[[], Loop]) -> None:
        self._open_loop = open_loop
        self.done = False

    def __call__(self) -> Loop:
        loop = self._open_loop()
        self.done = True
        return loop

    def failed(self, journal: Journal) -> bool:
        """Nothing was reached, and nothing can have been left on a drive."""
        return not self.done and not journal.state.left_something


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
