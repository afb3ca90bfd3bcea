"""A commit over the real byte stream of the simulated drive, cut wherever one likes; time is virtual.

Master and drive are in one process: the master's slcan bytes go into the simulated adapter and back, one
by one counted. At a byte of choice the host dies, the cable is pulled, or the drive loses its power; what
was sent of a frame by then has arrived. Afterwards somebody may switch the drive off and on, and the next
start has to put everything right.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any, Protocol
from unittest.mock import patch

import numpy as np

from autotune.core.drive import Mode
from autotune.core.errors import AutotuneError, ConfigurationError, LinkError
from autotune.core.loop import LocalLoop
from autotune.core.paths import config_directory
from autotune.tuning.backup import backup_ids, load_backup
from autotune.tuning.commit import commit
from autotune.tuning.journal import CommitPhase, Journal
from autotune.tuning.recovery import recover
from autotune_drivers.canopen import exchange, node, wire
from autotune_drivers.canopen import opening as canopen_open
from autotune_drivers.canopen.frames import Frame
from autotune_drivers.canopen.opening import open_drive
from autotune_drivers.canopen.slcan import encode
from autotune_drivers.profile import read_profile
from autotune_sim.device import Device
from autotune_sim.memory import Memory
from autotune_sim.presets import Preset, preset
from autotune_sim.servo import Servo
from autotune_sim.slcan import SlcanAdapter
from tests.drivers.simulator import axis_of

NOW = datetime(2026, 11, 20, 4, 0, 0)
NODE = 5
NEVER = 1 << 60
KINDS = ("host", "cable", "power")
BLOCK = ("enabled", "inertia", "viscous", "coulomb", "break_away", "stribeck_velocity", "stiffness",
         "micro_damping", "offset")  # fmt: skip
SESSION = ((0x1016, 1), (0x1016, 2), (0x1017, 0), (0x6007, 0), (0x605A, 0), (0x605E, 0), (0x6060, 0), (0x60C2, 1),
           (0x60C2, 2), (0x6085, 0))  # fmt: skip
OLD = dict(zip(BLOCK, (1.0, 2.5e-4, 0.002, 0.1, 0.125, 0.25, 16.0, 0.0625, -0.03125), strict=True))
NEW = dict(zip(BLOCK, (1.0, 3.0e-4, 0.001, 0.2, 0.25, 0.5, 32.0, 0.03125, 0.015625), strict=True))


class Dead(BaseException):
    """The host dies here: nothing of it runs any more."""


class Cuttable(Protocol):
    """What both rigs know: bytes (or frames) so far, and the device behind the wire."""

    bytes: int
    device: Any

    def plug(self) -> None: ...

    def rest(self, seconds: float) -> None: ...


class Rig:
    """A simulated drive and its adapter. `cut` is the byte at which `kind` happens."""

    def __init__(self, stored: Mapping[tuple[int, int], bytes], axis: Preset | None = None) -> None:
        self.now = 1000.0
        self.bytes = 0
        self.cut = NEVER
        self.kind = ""
        self.ended: type[BaseException] | None = None
        self.memory = Memory(None, lambda _: None)
        self.memory.write(stored)
        self._adapter = SlcanAdapter(
            lambda cob, data: self.device.receive(cob, data, self.now), lambda: self.now
        )
        servo = Servo(axis or preset("edm-vertical"), 0)
        eds = config_directory() / "eds" / "autotune-sim.eds"
        self.device = Device(servo, eds, NODE, self._adapter.transmit, self.memory, lambda _: None)
        self._adapter.feed(b"S8\rO\r")
        self._adapter.output.clear()
        self.rest(0.5)

    def rest(self, seconds: float) -> None:
        """Lets the wall clock run without a host."""
        end = self.now + seconds
        while self.now < end:
            self.now = min(max(self.device.poll(self.now), self.now + 1e-3), end)
        self._adapter.output.clear()

    def plug(self) -> None:
        """A new host: nothing is broken any more."""
        self.ended, self.cut, self.bytes = None, NEVER, 0
        self._adapter.feed(b"\r")
        self._adapter.output.clear()

    # A FrameLink

    name = "rig"
    hint = ""

    def send(self, *frames: Frame) -> None:
        self._adapter.feed(self._pass(b"".join(encode(*frame) for frame in frames)))
        self._stop()

    def receive(self, timeout: float) -> list[Frame]:
        end = self.now + max(timeout, 0.0)
        while True:
            due = self.device.poll(self.now)
            heartbeat = self.device.heartbeat_due
            if heartbeat is not None and self.now >= heartbeat:
                self.device.check_heartbeats(self.now)
            received = self._pass(bytes(self._adapter.output))
            self._adapter.output.clear()
            self._stop()
            frames = [frame for line in received.split(b"\r") if (frame := _decode(line)) is not None]
            if frames or self.now >= end:
                return frames
            self.now = min(max(due, self.now + 1e-4), end)

    def close(self) -> None:
        return

    def _pass(self, data: bytes) -> bytes:
        """Counts bytes; those after the cut do not arrive."""
        if self.ended is not None:
            raise self.ended("the wire was cut")
        before, self.bytes = self.bytes, self.bytes + len(data)
        if not before <= self.cut < self.bytes:
            return data
        if self.kind == "power":
            self.device.power_loss()
            return data
        self.ended = Dead if self.kind == "host" else LinkError
        return data[: self.cut - before]

    def _stop(self) -> None:
        if self.ended is not None:
            raise self.ended("the wire was cut")

    # What the drive holds

    def volatile(self) -> dict[str, float]:
        return {name: float(self.device.objects[0x2100, k].value) for k, name in enumerate(BLOCK, 1)}

    def session(self) -> dict[str, object]:
        """All that a session changes: heartbeats, reaction to a lost host, mode, cycle, ramp, PDOs."""
        entries = self.device.objects
        found: dict[str, object] = {
            f"{index:04X}:{sub:02X}": entries[index, sub].value for index, sub in SESSION
        }
        for base in (0x1400, 0x1800):
            for number in range(base, base + 4):
                count = int(entries[number + 0x200, 0].value)
                subs = [(number, 1), (number, 2), *((number + 0x200, sub) for sub in range(count + 1))]
                found |= {f"{index:04X}:{sub:02X}": entries[index, sub].value for index, sub in subs}
        return found

    def stored(self) -> dict[str, float]:
        values = self.memory.read()
        entries = self.device.objects
        return {name: float(entries[0x2100, k].decode(values[0x2100, k])) for k, name in enumerate(BLOCK, 1)}


def _decode(line: bytes) -> Frame | None:
    if line[:1] != b"t" or len(line) < 5 or len(line) != 5 + 2 * (line[4] - 48):
        return None
    return int(line[1:4], 16), bytes.fromhex(line[5:].decode("ascii"))


@contextmanager
def virtual_time(rig: Rig) -> Iterator[None]:
    """The drivers' clock is the rig's; the disk is not waited for, as what is cut here is not the host's power."""

    def sleep(seconds: float) -> None:
        rig.now += seconds

    clock = SimpleNamespace(monotonic=lambda: rig.now, sleep=sleep)
    with (
        patch.object(wire, "time", clock),
        patch.object(node, "time", clock),
        patch.object(exchange, "time", clock),
        patch.object(canopen_open, "time", clock),
        patch.object(os, "fsync", lambda descriptor: None),
    ):
        yield


