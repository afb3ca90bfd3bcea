"""An encoder that begins to tell a tenth in slow strokes is caught by what its loop's swing weighs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autotune.core.drive import Command, Mode
from autotune.core.errors import GuardStop
from autotune.experiments.fine_inertia import FineInertia
from autotune.experiments.guard import Guard
from autotune.experiments.swing_watch import SwingWatch, shown_inertia, sticks
from tests.experiments.hurt_axis import Hurt, HurtDrive, Mass
from tests.experiments.support import axis

AXIS = axis()
H, COUNT = AXIS.cycle, AXIS.position_resolution
INERTIA = 6.66e-4
SLOW = 0.3  # rad/s


def strokes(drive: HurtDrive, seconds: float, *, length: float = 0.6, watched: bool = True) -> float:
    """Slow strokes to and fro under a guard; the time at which it stopped them [s], or `seconds`."""
    guard = Guard(AXIS.limits, H, COUNT)
    drive.enable(Mode.POSITION)
    sample = drive.step(Command())
    guard.begin(Mode.POSITION, sample)
    start, target, way = sample.position, sample.position, SLOW * H
    for k in range(round(seconds / H)):
        if abs(target + way - start) > length:
            way = -way
        target += way
        command = Command(position=target)
        try:
            guard.check(sample, command)
        except GuardStop as stop:
            return k * H if stop.blind else -1.0
        sample = drive.step(command)
    return seconds


@pytest.mark.parametrize("at", [5.3, 6.9])
def test_an_encoder_that_begins_to_tell_a_tenth_in_slow_strokes_is_caught_soon(at: float) -> None:
    drive = HurtDrive(AXIS, hurt=Hurt("scaled", at, 0.1))
    stopped = strokes(drive, at + 2.0)
    assert at < stopped < at + 0.3
    assert drive.fastest < AXIS.limits.speed


@pytest.mark.parametrize("inertia", [2e-4, 6.66e-4, 2e-3])
def test_slow_strokes_show_the_inertia_within_a_factor_of_two(inertia: float) -> None:
    gains = tuple(gain * inertia / INERTIA for gain in (60.0, 0.15, 6000.0))
    where = AXIS.model_copy(
        update={"mechanics": AXIS.mechanics.model_copy(update={"counts_per_revolution": 16_000})}
    )
    drive = HurtDrive(where, mass=Mass(inertia=inertia, bends=3e-4), gains=gains)
    fine = FineInertia(1.34, H, where.position_resolution)
    drive.enable(Mode.POSITION)
    target, way = 0.0, SLOW * H
    sample = drive.step(Command())
    for _ in range(6000):
        way = -way if abs(target + way) > 0.6 else way
        target += way
        torque = sample.torque_command
        sample = drive.step(Command(position=target))
        fine.add(sample.position, torque, H)
    assert inertia / 2.0 < fine.inertia < 2.0 * inertia


def test_silence_and_lost_cycles_show_nothing() -> None:
    fine = FineInertia(1.34, H, COUNT)
    for k in range(3000):
        fine.add(0.0, math.sin(k), H)
    assert fine.inertia == 0.0
    lossy = FineInertia(1.34, H, COUNT)
    assert not any(lossy.add(1e-3 * k, math.sin(k), 2.0 * H) for k in range(3000))


def swing(
    torque: float, inertia: float, seconds: float, drift: float = 0.0
) -> list[tuple[float, float, float]]:
    """Time, position and torque of a mass that swings at 20 Hz about a reference."""
    w = 2.0 * math.pi * 20.0
    times = np.arange(0.0, seconds, H)
    return [
        (t, drift * t - torque / (inertia * w**2) * math.sin(w * t), torque * math.sin(w * t)) for t in times
    ]


@pytest.mark.parametrize(("known", "told"), [(1e-3, 0.0), (1e-4, 6.66e-4)])
def test_only_a_swing_of_an_axis_that_is_too_heavy_is_told(known: float, told: float) -> None:
    watch = SwingWatch(1.34, INERTIA, COUNT)
    watch.know(0.2)
    watch.weigh(known, quiet=False)
    watch.weigh(known, quiet=False)
    watch.begin(0.0, 0.0, 0.0)
    found = [watch.check(q, SLOW * t, torque, H) for t, q, torque in swing(0.5, INERTIA, 0.5)]
    assert max(found) == pytest.approx(told, rel=0.1)


@pytest.mark.parametrize(("torque", "halves"), [(0.5, 2), (0.25, 3)])
def test_two_full_halves_of_a_swing_are_enough(torque: float, halves: int) -> None:
    """A half counts twice at most: two that count so much are as good as three."""
    watch = SwingWatch(1.34, INERTIA, COUNT)
    watch.know(0.2)
    watch.weigh(1e-4, quiet=False)  # what is told first counts at once
    watch.begin(0.0, 0.0, 0.0)
    found = [watch.check(q, 0.0, u, H) for _, q, u in swing(torque, INERTIA, 0.5)]
    told = next(k for k, inertia in enumerate(found) if inertia > 0.0)
    assert (
        12 + 25 * (halves - 2) < told < 13 + 25 * (halves - 1)
    )  # ms, within the last half; the first is short


def test_a_swing_that_the_reference_asks_for_or_that_dies_away_is_none() -> None:
    for reference, decay in ((1.0, 0.0), (0.0, 40.0)):
        watch = SwingWatch(1.34, INERTIA, COUNT)
        watch.know(0.2)
        watch.weigh(1e-5, quiet=False)
        watch.weigh(1e-5, quiet=False)
        watch.begin(0.0, 0.0, 0.0)
        for t, q, torque in swing(0.5, INERTIA, 0.5):
            left = math.exp(-decay * t)
            assert watch.check(q * left, reference * q, torque * left, H) == 0.0


def test_the_slope_of_impulse_over_velocity_is_the_inertia_whatever_friction_does() -> None:
    rows = swing(0.5, INERTIA, 0.1, drift=0.3)
    impulse = np.cumsum([torque + 0.33 for _, _, torque in rows]) * H
    samples = np.column_stack(([t for t, _, _ in rows], impulse, [q for _, q, _ in rows]))
    assert shown_inertia(samples) == pytest.approx(INERTIA, rel=0.05)
    assert shown_inertia(samples[:5]) == 0.0


def test_an_axis_that_sticks_and_slips_is_told_from_one_that_swings() -> None:
    """Regression: friction that holds a sound axis most of the time was weighed as its inertia."""
    time = np.arange(0.0, 0.2, H)
    swings = np.column_stack((time, 0.0 * time, 0.01 * np.sin(2.0 * np.pi * 10.0 * time)))
    slips = swings.copy()
    slips[:, 2] = 0.02 * np.clip((time - 0.1) / 0.015, 0.0, 1.0) + 0.01 * time
    assert not sticks(swings)
    assert sticks(slips)
