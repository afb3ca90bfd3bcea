"""The owner's side of the cyclic loop: a process of its own plays, the samples come through a ring.

The process (`cyclic.child`) opens the drive; fits, plots and logging here cannot delay it. Ctrl-C and
SIGTERM during `play` ask it for an orderly end and then raise Interrupted. If the process dies, the
drive's heartbeat consumer stops the axis, and the next access starts another process, which puts back
what the first has changed. A process that shows no sign of life for longer than it has asked for (see
`cyclic.messages`) is ended, with the same consequence.
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
from autotune.core.loop import Routine, Watch, power_in_words
from autotune_drivers.cyclic.messages import ANSWERS_WITHIN, Call, Ended, Failed, Opened, Opener, Play, Reply
from autotune_drivers.cyclic.ring import Ring, create_memory

_LOOK = 0.02
_OPEN_WITHIN = 30.0
_END_WITHIN = 10.0
_LONGEST_LOOK = 0.2  # time that we were held up ourselves is not the other side's
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

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
        self._power: bool | None = None
        self._silence = Silence()

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
    def left(self) -> tuple[str, ...]:
        """What earlier sessions had left in the drive, and what became of it, in words."""
        return self._facts.left

    @property
    def power(self) -> bool | None:
        """What the drive has last told of its power; None while nobody knows."""
        return self._power

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
            What the routine raised; Interrupted on Ctrl-C, SIGTERM, SIGHUP or `interrupt`, after the axis
            was brought to rest, with what the drive says of its power; LinkError where the process dies or
            stalls.
        """
        self._revive()
        ring = self._shared()
        self._interrupted = False
        ring.interrupt(False)
        self._power = None
        self._request(Play(routine))
        with self._signals():
            reply, trouble = self._follow(watch)
        if isinstance(trouble, KeyboardInterrupt) or self._interrupted:
            raise self._was_interrupted() from trouble
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
        reply = self._answer(ANSWERS_WITHIN)
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
            value = _value(self._answer(ANSWERS_WITHIN))
        if self._interrupted:
            raise self._was_interrupted()
        return value

    def _was_interrupted(self) -> Interrupted:
        return Interrupted(f"interrupted; {power_in_words(self._power)}")

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
        end = time.monotonic() + seconds
        self._silence = Silence()
        while not connection.poll(_LOOK):
            self._must_live()
            if time.monotonic() > end:
                raise self._given_up(seconds)
        return self._receive(connection)

    def _must_live(self) -> None:
        """Raises LinkError where the process has shown no sign of life for longer than it has asked for."""
        ring = self._shared()
        silent = self._silence.after(ring.beats)
        if ring.allowed and silent > ring.allowed:
            raise self._given_up(ring.allowed)

    def _given_up(self, seconds: float) -> LinkError:
        self._kill()
        self._reap()
        return LinkError(
            f"the cyclic process has made no progress for {seconds:g} s (it was stopped, or hangs) and was ended; the "
            "drive's own heartbeat guard stops the axis and takes power off. Changed settings are put back on the next "
            "access or on closing; start again"
        )

    def _receive(self, connection: Connection) -> Reply:
        try:
            reply: Reply = connection.recv()
        except (EOFError, ConnectionError) as error:
            raise self._dead() from error
        self._backup = reply.backup
        self._power = self._power if reply.power is None else reply.power
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
        self._silence = Silence()
        while not ended:
            ended = connection.poll(_LOOK)
            trouble = self._pass_on(watch if _may_watch(trouble) else None) or trouble
            if trouble is not None and not self._interrupted:
                self._shared().interrupt()
            asked = self._patience(asked, trouble is not None)
            if not ended:
                self._must_live()
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
        """During a routine Ctrl-C, SIGTERM and SIGHUP ask for an orderly end; they cannot tear us apart."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def wanted(_number: int, _frame: FrameType | None) -> None:
            self.interrupt()

        heard = [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
        before = {number: signal.signal(number, wanted) for number in heard}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler if handler is not None else signal.SIG_DFL)


class Silence:
    """How long the other side has given no sign of life, by our own looks."""

    def __init__(self) -> None:
        self._beats = -1
        self._seconds = 0.0
        self._looked = time.monotonic()

    def after(self, beats: int) -> float:
        """Seconds of silence, given the other side's count of signs now."""
        now = time.monotonic()
        self._seconds = (
            0.0 if beats != self._beats else self._seconds + min(now - self._looked, _LONGEST_LOOK)
        )
        self._beats, self._looked = beats, now
        return self._seconds


def _spawn(connection: int, memory: int) -> subprocess.Popen[bytes]:
    """Starts the process: its own session, our import path, and only these two descriptors."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-m", "autotune_drivers.cyclic.child"]
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
            f"the cyclic process was terminated before it could do this; {power_in_words(reply.power)}. Start again"
        ) from reply.error
    return reply.value if not isinstance(reply, Opened) else None