def parameters(block: Mapping[str, float]) -> dict[str, float]:
    return {f"feedforward.{name}": value for name, value in block.items()}


def factory() -> dict[tuple[int, int], bytes]:
    """What the drive's memory holds when `OLD` was stored."""
    rig = Rig({})
    with virtual_time(rig):
        drive = open_drive(rig, NODE, axis_of(), read_profile("autotune-sim"))
        drive.write_parameters(parameters(OLD))
        drive.store()
        drive.close()
    return rig.memory.read()


@dataclass(frozen=True)
class Case:
    """One cut: where, of what kind, and what happens to the drive and to the next start."""

    cut: int
    kind: str
    power_cycle: bool
    second_cut: int

    @classmethod
    def draw(cls, random: Random, length: int) -> Case:
        second = random.randrange(length) if random.random() < 0.3 else NEVER
        return cls(random.randrange(length), random.choice(KINDS), random.random() < 0.5, second)


def opened(rig: Rig, runs: Path) -> LocalLoop:
    """A session that keeps on disk what it changes, ready to move: all that it ever sets is set."""
    profile = read_profile("autotune-sim")
    drive = open_drive(rig, NODE, axis_of(), profile, keep=runs / "sessions")
    drive.enable(Mode.TORQUE)
    drive.disable()
    return LocalLoop(drive)


