"""The process that `forked.Program`s come from: it imports once what they all need, and becomes one for each request.

A request is one packet: the program, its arguments, folder and environment, and the three files it speaks through.
What it answers: the number of the process that was begun, and later how it ended.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import selectors
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from autotune.core.garbage import seldom_collected
from autotune.core.threads import one_thread

IMPORTED = (
    "autotune.cli.main",
    "autotune.cli.run",
    "autotune.cli.sim",
    "autotune.tuning.run",
    "scipy.signal",
)
LARGEST = 1 << 18
OF_THE_ALLOCATOR = {"jemalloc_bg_thd"}
"""Arrow's; the allocator begins it again in a process that was forked."""
USUAL: dict[int, Any] = {
    signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL, signal.SIGHUP: signal.SIG_DFL,
    signal.SIGCHLD: signal.SIG_DFL,
}  # fmt: skip


def main() -> None:
    """Serves until the tests are gone; in a process that was begun: is that program."""
    with socket.socket(fileno=int(sys.argv[1])) as line:
        program = _begun(line)
    if program is not None:
        os._exit(_ended(program))  # at once: to take every module down costs more than a whole run needs


def _ended(program: Callable[[], Any]) -> int:
    """Runs it to its end, with all that a program does before it leaves; its exit code."""
    try:
        code = program()
    except SystemExit as ending:
        code = ending.code
    except BaseException:  # noqa: BLE001 - as an interpreter does with what nobody has caught
        traceback.print_exc()
        code = 1
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon:
            thread.join()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    return int(code or 0)


def _begun(line: socket.socket) -> Callable[[], Any] | None:
    """The program that this process has become; None where the tests have ended."""
    one_thread()
    _import_all()
    heard, told = os.pipe()
    os.set_blocking(told, False)
    signal.set_wakeup_fd(told)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is for the tests, and they are told
    with selectors.DefaultSelector() as events:
        events.register(line, selectors.EVENT_READ)
        events.register(heard, selectors.EVENT_READ)
        while True:
            ready = [key.fileobj for key, _ in events.select()]
            if heard in ready:
                os.read(heard, LARGEST)
                _tell_endings(line)
            if line in ready:
                text, files, _, _ = socket.recv_fds(line, LARGEST, 3)
                if not text:
                    return None
                program = _fork(line, json.loads(text), files)
                if program is not None:
                    signal.set_wakeup_fd(-1)
                    os.close(heard)
                    os.close(told)
                    return program


def _import_all() -> None:
    for name in IMPORTED:
        import_module(name)
    from autotune_sim.inprocess import open_sim
    from autotune_sim.server import serve

    assert callable(serve)
    open_sim("sim://edm-vertical").close()  # loads the compiled plant
    gc.collect()
    gc.freeze()
    seldom_collected()  # as every program of ours


def _fork(line: socket.socket, request: dict[str, Any], files: list[int]) -> Callable[[], Any] | None:
    """In the new process: what it does. Here: nothing, after the tests were told its number."""
    for name in request["imports"]:
        import_module(name)
    threads = {file.read_text().strip() for file in Path("/proc/self/task").glob("*/comm")}
    assert len(threads - OF_THE_ALLOCATOR) == 1, f"what was imported has started threads: {threads}"
    process = os.fork()
    if process == 0:
        return _become(request, files)
    for file in files:
        os.close(file)
    _tell(line, {"begun": process})
    return None


def _become(request: dict[str, Any], files: list[int]) -> Callable[[], Any]:
    """Speaks through the files that were given, in the folder and the environment that were asked for."""
    for number, answer in USUAL.items():
        signal.signal(number, answer)
    for place, file in enumerate(files):
        os.dup2(file, place)
        os.close(file)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = [request["program"], *request["arguments"]]
    begin: Callable[[], Any] = import_module(request["program"]).main
    return begin


def _tell_endings(line: socket.socket) -> None:
    while True:
        try:
            process, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if process == 0:
            return
        _tell(line, {"ended": process, "code": os.waitstatus_to_exitcode(status)})


def _tell(line: socket.socket, what: dict[str, int]) -> None:
    line.send(json.dumps(what).encode())


if __name__ == "__main__":
    main()
