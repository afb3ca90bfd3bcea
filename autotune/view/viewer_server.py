"""The Rerun server as a process of its own, bound to this host only, with bounded memory.

A viewer that stops reading is never dropped by the server, whose memory then grows; here that hits a
process that can be replaced, and neither the run nor its files.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import importlib.util
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from autotune.core.errors import ConfigurationError

HOST = "127.0.0.1"
PORT = 9876
WEB_PORT = 9090
MEMORY_MB = 16
"""Of it the server keeps three quarters: 12 MB hold more than the last minute of 20 signals at 1 kHz (9.6 MB)."""
MOST_GROWTH = 3.0
"""Times its limit that its memory may grow, 48 MB: with its own bookkeeping it takes about twice the limit."""
START_SECONDS = 15.0
WINDOW = ("--bind", HOST, "--memory-limit", "1GB")


def quiet_environment() -> Mapping[str, str]:
    """Environment in which Rerun neither reports usage nor writes more than errors."""
    return {**os.environ, "CI": "1", "RUST_LOG": "error"}


def quiet() -> None:
    """The same for this process; to be called before rerun is imported."""
    for name, value in (("CI", "1"), ("RUST_LOG", "error")):
        os.environ.setdefault(name, value)


def is_free(port: int) -> bool:
    """Whether nobody listens on this port of this host (a server that cannot bind only logs it)."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True


def choose_port(wanted: int | None, usual: int) -> int:
    """The port asked for, or the usual one, or any that is free.

    Raises:
        ConfigurationError: the port asked for is taken.
    """
    if wanted is not None:
        if not is_free(wanted):
            raise ConfigurationError(
                f"port {wanted} of {HOST} is taken, so the viewer's server cannot use it; "
                "close what listens there, or leave the port out and a free one is chosen"
            )
        return wanted
    return usual if is_free(usual) else any_port()