def attempt(rig: Rig, runs: Path, name: str, proves: bool = True) -> bool:
    """A run that commits `NEW`."""
    directory = runs / name
    directory.mkdir(parents=True)
    journal = Journal.begin(directory, "axis", "f00", NOW)
    loop = opened(rig, runs)
    rig.bytes = 0
    try:
        return commit(loop, parameters(NEW), journal, runs, NOW, lambda: proves)
    finally:
        with suppress(AutotuneError):
            loop.close()


def next_start(rig: Cuttable, runs: Path, name: str, loop: LocalLoop) -> list[str]:
    """A later run on an opened session: what it found and put right, in words."""
    directory = runs / name
    directory.mkdir(parents=True)
    own = Journal.begin(directory, "axis", "f00", NOW)
    rig.bytes = 0
    try:
        done = recover(loop, runs, own)
        own.note(outcome="not_applied")
        return done
    finally:
        with suppress(AutotuneError):
            loop.close()


def length(stored: Mapping[tuple[int, int], bytes], runs: Path) -> int:
    """Bytes of a whole commit, both ways."""
    rig = Rig(stored)
    with virtual_time(rig):
        if not attempt(rig, runs, "20261120-040000-axis"):
            raise ConfigurationError("the commit that is to be cut does not work by itself")
    return rig.bytes


@dataclass(frozen=True)
class Ending:
    """What became of a case.

    Between the cut and the next start: `mixed`: the drive held neither set; `changed`: settings of the session.
    """

    wrong: str
    kept: bool
    mixed: bool
    changed: bool


def play(case: Case, stored: Mapping[tuple[int, int], bytes], runs: Path) -> Ending:
    """Plays one case to its end; `wrong` is "" where all is well."""
    rig = Rig(stored)
    before = rig.session()
    with virtual_time(rig):
        kept = _cut(rig, case, runs)
        changed = rig.session() != before
        mixed = parameters(rig.volatile()) not in (_as_held(OLD), _as_held(NEW))
        afterwards(rig, case)
        if case.second_cut != NEVER:
            rig.cut, rig.kind = case.second_cut, "host"
            with suppress(Dead, AutotuneError):
                next_start(rig, runs, "20261120-050000-axis", opened(rig, runs))
            afterwards(rig, case)
        next_start(rig, runs, "20261120-060000-axis", opened(rig, runs))
    wrong = _judge(rig, runs, kept) or _session_judged(before, rig.session())
    return Ending(wrong, kept, mixed, changed)


def _cut(rig: Rig, case: Case, runs: Path) -> bool:
    """True where the commit came to its end in spite of the cut."""
    try:
        return _armed(rig, case, runs)
    except (Dead, AutotuneError):
        return False


def _armed(rig: Rig, case: Case, runs: Path) -> bool:
    rig.kind = case.kind
    directory = runs / "20261120-040000-axis"
    directory.mkdir(parents=True)
    journal = Journal.begin(directory, "axis", "f00", NOW)
    loop = opened(rig, runs)
    rig.bytes, rig.cut = 0, case.cut
    return commit(loop, parameters(NEW), journal, runs, NOW, lambda: True)


def afterwards(rig: Cuttable, case: Case) -> None:
    """The cable is whole again; the drive may have been switched off and on meanwhile."""
    rig.plug()
    rig.rest(1.0)
    if case.power_cycle:
        rig.device.power_loss()
        rig.rest(1.0)
    rig.plug()


def _judge(rig: Rig, runs: Path, kept: bool) -> str:
    wanted = NEW if kept else OLD
    journal = Journal.load(runs / "20261120-040000-axis").state
    if journal.phase is not CommitPhase.NONE:
        backup = load_backup(runs, "axis", backup_ids(runs, "axis")[0]).parameters
        if not _as_held(OLD).items() <= backup.items():
            return f"the backup is {backup}"
    for place, held in (("volatile", rig.volatile()), ("stored", rig.stored())):
        if parameters(held) != _as_held(wanted):
            return f"{place} is {held}"
    return ""


def _session_judged(before: Mapping[str, object], after: Mapping[str, object]) -> str:
    wrong = [
        f"{name} is {after.get(name)} instead of {old}"
        for name, old in before.items()
        if after.get(name) != old
    ]
    return f"the session has left {'; '.join(wrong)}" if wrong else ""


def _as_held(block: Mapping[str, float]) -> dict[str, float]:
    """As the drive's REAL32 objects hold it."""
    return {name: float(np.float32(value)) for name, value in parameters(block).items()}
