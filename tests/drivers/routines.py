"""Routines that tests play; in a module of their own because they travel to the cyclic process."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from autotune.core.drive import HOLD, Command, Drive, Mode
from autotune.core.loop import Publish


@dataclass(frozen=True)
class Sine:
    """A position sine round where the axis is; returns the last position."""

    cycles: int
    amplitude: float = 0.2
    frequency: float = 1.0
    feedforward: float = 0.0
    labels: tuple[str, ...] = ("sine",)

    def __call__(self, drive: Drive, publish: Publish) -> float:
        drive.enable(Mode.POSITION)
        try:
            start = drive.step(HOLD).position
            position = start
            for k in range(self.cycles):
                phase = 2.0 * math.pi * self.frequency * k * drive.period
                target = start + self.amplitude * math.sin(phase)
                sample = drive.step(Command(target, torque_feedforward=self.feedforward))
                publish(sample, 0, 0)
                position = sample.position
            return position
        finally:
            drive.disable()


@dataclass(frozen=True)
class Endless:
    """Moves until it is stopped; writes what happened in its `finally` to a file."""

    witness: Path
    labels: tuple[str, ...] = ("endless",)

    def __call__(self, drive: Drive, publish: Publish) -> None:
        drive.enable(Mode.POSITION)
        try:
            start = drive.step(HOLD).position
            k = 0
            while True:
                target = start + 0.2 * math.sin(2.0 * math.pi * k * drive.period)
                publish(drive.step(Command(target)), 0, k)
                k += 1
                if k == 50:
                    self.witness.write_text("moving")
        finally:
            for _ in range(5):
                drive.step(HOLD)  # a routine may still step to come to rest
            drive.disable()
            self.witness.write_text("at rest")


@dataclass(frozen=True)
class Calls:
    """Calls a function of a module with the drive; for odd ends."""

    function: Callable[[Drive, Publish], Any]
    labels: tuple[str, ...] = ("call",)

    def __call__(self, drive: Drive, publish: Publish) -> Any:
        return self.function(drive, publish)


class Warmed:
    """Says whether `prepare` was called, and before power."""

    labels = ("warm",)

    def __init__(self) -> None:
        self.warm = False

    def prepare(self) -> None:
        self.warm = True

    def __call__(self, drive: Drive, publish: Publish) -> bool:
        return self.warm


def kill_self(drive: Drive, publish: Publish) -> None:
    drive.enable(Mode.POSITION)
    drive.step(HOLD)
    os.kill(os.getpid(), signal.SIGKILL)


def hang(drive: Drive, publish: Publish) -> None:
    """Stops stepping while power is on."""
    drive.enable(Mode.POSITION)
    drive.step(HOLD)
    time.sleep(1.0)
    drive.step(HOLD)


def unpicklable(drive: Drive, publish: Publish) -> Any:
    return lambda: None


class Odd(Exception):
    """Does not survive pickling."""

    def __init__(self, one: int, two: int) -> None:
        super().__init__(f"odd {one} {two}")


def odd(drive: Drive, publish: Publish) -> None:
    raise Odd(1, 2)


def wrong(drive: Drive, publish: Publish) -> float:
    return 1.0 / 0.0
