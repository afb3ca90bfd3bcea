"""Tables committed to simulated drives, trials of ripple included, and cut wherever one likes; virtual time.

As `cut_rig`, for the AX8000-like harmonics and a table over velocity (cut at a byte) and for moteus's table (cut at
a frame). At the cut the
host dies, the cable is pulled, or the drive loses its power; the next start has to put everything right.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import patch

import numpy as np

from autotune.control.ripple_reduction import RippleBlock, drive_values
from autotune.core.axis import Axis
from autotune.core.errors import AutotuneError, ConfigurationError, LinkError
from autotune.core.friction_table import TORQUE as VELOCITY_TORQUE
from autotune.core.friction_table import VELOCITY
from autotune.core.loop import LocalLoop
from autotune.core.paths import config_directory
from autotune.core.ripple_parameters import GAIN, is_ripple
from autotune.tuning.commit import commit, feedforward_parameters
from autotune.tuning.journal import Journal
from autotune.tuning.session import Session
from autotune.tuning.stage_ripple import _written
from autotune_drivers.canopen.opening import open_drive
from autotune_drivers.moteus import console, exchange, node, opening, power
from autotune_drivers.moteus.line import Line, LineReader
from autotune_drivers.moteus.opening import open_controller
from autotune_drivers.moteus.port import MoteusPort
from autotune_drivers.moteus.profile import read_moteus_profile
from autotune_drivers.profile import read_profile
from autotune_sim.memory import Memory
from autotune_sim.moteus_device import MoteusDevice
from autotune_sim.moteus_uart import SPEED, UartServer
from autotune_sim.presets import Preset, preset
from autotune_sim.servo import Servo
from tests.drivers.moteus_rig import moteus_axis
from tests.drivers.simulator import axis_of
from tests.tuning.cut_rig import NEVER, NODE, NOW, Case, Dead, Rig, afterwards, next_start, virtual_time

Stored = dict[tuple[int, int], bytes]
ON_THE_WIRE = 2e-4  # s that a frame and its answer take
POINTS = 48  # of the table's 1024 that are used here: the rest would only take time
OLD_WAVES = {6: 0.004 + 0.002j, 12: -0.003j}
NEW_WAVES = {3: 0.02 - 0.01j, 6: 0.005 + 0j, 12: 0.01j}
TRIAL_WAVES = {3: 0.02 + 0j, 6: 0.02 + 0j, 12: 0.02 + 0j}


def points(rpm: int, torques: Sequence[float]) -> dict[str, float]:
    """A table over velocity that is switched on, from this many rpm, in the drive's whole steps."""
    found = {"feedforward.enabled": 1.0, "feedforward.inertia": 3e-4 * rpm}
    for k, torque in enumerate(torques):
        found |= {f"{VELOCITY}.{k}": 2.0 * np.pi / 60.0 * rpm * 2**k, f"{VELOCITY_TORQUE}.{k}": torque}
    return found


class HarmonicsRig(Rig):
    """A CiA 402 drive with harmonics."""

    clocks = ()
    profile = "autotune-sim-harmonics"
    friction: Mapping[str, Mapping[str, float]] = {
        "old": {"feedforward.stiffness": 16.0, "feedforward.coulomb": 0.125, "feedforward.viscous": 0.002},
        "new": {"feedforward.stiffness": 32.0, "feedforward.coulomb": 0.25, "feedforward.viscous": 0.001},
    }

    def axis(self) -> Axis:
        return axis_of()

    def open(self, keep: Path) -> LocalLoop:
        return LocalLoop(open_drive(self, NODE, axis_of(), read_profile(self.profile), keep=keep))

    def time(self) -> Any:
        return virtual_time(self)


