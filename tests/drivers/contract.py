"""What every link has to do: one suite, subclassed for each. `drive` is a fixture of the subclass.

The axis is the vertical one of the thesis, at rest, without power, with its own gains.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from autotune.core.drive import HOLD, Command, CutsPower, Drive, Mode, Sample
from autotune.core.errors import (
    AutotuneError,
    ConfigurationError,
    DriveError,
    DriveFault,
    HostLate,
    StateError,
)

Hurt = Callable[[Drive], None]
AMPLITUDE = 0.2
MISTYPED = ("feedforward.colomb", r"feedforward\.coulomb")
RESOLUTION = 2.0 * math.pi / 50000.0


def play(drive: Drive, commands: list[Command], mode: Mode = Mode.POSITION) -> list[Sample]:
    """The samples of `commands`, power off afterwards."""
    drive.enable(mode)
    try:
        return [drive.step(command) for command in commands]
    finally:
        drive.disable()


def sine(cycles: int, start: float, feedforward: float = 0.0) -> list[Command]:
    return [
        Command(
            start + AMPLITUDE * math.sin(2.0 * math.pi * k * 1e-3),
            torque_feedforward=feedforward,
        )
        for k in range(cycles)
    ]


def turn(drive: Drive, cycles: int) -> None:
    """At 5 rad/s, with power on."""
    for _ in range(cycles):
        drive.step(Command(velocity=5.0))


def where(drive: Drive) -> float:
    return play(drive, [HOLD])[0].position


def column(samples: list[Sample], name: str) -> NDArray[np.float64]:
    return np.array([getattr(sample, name) for sample in samples], dtype=np.float64)


class Shape:
    """What every drive has in common, also one that only replays."""

    def test_is_a_drive(self, drive: Drive) -> None:
        assert isinstance(drive, Drive)
        assert drive.period == pytest.approx(1e-3)
        assert {"vendor", "product"} <= set(drive.identity)

    def test_time_advances_by_one_period_a_cycle(self, drive: Drive) -> None:
        samples = play(drive, [HOLD] * 50)
        steps = np.diff(column(samples, "time"))
        missed = column(samples, "missed")[1:]
        assert steps == pytest.approx((1.0 + missed) * drive.period, rel=1e-6)

    def test_a_step_without_power_is_refused(self, drive: Drive) -> None:
        with pytest.raises(AutotuneError):
            drive.step(HOLD)

    def test_enabling_twice_is_refused_or_harmless_and_power_goes(self, drive: Drive) -> None:
        drive.enable(Mode.POSITION)
        try:
            drive.enable(Mode.POSITION)
        except StateError:
            with pytest.raises(AutotuneError):
                drive.step(HOLD)
        finally:
            drive.disable()

    def test_looking_moves_nothing_and_tells_where_the_axis_is(self, drive: Drive) -> None:
        looks = [drive.look() for _ in range(3)]
        assert all(abs(look.velocity) < 0.2 for look in looks)
        assert play(drive, [HOLD])[0].position == pytest.approx(looks[-1].position, abs=0.01)

    def test_a_command_that_is_no_number_never_reaches_the_axis(self, drive: Drive) -> None:
        drive.enable(Mode.VELOCITY)
        try:
            with pytest.raises((DriveError, ConfigurationError)):
                drive.step(Command(velocity=math.nan))
        finally:
            drive.disable()

    def test_an_unknown_parameter_is_named_with_the_nearest(self, drive: Drive) -> None:
        mistyped, meant = MISTYPED
        with pytest.raises(ConfigurationError, match=meant):
            drive.read_parameters([mistyped])

    def test_close_is_idempotent(self, drive: Drive) -> None:
        drive.close()
        drive.close()
        with pytest.raises(AutotuneError):
            drive.step(HOLD)


class Contract(Shape):
    """Behaviour of a `Drive`, whatever is behind it.

    `fault` is a fixture of the subclass: called, it puts an over-current into the drive, at once; afterwards
    the drive is in order again.
    """

    def test_a_fault_while_power_is_taken_off_is_told(self, fault: Hurt, drive: Drive) -> None:
        """Off is off, but "the drive runs with what was committed" would be a lie."""
        drive.enable(Mode.VELOCITY)
        turn(drive, 200)
        fault(drive)
        with pytest.raises(DriveFault, match=r"while .*current"):
            drive.disable()
        with pytest.raises(AutotuneError):
            drive.step(HOLD)
        drive.disable()  # told once
        assert drive.faults()

    def test_a_fault_that_was_told_is_not_told_again_as_another(self, fault: Hurt, drive: Drive) -> None:
        drive.enable(Mode.VELOCITY)
        turn(drive, 50)
        fault(drive)
        with pytest.raises(DriveFault, match="current"):
            turn(drive, 50)
        drive.disable()

    def test_enable_holds_the_present_position(self, drive: Drive) -> None:
        samples = play(drive, [HOLD] * 100)
        position = column(samples, "position")
        # gravity and static friction let the axis settle by a fraction of a degree at most
        assert np.ptp(position) < 5e-3
        assert abs(column(samples, "velocity")).max() < 1.0

    def test_no_jump_where_the_axis_stands_away_from_zero(self, drive: Drive) -> None:
        start = where(drive)
        away = [Command(start + 0.5 * min(k / 300.0, 1.0)) for k in range(400)]
        play(drive, away)
        samples = play(drive, [HOLD] * 50)
        assert samples[0].position == pytest.approx(start + 0.5, abs=0.02)
        assert np.ptp(column(samples, "position")) < 5e-3

    def test_follows_a_sine_as_the_thesis_measured(self, drive: Drive) -> None:
        samples = play(drive, sine(2000, where(drive)))
        error = column(samples, "reference") - column(samples, "position")
        # table 6.3's PID: about 2 mrad; a mispaired reference would show as 1.3 mrad more
        assert 1.2e-3 < np.abs(error[1000:]).max() < 3.2e-3

    def test_reference_is_what_was_commanded_in_the_same_cycle(self, drive: Drive) -> None:
        commands = sine(300, where(drive))
        samples = play(drive, commands)
        told = np.array([command.position for command in commands])
        assert column(samples, "reference") == pytest.approx(told, abs=RESOLUTION)

    def test_torques_add_up(self, drive: Drive) -> None:
        samples = play(drive, sine(500, where(drive), feedforward=0.05))
        total = column(samples, "torque_feedforward") + column(samples, "torque_feedback")
        assert total == pytest.approx(column(samples, "torque_command"), abs=1e-6)
        assert column(samples, "torque_feedforward")[50:] == pytest.approx(0.05, abs=6e-4)

    def test_feedforward_relieves_the_controller(self, drive: Drive) -> None:
        start = where(drive)
        ramp = [Command(start + 1e-3 * k, torque_feedforward=0.1 * (k > 700)) for k in range(1400)]
        feedback = column(play(drive, ramp), "torque_feedback")
        # at a steady 1 rad/s friction is what it is, but for ripple of 2 x 0.01 N m, averaged over 0.4 s;
        # at standstill stiction would keep any part of it
        assert feedback[300:700].mean() - feedback[1000:].mean() == pytest.approx(0.1, abs=0.015)

    def test_controller_acts_on_the_error_of_the_same_sample(self, drive: Drive) -> None:
        """u = kp·e + kd·d + ki·Σe·h with this sample's e: its increments tell, whatever the sum was."""
        gains = drive.read_parameters(
            ["controller.kp", "controller.kd", "controller.ki", "controller.derivative_filter"]
        )
        kp, kd, ki, share = gains.values()
        samples = play(drive, sine(1500, where(drive)))[500:]
        reference, position = column(samples, "reference"), column(samples, "position")
        error, rate = reference - position, np.diff(reference - position, prepend=0.0) / drive.period
        derivative = np.zeros_like(error)
        for k in range(1, len(error)):
            derivative[k] = derivative[k - 1] + share * (rate[k] - derivative[k - 1])
        expected = kp * np.diff(error) + kd * np.diff(derivative) + ki * error[1:] * drive.period
        found = np.diff(column(samples, "torque_feedback"))
        # after 100 samples the derivative has forgotten its unknown start; the wire resolves 1 µN m,
        # in thousandths of the rated torque 0.5 mN m
        assert found[100:] == pytest.approx(expected[100:], abs=1.5e-3)

    def test_velocity_mode_turns_at_the_speed_asked_for(self, drive: Drive) -> None:
        samples = play(drive, [Command(velocity=2.0)] * 800, Mode.VELOCITY)
        assert column(samples, "velocity")[-200:].mean() == pytest.approx(2.0, abs=0.2)

    def test_torque_mode_gives_the_torque_asked_for(self, drive: Drive) -> None:
        samples = play(drive, [Command(torque=0.05)] * 100, Mode.TORQUE)
        assert column(samples, "torque_command")[10:] == pytest.approx(0.05, abs=6e-4)
        assert column(samples, "torque")[10:].mean() == pytest.approx(0.05, abs=5e-3)

    def test_disable_is_idempotent_and_stops_a_moving_axis(self, drive: Drive) -> None:
        drive.disable()
        drive.enable(Mode.VELOCITY)
        for _ in range(300):
            drive.step(Command(velocity=5.0))
        drive.disable()
        drive.disable()
        first = where(drive)
        assert where(drive) == pytest.approx(first, abs=5e-3)

    def test_power_can_be_cut_while_the_axis_moves_and_asked_for_again(self, drive: Drive) -> None:
        """What an axis whose encoder lies needs: no ramp, no held position; afterwards all is as after `disable`."""
        assert isinstance(drive, CutsPower)
        drive.enable(Mode.VELOCITY)
        turn(drive, 100)
        drive.cut()
        drive.cut()
        with pytest.raises(StateError):
            drive.step(Command(velocity=5.0))
        held = play(drive, [HOLD] * 400)  # one without a brake still coasts when power comes back
        assert abs(held[-1].velocity) < 0.5

    def test_reads_all_parameters_that_it_knows(self, drive: Drive) -> None:
        values = drive.read_parameters()
        assert {"limit.torque", "controller.kp", "feedforward.coulomb"} <= set(values)
        assert values["controller.kp"] == pytest.approx(60.0)
        assert values["limit.torque"] == pytest.approx(1.34, rel=1e-3)
        assert drive.read_parameters(["controller.ki"]) == {"controller.ki": pytest.approx(6000.0)}

    def test_writes_and_reads_back(self, drive: Drive) -> None:
        before = drive.read_parameters(["feedforward.coulomb", "limit.speed"])
        try:
            drive.write_parameters({"feedforward.coulomb": 0.25, "limit.speed": 20.0})
            found = drive.read_parameters(["feedforward.coulomb", "limit.speed"])
            assert found["feedforward.coulomb"] == pytest.approx(0.25, rel=1e-6)
            assert found["limit.speed"] == pytest.approx(20.0, rel=1e-3)
        finally:
            drive.write_parameters(before)

    def test_a_value_out_of_range_writes_nothing_at_all(self, drive: Drive) -> None:
        before = drive.read_parameters(["controller.kp"])
        with pytest.raises(ConfigurationError, match=r"limit\.torque"):
            drive.write_parameters({"controller.kp": 50.0, "limit.torque": 1e9})
        with pytest.raises(ConfigurationError):
            drive.write_parameters({"controller.kp": math.nan})
        assert drive.read_parameters(["controller.kp"]) == before

    def test_has_no_faults_and_stores(self, drive: Drive) -> None:
        assert drive.faults() == []
        drive.store()


class Wired(Contract):
    """What is asked of a drive that watches its host by the clock.

    Attributes:
        patience: silence after which it stops its axis [s].
    """

    patience = 0.15

    def test_a_host_that_was_held_up_is_told_as_such_and_may_go_on(self, drive: Drive) -> None:
        drive.enable(Mode.VELOCITY)
        turn(drive, 50)
        time.sleep(1.5 * self.patience + 0.1)
        with pytest.raises(HostLate, match=r"this host was late.*load.*real-time priority") as caught:
            turn(drive, 50)
        assert caught.value.seconds >= self.patience
        drive.disable()
        assert len(play(drive, [HOLD] * 20)) == 20
