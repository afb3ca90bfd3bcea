"""The thesis's inertial drive: Figure 6.4 in figures, what limits a step, and what cannot be asked of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from autotune.core.errors import ConfigurationError
from autotune.identify.fit import fit
from autotune.recordings.recording import Metadata, Recording
from autotune_sim.inertial_drive import (
    LOAD,
    ROW,
    STACK,
    InertialDrive,
    SimpleControl,
    mixed_steps,
    step_size,
    step_voltage,
)
from autotune_sim.presets import preset
from autotune_sim.servo import Servo

PATH = Path(__file__).parents[2] / "config" / "machines" / "inertial-drive.toml"


def test_twenty_micrometres_in_eleven_steps_then_the_stack_alone() -> None:
    """Figure 6.4: stepping, then scanning into a few micrometres and on to the reference."""
    motion, steps = SimpleControl().go(InertialDrive(PATH), 20e-6, 0.1)
    assert 10 <= steps <= 12
    assert motion.position[-1, LOAD] == pytest.approx(20e-6, abs=0.05e-6)
    rate = SimpleControl().rate
    assert 0.85 * 600.0 <= rate <= 1.15 * 600.0


def test_the_load_swings_on_the_ball_near_six_hundred_hertz() -> None:
    """Between the load on the ball with a guide that slides (488 Hz) and with one that holds (840 Hz)."""
    drive = InertialDrive(PATH)
    machine = drive.machine
    root = np.sqrt(np.array(machine.mass))
    held = np.sqrt(np.linalg.eigvalsh(machine.stiffness / np.outer(root, root))[0]) / (2 * np.pi)
    assert drive.resonance < 600.0 < held


def test_steps_backwards_are_steps_forwards_mirrored() -> None:
    there, back = (step_size(InertialDrive(PATH), amplitude=a, rate=510.0) for a in (6.5, -6.5))
    assert there == pytest.approx(1.8e-6, rel=0.15)
    assert back == pytest.approx(-there, rel=0.02)


def test_a_force_against_the_load_takes_from_every_step() -> None:
    sizes = [
        step_size(InertialDrive(PATH, force=f), amplitude=6.5, rate=510.0)
        for f in (-2.0, -1.0, 0.0, 1.0, 2.0)
    ]
    assert all(a > b for a, b in pairwise(sizes))


def test_a_heavier_load_stays_more_in_place_at_a_slow_rate() -> None:
    sizes = [
        step_size(InertialDrive(PATH, load=m), amplitude=5.0, rate=100.0) for m in (0.7, 1.0, 1.3, 1.6, 3.0)
    ]
    assert all(a < b for a, b in pairwise(sizes))


def test_the_amplifiers_current_limits_single_steps() -> None:
    """At 100 Hz nothing swings on from step to step: with 0.5 A below 0.5 µm, with 5 A the flyback drags nothing."""
    slow = InertialDrive(PATH)
    fast = InertialDrive(PATH)
    amplifier = fast.machine.amplifier
    assert amplifier is not None
    fast._packed["machine_amplifier"][0, 3] = 10.0 * amplifier.current
    sizes = [step_size(drive, amplitude=5.0, rate=100.0) for drive in (slow, fast)]
    assert sizes[0] == pytest.approx(0.42e-6, rel=0.15)
    assert sizes[1] > 5.0 * sizes[0]


def test_cycloids_step_too() -> None:
    assert step_size(InertialDrive(PATH), amplitude=3.0, rate=510.0, waveform="cycloid") > 0.5e-6


@pytest.mark.parametrize("amplitude", [1.0, 3.0, 5.0])
def test_scanning_loses_nothing(amplitude: float) -> None:
    """Up to the amplifier's 5 V at 10 Hz: the load goes with the stack and comes back to where it was."""
    drive = InertialDrive(PATH)
    rows = round(0.1 / ROW)
    scan = drive.play(amplitude * np.sin(2 * np.pi * np.arange(3 * rows) / rows)).position
    last = scan[-rows:]
    # the ball yields under the guide's friction, both ways: 2 (0.6 N + 500 N s/m × 0.2 mm/s) / 10 N/µm
    assert np.ptp(last[:, STACK]) - np.ptp(last[:, LOAD]) < 0.15e-6
    assert abs(scan[-1, LOAD] - scan[-1 - rows, LOAD]) < 0.01e-6


def test_finer_integration_changes_nothing() -> None:
    coarse, fine = InertialDrive(PATH), InertialDrive(PATH)
    fine._steps *= 4
    from autotune_sim.machine import pack_machine

    pack_machine(fine._packed, fine.machine, ROW / fine._steps)
    sizes = [step_size(drive, amplitude=6.5, rate=510.0, steps=6) for drive in (coarse, fine)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.05)  # first order in the step


def test_behind_a_drive_the_stack_holds_the_load_in_place() -> None:
    servo = Servo(replace(preset(str(PATH)), period=1e-3))
    servo.power(True)
    for _ in range(400):
        servo.cycle(target_position=2e-6)
    assert servo.position == pytest.approx(2e-6, abs=0.15e-6)


def test_what_it_cannot_do_is_said() -> None:
    with pytest.raises(ConfigurationError, match=r"does not follow beyond.*610"):
        step_size(InertialDrive(PATH), amplitude=5.0, rate=900.0)
    with pytest.raises(ConfigurationError, match=r"allowed are ±5 V"):
        InertialDrive(PATH).play(np.array([6.0]))
    with pytest.raises(ConfigurationError, match="no inertial drive"):
        InertialDrive(PATH.with_name("two-carriages.toml"))
    assert np.abs(step_voltage(8.0, 510.0, 1)).max() <= 4.0


@pytest.mark.slow
def test_its_contact_is_identified_from_its_own_recording() -> None:
    """Six tenths of a second at 50 kHz, integrated as coarsely as elsewhere: friction, stiffness and inertia.

    The integration is of first order: it adds its step times the contact's damping to the slider's mass, 5 %.
    """
    drive = InertialDrive(PATH)
    record = drive.contact_record(mixed_steps(0.6, seed=5), seed=5)
    columns = {"time": record.time, "position": record.slip, "torque": record.force}
    metadata = Metadata(motion_unit="m", sample_period=ROW, position_resolution=1e-9)
    found = fit(Recording.from_columns(columns, metadata, "steps")).model
    step = ROW / drive._steps
    assert found["inertia"] == pytest.approx(0.0624 + step * 2200.0, rel=0.03)
    assert found["coulomb"] == pytest.approx(10.0, rel=0.02)
    assert found["stiffness"] == pytest.approx(2e8, rel=0.03)
