"""The npm peer as a process: found or fetched once into a cache, and spoken to in frames."""

from __future__ import annotations

import os
import select
import shutil
import subprocess
import time
from functools import cache
from pathlib import Path

import pytest

from autotune_drivers.canopen.frames import Frame

VERSION = "6.2.1"
SCRIPT = Path(__file__).with_name("canopen_peer.js")


@cache
def modules() -> Path:
    """Folder with `node_modules/canopen`; fetched into the user's cache where npm can.

    Skips the test by name where Node.js is missing or nothing can be fetched.
    """
    if shutil.which("node") is None:
        pytest.skip("independent CANopen peer: Node.js is not installed here")
    home = os.environ.get("AUTOTUNE_PEER_CACHE") or str(Path.home() / ".cache" / "autotune-peers")
    folder = Path(home) / f"canopen-{VERSION}"
    if not (folder / "node_modules" / "canopen" / "package.json").is_file():
        _fetch(folder)
    return folder / "node_modules"


def _fetch(folder: Path) -> None:
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("independent CANopen peer: npm is not installed here")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        command = [npm, "install", "--prefix", str(folder), f"canopen@{VERSION}"]
        options = ["--ignore-scripts", "--no-audit", "--no-fund", "--no-save"]
        done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=120, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"independent CANopen peer: npm cannot fetch it ({error})")
    if done.returncode:
        pytest.skip(f"independent CANopen peer: npm cannot fetch it (exit code {done.returncode})")


class Peer:
    """The process as a `FrameLink`; lines that are answers and not frames are in `answers`."""

    name = "npm canopen"
    hint = "the peer's process runs"

    def __init__(self, *arguments: str) -> None:
        environment = {**os.environ, "NODE_PATH": str(modules())}
        self.answers: list[str] = []
        self._rest = b""
        self.process = subprocess.Popen(
            ["node", str(SCRIPT), *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
        )

    def send(self, *frames: Frame) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(b"".join(b"%x %s\n" % (cob, data.hex().encode()) for cob, data in frames))
        self.process.stdin.flush()

    def receive(self, timeout: float) -> list[Frame]:
        assert self.process.stdout is not None
        if not select.select([self.process.stdout], [], [], max(timeout, 0.0))[0]:
            return []
        data = os.read(self.process.stdout.fileno(), 65536)
        *lines, self._rest = (self._rest + data).split(b"\n")
        return [frame for line in lines if (frame := self._frame(line.decode())) is not None]

    def _frame(self, line: str) -> Frame | None:
        if line.startswith("="):
            self.answers.append(line[1:])
            return None
        cob, _, data = line.partition(" ")
        return int(cob, 16), bytes.fromhex(data)

    def wait_for_words(self, seconds: float = 20.0) -> None:
        """Until it has said something: Node.js takes its time to start."""
        end = time.monotonic() + seconds
        while not self.receive(0.2):
            assert time.monotonic() < end, "the peer says nothing"

    def close(self) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()
