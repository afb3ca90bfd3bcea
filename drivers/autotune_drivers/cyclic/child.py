"""The cyclic process: opens the drive, plays routines, and takes the axis to rest when told or orphaned.

Started by `cyclic.CyclicLoop` as `python -m autotune_drivers.cyclic.child CONNECTION MEMORY OWNER`, with
two inherited file descriptors and the owner's process id. It is in a session of its own, so that Ctrl-C
in a terminal reaches the owner only, who asks for an orderly end.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from autotune.core.drive import Command, CutsPower, Drive, Mode, Sample, Standing
from autotune.core.errors import AutotuneError, ConfigurationError, Interrupted, LinkError
from autotune.core.garbage import seldom_collected
from autotune.core.loop import Publish, Routine, power_in_words
from autotune_drivers.cyclic.messages import (
    ANSWERS_WITHIN,
    PREPARES_WITHIN,
    STEPS_WITHIN,
    SWITCHES_WITHIN,
    Call,
    Ended,
    Failed,
    LinkedDrive,
    Opened,
    Play,
    Reply,
    Returned,
)
from autotune_drivers.cyclic.realtime import (
    ask_for_priority,
    first_in_line,
    give_back_priority,
    no_collection,
)
from autotune_drivers.cyclic.ring import Ring

_IDLE = 0.02
_INSIST = 0.5


class Supervisor:
    """Knows whether a routine has to end: the owner asks, the owner is gone, or we are terminated."""

    def __init__(self, ring: Ring, owner: int) -> None:
        self._ring = ring
        self._owner = owner
        self._terminated = False
        self._raised = 0.0

    @property
    def last_call(self) -> bool:
        """True where this process has to end."""
        return self._terminated or os.getppid() != self._owner

    def terminate(self, *_: object) -> None:
        """Signal handler."""
        self._terminated = True

    def new_routine(self) -> None:
        self._raised = 0.0

    def allow(self, seconds: float) -> None:
        """Tells the owner how long the next sign of life may take."""
        self._ring.beat(seconds)

    def check(self) -> None:
        """A sign of life. Raises Interrupted once, so that the routine's `finally` can still step; later again."""
        self._ring.beat()
        if not (self._ring.interrupted or self.last_call):
            return
        now = time.monotonic()
        if not self._raised:
            self._raised = now
        elif now - self._raised < _INSIST:
            return
        raise Interrupted(self._reason())

    def _reason(self) -> str:
        if self._ring.interrupted:
            return "interrupted"
        if self._terminated:
            return "the cyclic process was terminated"
        return "the owner of the cyclic process has died"


class SupervisedDrive:
    """The drive that routines get: as the real one, but a step may raise Interrupted."""

    def __init__(self, drive: LinkedDrive, supervisor: Supervisor) -> None:
        self._drive = drive
        self._step = drive.step
        self._check = supervisor.check
        self._allow = supervisor.allow

    @property
    def period(self) -> float:
        return self._drive.period

    @property
    def identity(self) -> Mapping[str, int | str]:
        return self._drive.identity

    def look(self) -> Standing:
        self._check()
        return self._drive.look()

    def enable(self, mode: Mode) -> None:
        self._check()
        self._allow(SWITCHES_WITHIN)
        self._drive.enable(mode)
        self._allow(STEPS_WITHIN)

    def step(self, command: Command) -> Sample:
        self._check()
        return self._step(command)

    def disable(self) -> None:
        self._allow(SWITCHES_WITHIN)
        self._drive.disable()

    def cut(self) -> None:
        self._allow(SWITCHES_WITHIN)
        if isinstance(self._drive, CutsPower):
            self._drive.cut()
        else:
            self._drive.disable()

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        self._allow(ANSWERS_WITHIN)
        return self._drive.read_parameters(names)

    def write_parameters(self, values: Mapping[str, float]) -> None:
        self._allow(ANSWERS_WITHIN)
        self._drive.write_parameters(values)

    def store(self) -> None:
        self._allow(ANSWERS_WITHIN)
        self._drive.store()

    def faults(self) -> list[str]:
        self._allow(ANSWERS_WITHIN)
        return self._drive.faults()

    def close(self) -> None:
        self._drive.close()


