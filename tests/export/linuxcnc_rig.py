"""LinuxCNC without a screen: two simulated axes, its own pid, the exported components; what it logs.

Components are installed as a user's are (`halcompile --install`), under names of their own, and taken away again.
LinuxCNC does not run as root: it is started as `nobody` then.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.export.request import Request
from autotune.export.targets import export
from autotune.models.drive_model import DriveModel

HERE = Path(__file__).with_name("linuxcnc")
MODULES = Path("/usr/lib/linuxcnc/modules")
AXES = "autotune_test_axes"
SECONDS = 100.0
NOBODY = 65534
BINS = 180
"""Of half a turn: at one turn a second about three samples each."""


def needs_linuxcnc() -> None:
    """Skips where LinuxCNC is not installed, or its components cannot be."""
    for program, package in (("linuxcnc", "linuxcnc-uspace"), ("halcompile", "linuxcnc-uspace-dev")):
        if shutil.which(program) is None:
            pytest.skip(f"{package} is not installed: make linuxcnc")
    if not os.access(MODULES, os.W_OK):
        pytest.skip(f"components cannot be installed: {MODULES} is not ours to write")


@contextmanager
def alone() -> Iterator[None]:
    """There is one HAL on a host: waits for others of these tests; skips where somebody's LinuxCNC runs."""
    path = Path(tempfile.gettempdir()) / f"autotune-linuxcnc-{os.getuid()}.lock"
    with path.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        running = subprocess.run(
            ["pgrep", "-x", "rtapi_app|linuxcnc"], capture_output=True, text=True, check=False
        )
        if running.stdout:
            pytest.skip("a LinuxCNC runs on this host already")
        yield


def end_realtime(fifo: str) -> None:
    """Ends the rtapi_app that was started with this RTAPI_FIFO_PATH, should it have outlived its halrun."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (folder / "comm").read_text().strip() != "rtapi_app":
                continue
            if f"RTAPI_FIFO_PATH={fifo}".encode() in (folder / "environ").read_bytes().split(b"\0"):
                os.kill(int(folder.name), signal.SIGTERM)


@contextmanager
def rig(models: dict[str, DriveModel]) -> Iterator[Path]:
    """A folder with the configuration, and components autotune_test_NAME of the models, installed meanwhile."""
    folder = Path(tempfile.mkdtemp(prefix="autotune-linuxcnc-"))
    installed = [MODULES / f"{name}.so" for name in (AXES, *(f"autotune_test_{name}" for name in models))]
    try:
        shutil.copytree(HERE, folder, dirs_exist_ok=True)
        (folder / "rig.tbl").write_text("T1 P1 D0.0 ;none\n")
        for name, model in models.items():
            request = Request(model, "a model", 1e-3, torque_limit=1.34, name=f"autotune_test_{name}")
            for file, content in export(request, "linuxcnc").files.items():
                (folder / file).write_bytes(content)
        for library in installed:
            done = subprocess.run(
                ["halcompile", "--install", f"{library.stem}.comp"], cwd=folder, capture_output=True, text=True,
                check=False,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
            assert "warning" not in done.stderr, done.stderr
        _to_anybody(folder)
        yield folder
    finally:
        for library in installed:
            library.unlink(missing_ok=True)
        shutil.rmtree(folder, ignore_errors=True)


def _to_anybody(folder: Path) -> None:
    folder.chmod(0o777)
    if os.getuid() == 0:
        for path in (folder, *folder.rglob("*")):
            os.chown(path, NOBODY, NOBODY)


def run_circles(folder: Path, *seeds: int) -> None:
    """Runs circles.py in LinuxCNC; leaves samples.txt and axes.npy."""
    server = subprocess.Popen(
        [sys.executable, str(HERE / "axes.py"), "axes.sock", *map(str, seeds)],
        cwd=folder, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert server.stdout is not None
        assert server.stdout.readline() == "listening\n"
        _linuxcnc(folder)
        assert server.wait(timeout=20) == 0
    finally:
        server.kill()
        server.wait()
        if server.stdout is not None:
            server.stdout.close()


def _linuxcnc(folder: Path) -> None:
    """LinuxCNC to its end; `script` gives it the terminal that it asks for."""
    plain = "setpriv --reuid=65534 --regid=65534 --clear-groups " if os.getuid() == 0 else ""
    environment = {"HOME": str(folder), "PATH": "/usr/local/bin:/usr/bin:/bin", "LANG": "C.UTF-8"}
    command = ["script", "-qec", f"{plain}linuxcnc rig.ini", "/dev/null"]
    with (folder / "linuxcnc.log").open("w") as log:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
            start_new_session=True,
        )  # fmt: skip
        try:
            code = process.wait(timeout=SECONDS)
        except subprocess.TimeoutExpired:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, 15)
            process.wait(timeout=20)
            code = -1
    assert code == 0, (folder / "linuxcnc.log").read_text()[-2000:]


def turns(reference: Floats, velocity: Floats, rate: float) -> tuple[Floats, Floats]:
    """Rows of the last whole turns at a rate [rad/s of the circle], half a turn in at least, and their angles.

    `reference` and `velocity` of shape (n, 2).
    """
    fast = np.hypot(*velocity.T)
    circle = np.abs(np.hypot(*reference.T) - 1.0) < 0.02
    rows = np.flatnonzero(circle & (np.abs(fast - rate) < 0.02 * rate))
    angle = np.unwrap(np.arctan2(reference[rows, 1], reference[rows, 0]))
    gone = np.abs(angle - angle[0])
    whole = np.floor(gone.max() / (2.0 * np.pi) - 0.5)
    late = gone >= gone.max() - whole * 2.0 * np.pi
    return rows[late], angle[late]


def glitch(error: Floats, angle: Floats) -> float:
    """Peak of the error averaged over turns and over the two reversals of a turn, whose errors have opposite signs.

    `error` and `angle` of shape (n,).
    """
    half = np.mod(angle, np.pi) / np.pi
    place = np.minimum((half * BINS).astype(int), BINS - 1)
    sign = np.where(np.mod(angle, 2.0 * np.pi) < np.pi, 1.0, -1.0)
    sums = np.bincount(place, sign * error, BINS)
    return float(np.max(np.abs(sums / np.bincount(place, minlength=BINS))))
