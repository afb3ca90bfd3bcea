"""The owner's side of the cyclic loop: a process of its own plays, the samples come through a ring.

The process (`cyclic_child`) opens the drive; fits, plots and logging here cannot delay it. Ctrl-C and
SIGTERM during `play` ask it for an orderly end and then raise Interrupted. If the process dies, the
drive's heartbeat consumer stops the axis, and the next access starts another process, which puts back
what the first has changed.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from types import FrameType
from typing import Any, TypeVar

from autotune.core.drive_recording import DriveRecording
from autotune.core.errors import ConfigurationError, Interrupted, LinkError
from autotune.core.loop import Routine, Watch
from autotune_drivers.cyclic_messages import Call, Ended, Failed, Opened, Opener, Play, Reply
from autotune_drivers.ring import Ring, create_memory

_LOOK = 0.02
_OPEN_WITHIN = 30.0
_CALL_WITHIN = 90.0
_END_WITHIN = 10.0
_SIGNALS = (signal.SIGINT, signal.SIGTERM)

Result = TypeVar("Result")


class CyclicLoop:
    """A `Loop` whose drive lives in a process of its own. Made by `CyclicLoop.open`."""

    def __init__(self, opener: Opener) -> None:
        self._opener = opener
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        self._ring: Ring | None = None
        self._backup: Any = None
        self._opened: Opened | None = None
        self._interrupted = False
        self._closed = False
        self._dropped = 0

    @classmethod
    def open(cls, opener: Opener) -> CyclicLoop:
        """Starts the process and opens the drive in it.

        Raises:
            AutotuneError: what the opener raised. LinkError: the process does not start.
        """
        loop = cls(opener)
        loop._start()
        return loop

    @property
    def period(self) -> float:
        return self._facts.period

    @property
    def identity(self) -> Mapping[str, int | str]:
        return self._facts.identity

    @property
    def priority(self) -> str:
        """How the process is scheduled, in words."""
        return self._facts.priority

    @property
    def dropped(self) -> int:
        """Rows that were lost because nobody took them; the row after a gap counts them as missed."""
        return self._dropped + (self._ring.dropped if self._ring else 0)

    @property
    def process_id(self) -> int | None:
        """Of the cyclic process; None while there is none."""
        return self._process.pid if self._process else None

    @property
    def _facts(self) -> Opened:
        if self._opened is None:
            raise LinkError("the cyclic loop is not open")
        return self._opened

    # Calls

    def play(self, routine: Routine[Result], watch: Watch | None = None) -> Result:
        """Plays a routine in the cyclic process.

        A routine may have a method `prepare()`: it is called first, with power off, and warms what
        must not be compiled while the axis moves.

        Raises:
            What the routine raised; Interrupted on Ctrl-C, SIGTERM or `interrupt`, after the axis is at
            rest; LinkError where the process dies.
        """
        self._revive()
        ring = self._shared()
        self._interrupted = False
        ring.interrupt(False)
        self._request(Play(routine))
        with self._signals():
            reply, trouble = self._follow(watch)
        if isinstance(trouble, KeyboardInterrupt) or self._interrupted:
            raise Interrupted("interrupted; the axis is at rest and without power") from trouble
        if trouble is not None:
            raise trouble
        result: Result = _value(reply)
        return result

    def interrupt(self) -> None:
        """Ends the routine that plays; `play` raises Interrupted. For other threads and handlers."""
        self._interrupted = True
        if self._ring is not None:
            self._ring.interrupt()

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        values: dict[str, float] = self._call("read_parameters", names)
        return values

    def write_parameters(self, values: Mapping[str, float]) -> None:
        self._call("write_parameters", dict(values))

    def store(self) -> None:
        self._call("store")

    def faults(self) -> list[str]:
        texts: list[str] = self._call("faults")
        return texts

    def recorder_seconds(self) -> float:
        """How long the drive's own recorder can record [s]; 0 where there is none."""
        try:
            return float(self._call("recorder_seconds"))
        except ConfigurationError:
            return 0.0

    def begin_recording(self, seconds: float) -> None:
        """Starts the drive's own recorder. Raises ConfigurationError (too long), LinkError."""
        self._call("begin_recording", seconds)

    def end_recording(self) -> DriveRecording:
        """Stops the drive's own recorder and fetches it. Raises LinkError."""
        recording: DriveRecording = self._call("end_recording")
        return recording

    def close(self) -> None:
        """Power off, every changed setting put back, process ended. Idempotent.

        Raises:
            LinkError: something could not be put back; it says what.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if self._process is None and self._backup is not None:
                self._start()
            if self._process is not None:
                self._end()
        finally:
            self._reap()

    def _end(self) -> None:
        """Asks the process to close the drive; one that was terminated has done so, and says the same."""
        self._request(None)
        reply = self._answer(_CALL_WITHIN)
        if not isinstance(reply, Ended):
            _value(reply)
        elif reply.error is not None:
            raise reply.error

    # The process

    def _start(self) -> None:
        here, there = Pipe()
        memory = create_memory()
        try:
            self._ring = Ring(memory)
            self._connection = here
            with there:
                self._process = _spawn(there.fileno(), memory)
        finally:
            os.close(memory)
        try:
            self._request((self._opener, self._backup))
            reply = self._answer(_OPEN_WITHIN)
        except BaseException:
            self._reap()
            raise
        if isinstance(reply, Opened):
            self._opened, self._backup = reply, reply.backup
            return
        self._reap()
        _value(reply)

    def _revive(self) -> None:
        if self._closed:
            raise LinkError("the cyclic loop is closed; open the link again")
        if self._process is None:
            self._start()

    def _call(self, method: str, *arguments: Any) -> Any:
        self._interrupted = False
        with self._signals():
            self._revive()
            self._request(Call(method, arguments))
            value = _value(self._answer(_CALL_WITHIN))
        if self._interrupted:
            raise Interrupted("interrupted; the axis is at rest and without power")
        return value

    def _request(self, message: object) -> None:
        """Sends. That nobody is there any more is told by what is read next: a last word, or none."""
        try:
            with suppress(BrokenPipeError, ConnectionError):
                self._wire().send(message)
        except (pickle.PicklingError, AttributeError, TypeError, ValueError) as error:
            raise ConfigurationError(
                f"a routine cannot travel to the cyclic process: {error}; make it a class of a module, with "
                "plain data in it"
            ) from error

    def _answer(self, seconds: float) -> Reply:
        connection = self._wire()
        if not connection.poll(seconds):
            self._kill()
            raise LinkError(
                f"the cyclic process has not answered for {seconds:g} s and was ended; the drive stops by its "
                "own heartbeat guard. Start again"
            )
        return self._receive(connection)

    def _receive(self, connection: Connection) -> Reply:
        try:
            reply: Reply = connection.recv()
        except (EOFError, ConnectionError) as error:
            raise self._dead() from error
        self._backup = reply.backup
        if isinstance(reply, Ended):
            self._reap()
        return reply

    def _follow(self, watch: Watch | None) -> tuple[Reply, BaseException | None]:
        """Passes rows on until the routine has ended; an error of `watch` ends it.

        The answer comes after the last row, so whoever sees it has all rows in the ring.
        """
        connection = self._wire()
        trouble: BaseException | None = None
        asked = 0.0
        ended = False
        while not ended:
            ended = connection.poll(_LOOK)
            trouble = self._pass_on(watch if _may_watch(trouble) else None) or trouble
            if trouble is not None and not self._interrupted:
                self._shared().interrupt()
            asked = self._patience(asked, trouble is not None)
        return self._receive(connection), trouble

    def _pass_on(self, watch: Watch | None) -> BaseException | None:
        rows = self._ring.take() if self._ring else None
        if watch is None or rows is None or not len(rows):
            return None
        try:
            watch(rows)
        except BaseException as error:  # noqa: BLE001 - raised again when the axis is at rest
            return error
        return None

    def _patience(self, asked: float, trouble: bool) -> float:
        """Ends a process that does not bring its routine to an end in time."""
        if not (trouble or self._interrupted):
            return 0.0
        now = time.monotonic()
        if asked and now - asked > _END_WITHIN and self._process is not None:
            self._kill()
        return asked or now

    def _dead(self) -> LinkError:
        process = self._process
        code = process.wait(5) if process else None
        self._reap()
        how = f"signal {-code}" if code and code < 0 else f"exit code {code}"
        return LinkError(
            f"the cyclic process has died ({how}); the drive's own heartbeat guard stops the axis and takes "
            "power off. Changed settings are put back on the next access or on closing; start again"
        )

    def _kill(self) -> None:
        """The last resort: without its heartbeat the drive stops the axis."""
        process = self._process
        if process is not None and process.poll() is None:
            process.kill()
            process.wait()

    def _reap(self) -> None:
        """Lets go of everything that belongs to the process, and waits for its end."""
        if self._connection is not None:
            self._connection.close()
        if self._process is not None:
            try:
                self._process.wait(_END_WITHIN)
            except subprocess.TimeoutExpired:
                self._kill()
        if self._ring is not None:
            self._dropped += self._ring.dropped
            self._ring.close()
        self._connection = self._process = self._ring = None

    def _wire(self) -> Connection:
        if self._connection is None:
            raise LinkError("the cyclic process is not running; open the link again")
        return self._connection

    def _shared(self) -> Ring:
        if self._ring is None:
            raise LinkError("the cyclic process is not running; open the link again")
        return self._ring

    @contextmanager
    def _signals(self) -> Iterator[None]:
        """During a routine Ctrl-C and SIGTERM ask for an orderly end; they cannot tear us apart."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def wanted(_number: int, _frame: FrameType | None) -> None:
            self.interrupt()

        before = {number: signal.signal(number, wanted) for number in _SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler if handler is not None else signal.SIG_DFL)


def _spawn(connection: int, memory: int) -> subprocess.Popen[bytes]:
    """Starts the process: its own session, our import path, and only these two descriptors."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-m", "autotune_drivers.cyclic_child"]
    try:
        return subprocess.Popen(
            [*command, str(connection), str(memory), str(os.getpid())],
            pass_fds=(connection, memory),
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            env=environment,
        )
    except OSError as error:
        raise LinkError(f"the cyclic process cannot be started: {error}; check memory and limits") from error


def _may_watch(trouble: BaseException | None) -> bool:
    """A watcher that failed is not called again; one that passed on Ctrl-C sees the rest."""
    return trouble is None or isinstance(trouble, KeyboardInterrupt)


def _value(reply: Reply) -> Any:
    if isinstance(reply, Failed):
        raise reply.error
    if isinstance(reply, Ended):
        raise LinkError(
            "the cyclic process was terminated before it could do this; the axis is at rest and without power. "
            "Start again"
        ) from reply.error
    return reply.value if not isinstance(reply, Opened) else None