def any_port() -> int:
    """A port of this host that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


def rerun_binary() -> str:
    """Path of Rerun's program.

    Raises:
        ConfigurationError: it is not installed.
    """
    found = importlib.util.find_spec("rerun_cli")
    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    for folder in (found.submodule_search_locations or ()) if found else ():
        if (program := Path(folder) / name).is_file():
            return str(program)
    if program_on_path := shutil.which("rerun"):
        return program_on_path
    raise ConfigurationError("the Rerun viewer is not installed; install it with 'pip install rerun-sdk'")


def check_viewer() -> None:
    """Raises ConfigurationError where the viewer is missing, broken, or of another version than the library."""
    binary = rerun_binary()
    ours = library_version()
    try:
        told = subprocess.run(
            [binary, "--version"], capture_output=True, text=True, timeout=START_SECONDS, check=True,
            env=dict(quiet_environment()),
        ).stdout  # fmt: skip
    except (OSError, subprocess.SubprocessError) as error:
        raise ConfigurationError(
            f"the Rerun viewer {binary} cannot be run ({error}); install it again with "
            "'pip install --force-reinstall rerun-sdk'"
        ) from error
    found = re.search(r"(\d+)\.(\d+)\.(\d+)", told)
    theirs = tuple(int(part) for part in found.groups()) if found else ()
    if theirs != ours:
        raise ConfigurationError(
            f"the Rerun viewer {binary} is of version {'.'.join(map(str, theirs)) or 'unknown'}, the library of "
            f"{'.'.join(map(str, ours))}; they must be the same: 'pip install rerun-sdk=={'.'.join(map(str, ours))}'"
        )


def library_version() -> tuple[int, ...]:
    """Version of the library that writes and streams.

    Raises:
        ConfigurationError: it is not installed.
    """
    try:
        text = importlib.metadata.version("rerun-sdk")
    except importlib.metadata.PackageNotFoundError:
        raise ConfigurationError(
            "the Rerun viewer is not installed; install it with 'pip install rerun-sdk'"
        ) from None
    return tuple(int(part) for part in re.findall(r"\d+", text)[:3])


class ViewerServer:
    """One server process; `restart` replaces it on the same ports, so that viewers find it again.

    `files`: what it serves from the beginning.
    """

    def __init__(
        self, port: int, web_port: int | None, memory_mb: int = MEMORY_MB, files: Sequence[str] = ()
    ) -> None:
        self.port = port
        self._files = tuple(files)
        self.web_port = web_port
        self._memory_mb = memory_mb
        self._process: subprocess.Popen[bytes] | None = None
        self._first_mb = 0.0

    @property
    def url(self) -> str:
        """Where viewers and streams connect."""
        return f"rerun+http://{HOST}:{self.port}/proxy"

    @property
    def page(self) -> str | None:
        """Address of the viewer in a browser."""
        if self.web_port is None:
            return None
        return f"http://{HOST}:{self.web_port}/?url=rerun%2Bhttp%3A%2F%2F{HOST}%3A{self.port}%2Fproxy"

    @property
    def pid(self) -> int:
        return self._process.pid if self._process else 0

    def start(self) -> None:
        """Starts the server and waits until it listens.

        Raises:
            ConfigurationError: it ended, or does not listen in time.
        """
        mode = (
            ["--serve-grpc"]
            if self.web_port is None
            else ["--serve-web", f"--web-viewer-port={self.web_port}"]
        )
        self._process = subprocess.Popen(
            [rerun_binary(), *mode, "--bind", HOST, "--port", str(self.port), *self._limits(), *self._files],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=dict(quiet_environment()),
        )
        end = time.monotonic() + START_SECONDS
        while not self._listens():
            if self._process.poll() is not None or time.monotonic() > end:
                self.kill()
                raise ConfigurationError(
                    f"the viewer's server does not start on {HOST}:{self.port}; "
                    "try another port, or run without --view"
                )
            time.sleep(0.05)
        self._first_mb = own_memory_mb(self.pid)

    def alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def too_large(self) -> bool:
        """Whether its memory has grown far above its limit: a viewer hangs and the server keeps data for it."""
        return own_memory_mb(self.pid) - self._first_mb > MOST_GROWTH * self._memory_mb

    def restart(self) -> None:
        """Kills the server, whatever state it is in, and starts another on the same ports."""
        self.kill()
        end = time.monotonic() + 3.0
        while not is_free(self.port) and time.monotonic() < end:
            time.sleep(0.05)
        self.start()

    def kill(self) -> None:
        """Ends the server at once; also one that is suspended. Idempotent."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def _limits(self) -> list[str]:
        return ["--server-memory-limit", f"{self._memory_mb}MB"]

    def _listens(self) -> bool:
        """Whether our process, and no other program on its ports, listens: for what is logged, and for browsers."""
        ports = [port for port in (self.port, self.web_port) if port is not None]
        if Path("/proc/net/tcp").exists():
            return all(_is_listener(self.pid, port) for port in ports)
        return not any(map(is_free, ports))


def open_window(url: str) -> subprocess.Popen[bytes] | None:
    """Opens the native viewer on this screen, which outlives the run; None where there is no screen.

    `url`: of a server, or the path of a file.
    """
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return None
    return subprocess.Popen(
        [rerun_binary(), *(["--connect", url] if "://" in url else ["--port", "auto", url]), *WINDOW],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=dict(quiet_environment()),
        start_new_session=True,
    )


def _is_listener(pid: int, port: int) -> bool:
    sockets = set()
    for descriptor in Path(f"/proc/{pid}/fd").glob("*"):
        with contextlib.suppress(OSError):
            sockets.add(os.readlink(descriptor))
    lines = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = [f for f in lines if f[3] == "0A" and f[1].endswith(f":{port:04X}")]
    return any(f"socket:[{fields[9]}]" in sockets for fields in listening)


def own_memory_mb(pid: int) -> float:
    """Memory of a process that is not a file's (the viewer that it serves to a browser is one of 43 MB)."""
    try:
        resident, shared = Path(f"/proc/{pid}/statm").read_text().split()[1:3]
    except (OSError, ValueError):
        return 0.0
    return (int(resident) - int(shared)) * os.sysconf("SC_PAGE_SIZE") / 1e6