class TableRig:
    """A moteus on its line, in this process. `bytes` counts frames here, `cut` is one of them."""

    profile = "autotune-sim-moteus"
    name = "rig"
    baud = 921600
    friction: Mapping[str, Mapping[str, float]] = {
        "old": {"feedforward.enabled": 1.0, "feedforward.stiffness": 16.0, "feedforward.coulomb": 0.125},
        "new": {"feedforward.enabled": 1.0, "feedforward.stiffness": 32.0, "feedforward.coulomb": 0.25},
    }

    def __init__(self, stored: Stored, axis: Preset | None = None, points: int = POINTS) -> None:
        self.points = points
        self.now = 1000.0
        self.bytes, self.cut, self.kind = 0, NEVER, ""
        self.ended: type[BaseException] | None = None
        self.memory = Memory(None, lambda _: None)
        self.memory.write(stored)
        self.reader = LineReader()
        self._uart = UartServer(
            lambda number, data: self.device.receive(number, data, self.now), lambda: SPEED
        )
        servo = Servo(axis or preset("edm-vertical"), 0)
        eds = config_directory() / "eds" / "autotune-sim.eds"
        self.device = MoteusDevice(servo, eds, 1, self._uart.transmit, self.memory, lambda _: None)
        for k in range(points, 1024):
            for listed in (self.device._plain, self.device._fresh_plain):
                listed.pop(f"motor.cogging_dq_comp.{k}")
        self.rest(0.5)

    def rest(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end:
            self.now = min(max(self.device.poll(self.now), self.now + 1e-3), end)
            if self.device.heartbeat_due is not None and self.now >= self.device.heartbeat_due:
                self.device.check_heartbeats(self.now)
        self._uart.output.clear()

    def plug(self) -> None:
        self.ended, self.cut, self.bytes = None, NEVER, 0
        self.reader = LineReader()
        self._uart.reset()

    # A MoteusPort

    def write(self, text: bytes) -> None:
        self._stop()
        self.now += ON_THE_WIRE
        self.bytes += 1
        if self.bytes - 1 == self.cut:
            if self.kind == "power":
                self.device.power_loss()
            else:
                self.ended = Dead if self.kind == "host" else LinkError
                if self.bytes % 2:  # the frame itself may have arrived
                    self._uart.feed(text)
                self._stop()
        self._uart.feed(text)

    def lines(self, timeout: float) -> list[Line]:
        self._stop()
        end = self.now + max(timeout, 0.0)
        while True:
            due = self.device.poll(self.now)
            if self._uart.output or self.now >= end:
                received = bytes(self._uart.output)
                self._uart.output.clear()
                return self.reader.feed(received)
            self.now = min(max(due, self.now + 1e-4), end)

    def drain(self) -> None:
        self.lines(0.0)

    def close(self) -> None:
        return

    def _stop(self) -> None:
        if self.ended is not None:
            raise self.ended("the wire was cut")

    def axis(self) -> Axis:
        return moteus_axis()

    def open(self, keep: Path) -> LocalLoop:
        profile = read_moteus_profile(self.profile)
        assert profile.ripple is not None
        table = profile.ripple.model_copy(update={"points": self.points})
        profile = profile.model_copy(update={"ripple": table})
        port = cast(MoteusPort, self)
        return LocalLoop(open_controller(port, 1, moteus_axis(), profile, keep=keep))

    @contextmanager
    def time(self) -> Iterator[None]:
        def sleep(seconds: float) -> None:
            self.now += seconds

        clock = SimpleNamespace(monotonic=lambda: self.now, sleep=sleep)
        with (
            patch.object(node, "time", clock),
            patch.object(console, "time", clock),
            patch.object(exchange, "time", clock),
            patch.object(opening, "time", clock),
            patch.object(power, "time", clock),
            patch.object(os, "fsync", lambda descriptor: None),
        ):
            yield


class VelocityRig(HarmonicsRig):
    """A CiA 402 drive with friction over velocity as a table, and no ripple."""

    profile = "autotune-sim-table"
    friction: Mapping[str, Mapping[str, float]] = {
        "old": points(1, (0.1, 0.11, 0.12, 0.125, 0.13, 0.14)),
        "new": points(2, (0.2, 0.22, 0.24, 0.25, 0.26, 0.28)),
    }


AnyRig = HarmonicsRig | TableRig
RIGS: dict[str, type[HarmonicsRig] | type[TableRig]] = {
    "harmonics": HarmonicsRig,
    "table": TableRig,
    "velocity": VelocityRig,
}


def wanted(rig: AnyRig, loop: LocalLoop, which: str) -> dict[str, float]:
    """A whole set of what is committed: friction and ripple."""
    block = RippleBlock.of(loop.read_parameters())
    if block is None:
        return dict(rig.friction[which])
    waves = OLD_WAVES if which == "old" else NEW_WAVES
    return {**rig.friction[which], **drive_values(waves, 1, block)}


def factory(kind: str) -> Stored:
    """What the drive's memory holds when the old set was stored."""
    rig = RIGS[kind]({})
    with rig.time():
        loop = rig.open(Path("/nonexistent"))
        loop.write_parameters(wanted(rig, loop, "old"))
        loop.store()
        loop.close()
    return rig.memory.read()


def held(rig: AnyRig, runs: Path) -> dict[str, float]:
    """What the drive says that it holds of feedforward now."""
    loop = rig.open(runs / "sessions")
    try:
        return feedforward_parameters(loop)
    finally:
        loop.close()


def commits(rig: AnyRig, runs: Path, name: str) -> bool:
    """A run that writes trial waves, takes them back, and commits the new set."""
    directory = runs / name
    directory.mkdir(parents=True)
    journal = Journal.begin(directory, "axis", "f00", NOW)
    loop = rig.open(runs / "sessions")
    rig.bytes = 0
    try:
        before = feedforward_parameters(loop)
        journal.note(identity=dict(loop.identity))
        off = {name: before[name] for name in ("feedforward.enabled", GAIN) if before.get(name)}
        journal.note(changed=off, during=dict.fromkeys(off, 0.0))
        loop.write_parameters(dict.fromkeys(off, 0.0))
        block = RippleBlock.of(loop.read_parameters())
        session = cast(Session, SimpleNamespace(loop=loop, journal=journal))
        ripple = {name: value for name, value in feedforward_parameters(loop).items() if is_ripple(name)}
        for turn in (1.0, 1.0j) if block is not None else ():
            trial = drive_values({n: w * turn for n, w in TRIAL_WAVES.items()}, 1, block)
            with _written(session, trial, ripple):
                pass
        done = commit(loop, wanted(rig, loop, "new"), journal, runs, NOW, lambda: True)
        journal.note(outcome="kept", changed={}, during={})
        return done
    finally:
        with suppress(AutotuneError):
            loop.close()


def length(kind: str, stored: Stored, runs: Path) -> int:
    """Bytes or frames of the whole."""
    rig = RIGS[kind](stored)
    with rig.time():
        if not commits(rig, runs, "20261120-040000-axis"):
            raise ConfigurationError("the commit that is to be cut does not work by itself")
    return rig.bytes


@dataclass(frozen=True)
class Ending:
    """`wrong`: "" where all is well; `mixed`: between cut and next start the drive held neither set."""

    wrong: str
    kept: bool
    mixed: bool


def play(kind: str, case: Case, stored: Stored, runs: Path) -> Ending:
    """Plays one case to its end."""
    rig = RIGS[kind](stored)
    with rig.time():
        old, new = _sets(rig, runs)
        rig.plug()
        rig.rest(0.5)
        rig.cut, rig.kind = NEVER, case.kind
        kept = _cut(rig, case, runs)
        mixed = _ripple_of(rig) not in (_ripple_of_set(kind, stored), _ripple_of_set(kind, stored, new=True))
        afterwards(rig, case)
        if case.second_cut != NEVER:
            rig.cut, rig.kind = case.second_cut, "host"
            with suppress(Dead, AutotuneError):
                next_start(rig, runs, "20261120-050000-axis", rig.open(runs / "sessions"))
            afterwards(rig, case)
        next_start(rig, runs, "20261120-060000-axis", rig.open(runs / "sessions"))
        wrong = _differs("volatile", held(rig, runs), new if kept else old)
        rig.device.power_loss()
        rig.rest(1.0)
        rig.plug()
        wrong = wrong or _differs("stored", held(rig, runs), new if kept else old)
    return Ending(wrong, kept, mixed)


def _sets(rig: AnyRig, runs: Path) -> tuple[dict[str, float], dict[str, float]]:
    loop = rig.open(runs / "sessions")
    try:
        old = feedforward_parameters(loop)
        return old, old | wanted(rig, loop, "new")
    finally:
        loop.close()


def _cut(rig: AnyRig, case: Case, runs: Path) -> bool:
    """True where the commit came to its end in spite of the cut."""
    try:
        # the cut counts from the opened session, which `commits` begins to count anew
        rig.cut = case.cut
        return commits(rig, runs, "20261120-040000-axis")
    except (Dead, AutotuneError):
        return Journal.load(runs / "20261120-040000-axis").state.phase.value == "kept"


def _ripple_of(rig: AnyRig) -> bytes:
    servo = rig.device.firmware.servo
    ripple = b"".join(
        np.ascontiguousarray(servo.ripple[name]).tobytes() for name in ("table", "order", "phase", "torque")
    )
    return ripple + servo.friction.tobytes()


_SETS: dict[tuple[str, bool], bytes] = {}


def _ripple_of_set(kind: str, stored: Stored, new: bool = False) -> bytes:
    """What the servo loop holds with the old or the new set."""
    if (kind, new) not in _SETS:
        rig = RIGS[kind](stored)
        with rig.time():
            if new:
                loop = rig.open(Path("/nonexistent"))
                loop.write_parameters(wanted(rig, loop, "new"))
            _SETS[kind, new] = _ripple_of(rig)
    return _SETS[kind, new]


def _differs(place: str, found: Mapping[str, float], wanted: Mapping[str, float]) -> str:
    wrong = [
        f"{name} is {found.get(name)} instead of {value}"
        for name, value in wanted.items()
        if name not in found or abs(found[name] - value) > 1e-5 * max(abs(value), 1e-3)
    ]
    return f"{place}: {'; '.join(wrong[:5])}" if wrong else ""