class Server:
    """Serves the owner's requests until he closes, dies, or we are terminated."""

    def __init__(
        self, connection: Connection, ring: Ring, supervisor: Supervisor, drive: LinkedDrive
    ) -> None:
        self._connection = connection
        self._ring = ring
        self._supervisor = supervisor
        self._drive = drive

    def run(self) -> None:
        while not self._supervisor.last_call:
            if not self._connection.poll(_IDLE):
                self._idle()
                continue
            self._supervisor.allow(PREPARES_WITHIN)
            try:
                request = self._connection.recv()
            except (EOFError, ConnectionError):
                return
            except Exception as error:  # noqa: BLE001 - what does not unpickle may raise anything
                self._send(Failed(_not_here(error), self._drive.backup()))
                continue
            if request is None:
                return
            self._send(self._serve(request))

    def _idle(self) -> None:
        self._supervisor.allow(STEPS_WITHIN)
        try:
            self._drive.idle()
        except LinkError:
            time.sleep(_IDLE)  # the next request will say what is wrong

    def _serve(self, request: Call | Play) -> Reply:
        try:
            value = self._play(request.routine) if isinstance(request, Play) else self._call(request)
        except Interrupted as error:
            power = _power_of(self._drive)
            return Failed(Interrupted(f"{error}; {power_in_words(power)}"), self._drive.backup(), power)
        except Exception as error:  # noqa: BLE001 - whatever a routine raises belongs to its caller
            return Failed(_with_origin(error), self._drive.backup(), _power_of(self._drive))
        return Returned(value, self._drive.backup(), _power_of(self._drive))

    def _call(self, request: Call) -> Any:
        self._supervisor.allow(ANSWERS_WITHIN)
        method = getattr(self._drive, request.method, None)
        if method is None:
            raise ConfigurationError(f"this kind of drive has no {request.method!r}")
        return method(*request.arguments)

    def _play(self, routine: Routine[Any]) -> Any:
        prepare = getattr(routine, "prepare", None)
        if prepare is not None:
            prepare()
        put = self._ring.put

        def publish(sample: Sample, label: int, repeat: int) -> None:
            put((*sample, label, repeat))

        return self._guarded(routine, publish)

    def _guarded(self, routine: Routine[Any], publish: Publish) -> Any:
        self._supervisor.new_routine()
        drive: Drive = SupervisedDrive(self._drive, self._supervisor)
        with no_collection(), first_in_line():
            try:
                return routine(drive, publish)
            finally:
                self._supervisor.allow(SWITCHES_WITHIN)
                self._drive.disable()

    def _send(self, reply: Reply) -> None:
        try:
            _tell(self._connection, reply)
        except Exception as error:  # noqa: BLE001 - a result that does not pickle may raise anything
            text = f"the routine's result cannot travel between processes: {error}; return plain data"
            self._connection.send(Failed(ConfigurationError(text), reply.backup))


def _with_origin(error: Exception) -> Exception:
    """The error with where it came from; a foreign one that cannot travel becomes text."""
    if isinstance(error, AutotuneError):
        return error
    origin = "in the cyclic process:\n" + "".join(traceback.format_exception(error))
    try:
        copy: Exception = pickle.loads(pickle.dumps(error))  # noqa: S301 - our own object, one line ago
    except Exception:  # noqa: BLE001 - foreign classes may raise anything here
        copy = LinkError(f"the routine failed with {type(error).__name__}: {error}; this is a defect")
    copy.add_note(origin)
    return copy


def _power_of(drive: LinkedDrive) -> bool | None:
    """What the drive tells of its power; None where it cannot be asked, or does not answer."""
    ask = getattr(drive, "powered", None)
    return ask() if ask is not None else None


def _not_here(error: Exception) -> ConfigurationError:
    return ConfigurationError(
        f"the cyclic process cannot build what it was sent: {error}. Routines must be classes of an "
        "importable module, not of the script that is run"
    )


def serve(connection: Connection, ring: Ring, owner: int) -> None:
    """Opens the drive that the first message describes, then serves until the end."""
    supervisor = Supervisor(ring, owner)
    signal.signal(signal.SIGTERM, supervisor.terminate)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    backup = None
    try:
        opener, backup = connection.recv()
        if supervisor.last_call:  # the owner died while this process began: the drive is left alone
            return
        drive: LinkedDrive = opener(backup)
    except (EOFError, ConnectionResetError):
        return
    except Exception as error:  # noqa: BLE001 - reported to the owner, whatever it is
        _tell(connection, Failed(_with_origin(error), backup))  # what is to be put back still is
        return
    priority = ask_for_priority()  # for every routine, in lock-step too: held up, it would lose its heartbeat
    give_back_priority()
    try:
        left = tuple(getattr(drive, "left", ()))
        facts = Opened(drive.period, dict(drive.identity), priority, drive.backup(), left, _power_of(drive))
        supervisor.allow(STEPS_WITHIN)
        _tell(connection, facts)
        Server(connection, ring, supervisor, drive).run()
    finally:
        supervisor.allow(ANSWERS_WITHIN)
        _tell(connection, _closed(drive))


def _closed(drive: LinkedDrive) -> Ended:
    """Power off, asked of the drive, then everything put back; the first trouble is told, with the others as notes."""
    troubles: list[AutotuneError] = []
    power = None
    try:
        drive.disable()
        power = _power_of(drive)
    except AutotuneError as error:
        troubles.append(error)
    try:
        drive.close()
    except AutotuneError as error:
        troubles.append(error)
    if not troubles:
        return Ended(None, None, power)
    for other in troubles[1:]:
        troubles[0].add_note(str(other))
    return Ended(troubles[0], drive.backup(), power)


def _tell(connection: Connection, reply: Reply) -> None:
    """Sends a reply to an owner who may be gone: then the server ends by itself."""
    with suppress(BrokenPipeError, ConnectionError):
        connection.send(reply)


def main(arguments: Sequence[str]) -> None:
    """Entry point of the process."""
    seldom_collected()
    descriptor, memory, owner = map(int, arguments)
    ring = Ring(memory)
    os.close(memory)
    with Connection(descriptor) as connection:
        serve(connection, ring, owner)
    ring.close()


if __name__ == "__main__":
    main(sys.argv[1:])
