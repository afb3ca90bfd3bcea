"""The moteus drive against a simulated controller in a process of its own: guard, faults, cycle."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from autotune.core.drive import HOLD, Command, Mode
from autotune.core.errors import (
    DriveFault,
    HostLate,
    LinkError,
    StateError,
)
from autotune_drivers import open_loop
from autotune_drivers.moteus.drive import MoteusDrive
from autotune_drivers.moteus.multiplex import Form, write
from tests.drivers.contract import column, play, sine, where
from tests.drivers.moteus_rig import LINK, hold, moteus_axis, moteus_opener, settings
from tests.drivers.routines import Calls, Sine, kill_self
from tests.drivers.simulator import Simulator, simulator

SESSION = ("servo.timeout_mode", "servo.default_accel_limit", "autotune.period_s")


# The guard


def test_a_silent_host_is_stopped_by_the_watchdog_and_the_axis_can_be_used_again(running: Simulator) -> None:
    drive = moteus_opener(running.directory, watchdog=0.1)()
    try:
        mark = running.mark
        drive.enable(Mode.VELOCITY)
        for _ in range(199):
            drive.step(Command(velocity=3.0))
        last = time.monotonic()
        drive.step(Command(velocity=3.0))
        line = running.wait_for("quick stop begun (watchdog", mark, seconds=5.0)
        # 100 ms from a command that was sent after `last`, and what a loaded machine is late; the log's time is the
        # simulator's own
        assert 0.1 <= float(line.split()[0]) - last < 0.2
        with pytest.raises(HostLate, match="where 100 ms are allowed"):
            drive.step(HOLD)
        drive.disable()
        assert abs(column(play(drive, [HOLD] * 50), "velocity")).max() < 1.0
    finally:
        drive.close()


def test_a_controller_that_falls_silent_is_not_called_at_rest(
    running: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = moteus_opener(running.directory, watchdog=0.1)()
    try:
        drive.enable(Mode.POSITION)
        hold(drive, 20)
        monkeypatch.setattr(drive._exchange, "_take", lambda data: False)
        with pytest.raises(LinkError) as caught:
            hold(drive, 20)
        drive.disable()
        said = "; ".join([str(caught.value), *getattr(caught.value, "__notes__", [])])
        assert "was not confirmed" in said
        assert "emergency stop" in said
        monkeypatch.undo()
    finally:
        drive.close()


def test_a_controller_that_may_have_power_keeps_what_it_stops_by(
    running: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = moteus_opener(running.directory, watchdog=0.1)()
    set_back: list[str] = []

    def restore() -> list[str]:
        set_back.append("all")
        return []

    monkeypatch.setattr(drive._settings, "restore", restore)
    drive.enable(Mode.POSITION)
    hold(drive, 20)
    monkeypatch.setattr(drive._exchange, "stop", lambda seconds: None)
    with pytest.raises(LinkError, match=r"was not confirmed.*emergency stop"):
        drive.disable()
    with pytest.raises(LinkError, match=r"power may still be on.*emergency stop"):
        drive.close()
    assert set_back == []


def test_a_controller_that_confirms_its_stop_later_is_put_right_by_closing(running: Simulator) -> None:
    before = settings(running.directory)
    drive = moteus_opener(running.directory, watchdog=0.1)()
    drive.enable(Mode.POSITION)
    hold(drive, 20)
    with pytest.MonkeyPatch.context() as silence:
        silence.setattr(drive._exchange, "stop", lambda seconds: None)
        with pytest.raises(LinkError, match="was not confirmed"):
            drive.disable()
    drive.close()
    assert settings(running.directory) == before


def test_a_killed_cyclic_process_is_stopped_by_the_watchdog_and_put_right_by_the_next(
    running: Simulator,
) -> None:
    before = settings(running.directory)
    loop = open_loop(moteus_axis(), running.directory)
    try:
        mark = running.mark
        with pytest.raises(LinkError, match="has died"):
            loop.play(Calls(kill_self))
        killed = time.monotonic()
        line = running.wait_for("quick stop begun (watchdog", mark, seconds=5.0)
        assert float(line.split()[0]) - killed < 0.2
        assert loop.read_parameters(["controller.kp"])["controller.kp"] == pytest.approx(60.0)
        assert abs(loop.play(Sine(50))) < 100.0
    finally:
        loop.close()
    assert settings(running.directory) == before


def test_power_is_off_and_the_axis_at_rest_after_disable(drive: MoteusDrive, running: Simulator) -> None:
    drive.enable(Mode.VELOCITY)
    for _ in range(300):
        drive.step(Command(velocity=8.0))
    mark = running.mark
    drive.disable()
    assert running.wait_for("SWITCH_ON_DISABLED (stop commanded)", mark)
    first = where(drive)
    assert where(drive) == pytest.approx(first, abs=2e-3)


@pytest.mark.parametrize("mode", list(Mode))
def test_every_mode_begins_where_the_axis_is(drive: MoteusDrive, mode: Mode) -> None:
    start = where(drive)
    play(drive, [Command(start + 1e-3 * k) for k in range(500)])
    rest = {Mode.POSITION: HOLD, Mode.VELOCITY: Command(), Mode.TORQUE: Command(torque=0.048)}[mode]
    samples = play(drive, [rest] * 60, mode)
    assert np.ptp(column(samples, "position")) < 2e-2
    assert samples[0].position == pytest.approx(start + 0.499, abs=0.02)


def test_what_a_session_changes_is_put_back(running: Simulator) -> None:
    before = settings(running.directory)
    drive = moteus_opener(running.directory)()
    during = dict(drive._settings.console.enumerate())
    assert {name for name in before if before[name] != during[name]} <= set(SESSION)
    assert during["servo.timeout_mode"] == "10"
    drive.close()
    assert settings(running.directory) == before


# Faults


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("drive-fault", "motor driver"),
        ("enable-missing", "enable input"),
        ("brake-missing", "brake is not released"),
        ("hot", "over-temperature"),
    ],
)
def test_a_fault_is_said_in_words_and_power_is_off(
    running: Simulator, drive: MoteusDrive, fault: str, says: str
) -> None:
    drive.enable(Mode.POSITION)
    drive.step(HOLD)
    mark = running.mark
    running.order(fault)
    running.wait_for("fault put in", mark)
    with pytest.raises(DriveFault, match=says) as caught:
        hold(drive, 500)
    assert "while it was running" in str(caught.value)
    drive.disable()
    assert says in " ".join(drive.faults()).lower() or fault == "enable-missing"
    with pytest.raises((DriveFault, StateError)):
        drive.enable(Mode.POSITION)
    running.order("clear")
    port = drive._settings.node
    port.tell(write(Form.INT8, 0, [0]))
    assert drive.faults() == []


def test_a_blocked_axis_is_a_position_error_that_closing_clears(running: Simulator) -> None:
    drive = moteus_opener(running.directory)()
    start = where(drive)
    mark = running.mark
    running.order("blocked")
    running.wait_for("fault put in", mark)
    with pytest.raises(DriveFault, match="fault_position_error"):
        play(drive, [Command(start + 2e-3 * k) for k in range(1000)])
    assert "fault_position_error" in drive.faults()[0]
    running.order("clear")
    drive.close()
    with_another = moteus_opener(running.directory)()
    try:
        assert with_another.faults() == []
    finally:
        with_another.close()


def test_limits_of_the_controller_hold_the_position(drive: MoteusDrive) -> None:
    start = where(drive)
    before = drive.read_parameters(["limit.position_max"])
    drive.write_parameters({"limit.position_max": start + 0.05})
    try:
        samples = play(drive, [Command(start + 3e-4 * k) for k in range(400)])
    finally:
        drive.write_parameters(before)
    assert samples[-1].reference == pytest.approx(start + 0.05, abs=5e-4)


def test_where_the_torque_is_limited_the_shares_still_add_up(drive: MoteusDrive) -> None:
    start = where(drive)
    before = drive.read_parameters(["limit.torque"])
    drive.write_parameters({"limit.torque": 0.2})
    try:
        samples = play(drive, [Command(start + 5e-4 * k, torque_feedforward=0.05) for k in range(200)])
    finally:
        drive.write_parameters(before)
    command = column(samples, "torque_command")
    assert abs(command).max() == pytest.approx(0.2, abs=1e-3)
    shares = column(samples, "torque_feedforward") + column(samples, "torque_feedback")
    assert shares == pytest.approx(command, abs=1e-6)
    assert column(samples, "torque_feedforward") == pytest.approx(0.05, abs=1e-5)


# The cycle and the way of counting


def test_a_longer_cycle_moves_the_axis_by_its_period(running: Simulator) -> None:
    drive = moteus_opener(running.directory, cycle=0.002)()
    try:
        start = where(drive)
        samples = play(drive, [Command(start + 2e-3 * k) for k in range(400)])
    finally:
        drive.close()
    speed = np.diff(column(samples, "position"))[200:].mean() / 0.002
    assert speed == pytest.approx(1.0, abs=0.02)
    assert np.diff(column(samples, "time")) == pytest.approx(0.002, rel=1e-6)


def test_an_axis_that_counts_backwards_is_the_same_axis(running: Simulator) -> None:
    axis = moteus_axis(LINK)
    mechanics = axis.mechanics.model_copy(update={"direction": -1})
    forwards = moteus_opener(running.directory)()
    expected = (where(forwards), forwards.read_parameters(["limit.position_min", "limit.position_max"]))
    forwards.close()
    drive = moteus_opener(running.directory, mechanics=mechanics)()
    try:
        start = where(drive)
        samples = play(drive, sine(600, start, feedforward=0.05))
        limits = drive.read_parameters(["limit.position_min", "limit.position_max"])
    finally:
        drive.close()
    assert start == pytest.approx(-expected[0], abs=5e-3)
    assert limits["limit.position_min"] == pytest.approx(-expected[1]["limit.position_max"])
    error = column(samples, "reference") - column(samples, "position")
    assert abs(error).max() < 5e-3
    shares = column(samples, "torque_feedforward") + column(samples, "torque_feedback")
    assert shares == pytest.approx(column(samples, "torque_command"), abs=1e-6)
    assert column(samples, "torque_feedforward")[50:] == pytest.approx(0.05, abs=6e-4)


@pytest.mark.parametrize("beside", ["a cycle", "the stop"])
def test_a_host_that_is_late_finds_its_axis_where_it_was_told_to_be(tmp_path: Path, beside: str) -> None:
    """5 rad/s, 60 ms without command: the demand waits two cycles ahead; thrown back by 0.3 rad, it shows 20 rad/s."""
    with simulator(tmp_path, "--link", "moteus", "--node", "1", "--real-time"):
        drive = moteus_opener(tmp_path)()
        try:
            start = where(drive)
            commands = [Command(start + 5e-3 * k) for k in range(200)]
            drive.enable(Mode.POSITION)
            for command in commands[:150]:
                drive.step(command)
            time.sleep(0.06)
            samples = [drive.step(command) for command in commands[150:]] if beside == "a cycle" else []
            drive.disable()
            after = where(drive)
        finally:
            drive.close()
    if samples:
        assert samples[0].missed >= 50
        assert max(abs(sample.velocity) for sample in samples) < 10.0
    assert abs(after - commands[199 if samples else 149].position) < 0.2


def test_in_real_time_missed_cycles_are_counted(tmp_path: Path) -> None:
    with simulator(tmp_path, "--link", "moteus", "--node", "1", "--real-time"):
        drive = moteus_opener(tmp_path)()
        try:
            assert not drive.lock_step
            samples = play(drive, sine(500, where(drive)))
        finally:
            drive.close()
    steps = np.diff(column(samples, "time")) / drive.period
    assert steps == pytest.approx(1.0 + column(samples, "missed")[1:], abs=1e-6)
    error = column(samples, "reference") - column(samples, "position")
    assert np.median(np.abs(error)) < 5e-3
