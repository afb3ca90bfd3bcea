"""Opening what a run left: a folder of a run, a Rerun file, a recording; in a window, or for a browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from autotune.core.errors import AutotuneError, ConfigurationError, RecordingError
from autotune.recordings.files import read_recording
from autotune.recordings.recording import Recording, concatenate
from autotune.view import viewer_server
from autotune.view.rerun_file import Shown, write_rrd

RRD = b"RRF2"
RECORDINGS = (".parquet", ".csv")
BESIDE = (".html", ".json")
RUN_FILE = "run.rrd"


class Opened(NamedTuple):
    """A Rerun file. `temporary`: it is gone when the block ends."""

    path: Path
    temporary: bool = False


@contextmanager
def rerun_file(path: Path) -> Iterator[Opened]:
    """A Rerun file of what `path` is, for the time of the block: made where there is none yet.

    Raises:
        ConfigurationError: nothing there that could be shown, or a file of another version of the viewer.
        RecordingError: a recording that cannot be read.
    """
    if path.is_file() and path.suffix in BESIDE:
        path = path.parent
    if path.is_dir() and (path / RUN_FILE).is_file():
        path = path / RUN_FILE
    if path.is_dir():
        with _made(_recordings_of(path), path.name) as made:
            yield Opened(made, temporary=True)
    elif path.suffix == ".rrd":
        check_rrd(path)
        yield Opened(path)
    elif path.suffix in RECORDINGS:
        with _made([read_recording(path)], path.stem) as made:
            yield Opened(made, temporary=True)
    else:
        raise ConfigurationError(
            f"{path} cannot be shown: give the folder of a run, an .rrd file, a recording (.parquet or .csv), or an "
            "axis file (.toml) that a service looks after"
        )


def check_rrd(path: Path) -> None:
    """Raises ConfigurationError where `path` is no Rerun file, or one of a newer version than the viewer."""
    try:
        with path.open("rb") as file:
            head = file.read(8)
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be read: {error.strerror}") from error
    if len(head) < 8 or head[:4] != RRD:
        raise ConfigurationError(f"{path} is not a Rerun file; such a file begins with {RRD.decode()}")
    written, ours = (int(head[4]), int(head[5]), int(head[6])), viewer_server.library_version()
    if written[:2] > ours[:2]:
        raise ConfigurationError(
            f"{path} was written by Rerun {'.'.join(map(str, written))}, newer than the viewer here "
            f"({'.'.join(map(str, ours))}); update it with 'pip install -U rerun-sdk'"
        )


def show(file: Opened, browser: bool, ready: Callable[[str], None]) -> None:
    """Shows a Rerun file: in a window that stays, or, without a screen, for a browser until Ctrl-C.

    Args:
        browser: for a browser although there is a screen.
        ready: called with the page's address, "" for a window, once it is there.

    Raises:
        ConfigurationError: no viewer, one of another version, or it does not start.
    """
    viewer_server.check_viewer()
    window = None if browser else viewer_server.open_window(str(file.path.resolve()))
    if window is not None:
        ready("")
        if file.temporary:
            window.wait()
        return
    server = viewer_server.ViewerServer(
        viewer_server.choose_port(None, viewer_server.PORT),
        viewer_server.choose_port(None, viewer_server.WEB_PORT),
        memory_mb=2048,
        files=(str(file.path.resolve()),),
    )
    server.start()
    try:
        ready(server.page or server.url)
        while server.alive():
            time.sleep(0.2)
        raise ConfigurationError("the viewer's server has ended by itself; start 'autotune view' again")
    finally:
        server.kill()


def _recordings_of(folder: Path) -> list[Recording]:
    """The recordings of a run that was cut off, in the order in which they were made."""
    found = sorted((folder / "recordings").glob("*.parquet"), key=lambda path: path.stat().st_mtime_ns)
    if not found:
        raise ConfigurationError(
            f"{folder} has neither {RUN_FILE} nor recordings: it is not the folder of a run, or nothing was measured"
        )
    return [read_recording(path) for path in found]


@contextmanager
def _made(recordings: list[Recording], name: str) -> Iterator[Path]:
    with TemporaryDirectory(prefix="autotune-view-") as folder:
        path = Path(folder) / f"{name}.rrd"
        write_rrd(path, _in_sequence(recordings), Shown(verdict=f"# {name}"))
        yield path


def _in_sequence(recordings: list[Recording]) -> Recording:
    """One recording whose time goes on from part to part."""
    if len(recordings) == 1:
        return recordings[0]
    try:
        whole = concatenate(recordings)
    except AutotuneError as error:
        raise RecordingError(f"the recordings of this run cannot be shown together: {error}") from error
    time_s = np.asarray(np.arange(len(whole)) * whole.period, dtype=np.float64)
    columns = {**whole.floats, "time": time_s}
    return Recording.from_columns(columns, whole.metadata, whole.experiment, whole.repeat, whole.missed)
