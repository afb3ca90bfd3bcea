"""The moteus drive on lines that drip, lose, change and carry more than ours."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
import serial

from autotune.core.arrays import Flags, Floats
from autotune.core.drive import HOLD, Mode
from autotune.core.errors import (
    LinkError,
)
from autotune_drivers.moteus.drive import MoteusDrive
from autotune_drivers.moteus.line import Line
from autotune_drivers.moteus.opening import open_controller
from autotune_drivers.moteus.port import MoteusPort, open_port
from tests.drivers.contract import column, play, sine, where
from tests.drivers.moteus_rig import hold, moteus_opener
from tests.drivers.simulator import Simulator


class Dripping:
    """A serial port that hands over a few bytes at a time, as a real one at its speed does."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self.baudrate = port.baudrate
        self.write = port.write
        self.close = port.close
        self.fileno = port.fileno

    def read(self, size: int) -> bytes:
        return bytes(self._port.read(7))


class Noisy:
    """A serial port on which bytes change and get lost, both ways, in ways that a reader can see.

    The line has no checksum: a hexadecimal digit that became another one is obeyed, here and in a real
    controller (a shorter watchdog, a stop), and nobody can tell. So a byte that changes leaves the alphabet,
    and one that gets lost leaves an odd number of digits, a word that is none, or two lines in one.
    """

    def __init__(self, port: serial.Serial, chance: random.Random, rate: float) -> None:
        self._port, self._chance, self._rate = port, chance, rate
        self.baudrate = port.baudrate
        self.hits = 0

    def fileno(self) -> int:
        return int(self._port.fileno())

    def close(self) -> None:
        self._port.close()

    def _spoil(self, data: bytes) -> bytes:
        if not data or self._chance.random() > self._rate:
            return data
        self.hits += 1
        at = self._chance.randrange(len(data))
        sort = self._chance.randrange(3)
        if sort == 0:
            return data[:at] + bytes((data[at] ^ 0x80,)) + data[at + 1 :]
        return data[:at] + data[at + 1 :] if sort == 1 else b"rcv 10\x00" + data

    def read(self, size: int) -> bytes:
        return self._spoil(self._port.read(size))

    def write(self, data: bytes) -> None:
        self._port.write(self._spoil(data))


def away_from_standstills(missed: Floats, longest: int = 10, after: int = 100) -> Flags:
    """Rows that no standstill of the test machine precedes: noise loses a cycle or two, not `longest` in a row."""
    stood = np.convolve(missed > longest, np.ones(after), mode="full")[: missed.size]
    return stood < 0.5


def noisy_drive(directory: Path, rate: float, watchdog: float = 1.0) -> tuple[MoteusDrive, Noisy]:
    opener = moteus_opener(directory, watchdog=watchdog)
    quiet = open_port(directory / "edm.tty", 921600)
    noise = Noisy(quiet._port, random.Random(5), rate)
    port = MoteusPort(noise, quiet.name, quiet._lock)
    return open_controller(port, 1, opener.axis, opener.profile), noise


def test_lines_may_come_a_few_bytes_at_a_time(running: Simulator) -> None:
    opener = moteus_opener(running.directory)
    quiet = open_port(running.directory / "edm.tty", 921600)
    port = MoteusPort(Dripping(quiet._port), quiet.name, quiet._lock)
    drive = open_controller(port, 1, opener.axis, opener.profile)
    try:
        samples = play(drive, sine(300, where(drive)))
        assert port.reader.garbled == 0
    finally:
        drive.close()
    assert int(column(samples, "missed").sum()) <= 1  # none but for a test machine that stood still


def test_a_line_that_loses_and_changes_bytes_still_carries_a_motion(running: Simulator) -> None:
    drive, noise = noisy_drive(running.directory, 0.01, watchdog=20.0)
    try:
        samples = play(drive, sine(1500, where(drive)))
        names = ["controller.kp", "feedforward.coulomb"]
        assert drive.read_parameters(names) == pytest.approx(
            {"controller.kp": 60.0, "feedforward.coulomb": 0.0}
        )
    finally:
        drive.close()
    assert noise.hits > 20
    error = column(samples, "reference") - column(samples, "position")
    # a garbled command is not executed, a garbled reply is: its cycle is missing and counted
    settled = away_from_standstills(column(samples, "missed"))
    assert settled.mean() > 0.5
    assert abs(error[settled]).max() < 8e-3
    steps = np.diff(column(samples, "time")) / drive.period
    assert steps == pytest.approx(1.0 + column(samples, "missed")[1:], abs=1e-6)


def test_a_line_that_is_only_noise_ends_in_words_and_at_rest(running: Simulator) -> None:
    drive, noise = noisy_drive(running.directory, 0.0, watchdog=0.15)
    mark = running.mark
    drive.enable(Mode.POSITION)
    drive.step(HOLD)
    noise._rate = 1.0
    with pytest.raises(LinkError, match="cable"):
        hold(drive, 100)
    noise._rate = 0.0
    drive.disable()
    drive.close()
    running.wait_for("SWITCH_ON_DISABLED", mark)


def test_another_talker_on_the_line_is_passed_over(
    drive: MoteusDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames of other controllers, of this one to another host, and replies to other queries."""
    strangers = [
        Line("rcv", 0x0200, bytes.fromhex("21000a2f01000000000000000000000000")),
        Line("rcv", 0x0105, bytes.fromhex("21000a")),
        Line("rcv", 0x0100, bytes.fromhex("230d181400")),
        Line("rcv", 0x0100, b""),
    ]
    plain = MoteusPort.lines

    def talkative(self: MoteusPort, timeout: float) -> list[Line]:
        return [entry for line in plain(self, timeout) for entry in (*strangers, line, *strangers)]

    monkeypatch.setattr(MoteusPort, "lines", talkative)
    samples = play(drive, sine(300, where(drive)))
    assert int(column(samples, "missed").sum()) <= 1  # none but for a test machine that stood still
    error = column(samples, "reference") - column(samples, "position")
    assert abs(error).max() < 5e-3
