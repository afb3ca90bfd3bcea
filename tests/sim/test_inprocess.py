"""The in-process drive keeps the Drive contract: power, limits, faults, parameters, rehearsals."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
import pytest

from autotune.core.drive import HOLD, Command, Drive, Mode
from autotune.core.errors import (
    ConfigurationError,
    DriveError,
    DriveFault,
    LinkError,
    LinkTimeout,
    StateError,
    TransferAborted,
)
from autotune_sim.inprocess import SimDrive, open_sim
from autotune_sim.rehearsal import REHEARSALS

H = 1e-3


@pytest.fixture
def drive() -> SimDrive:
    return open_sim("sim://edm-vertical?seed=3")


def run(drive: SimDrive, seconds: float, speed: float = 0.5, start: float | None = None) -> float:
    """Moves at constant speed; the last target."""
    begin = drive.step(HOLD).position if start is None else start
    target = begin
    for k in range(round(seconds / H)):
        target = begin + speed * k * H
        drive.step(Command(position=target))
    return target


def push(drive: SimDrive, torque: float) -> None:
    """Five seconds of constant torque."""
    for _ in range(5000):
        drive.step(Command(torque=torque))


def at_rest(drive: SimDrive) -> bool:
    """No power, and the axis does not move."""
    before = drive.servo.position
    for _ in range(50):
        drive.servo.idle()
    return not drive.servo.powered and abs(drive.servo.position - before) < 1e-3


def test_it_is_a_drive(drive: SimDrive) -> None:
    assert isinstance(drive, Drive)
    assert drive.period == H
    assert drive.identity["serial"] == 1003


def test_a_sample_is_consistent(drive: SimDrive) -> None:
    drive.enable(Mode.POSITION)
    first = drive.step(HOLD)
    assert first.reference == first.position
    samples = [drive.step(Command(0.1 * math.sin(6.28 * k * H), 0, 0, 0.02)) for k in range(500)]
    assert np.diff([s.time for s in samples]) == pytest.approx(H)
    for s in samples:
        assert s.torque_feedforward == pytest.approx(0.02)
        assert s.torque_feedback == pytest.approx(s.torque_command - s.torque_feedforward)
        assert abs(s.torque_command) <= 1.34 * (1 + 1e-6)
        assert s.missed == 0
        assert 24 < s.temperature < 30
    assert samples[100].reference == pytest.approx(0.1 * math.sin(6.28 * 0.1))


def test_hold_keeps_the_position_told_last(drive: SimDrive) -> None:
    drive.enable(Mode.POSITION)
    target = run(drive, 0.2)
    assert drive.step(HOLD).reference == pytest.approx(target)


@pytest.mark.parametrize("mode", list(Mode))
def test_every_mode_moves_and_stops(drive: SimDrive, mode: Mode) -> None:
    drive.enable(mode)
    for k in range(500):
        sample = drive.step(Command(position=1.0 * k * H, velocity=1.0, torque=0.5))
    assert sample.position > 0.1
    drive.disable()
    assert at_rest(drive)


def test_disable_brakes_under_power_and_is_idempotent(drive: SimDrive) -> None:
    drive.enable(Mode.POSITION)
    run(drive, 0.3, speed=10.0)
    moving = drive.servo.position
    drive.disable()
    distance = drive.servo.position - moving
    assert distance == pytest.approx(10.0**2 / (2 * 400.0), abs=0.05)
    drive.disable()
    drive.close()
    assert at_rest(drive)


def test_power_twice_and_cycles_without_power_are_refused(drive: SimDrive) -> None:
    with pytest.raises(StateError, match="power is off"):
        drive.step(Command())
    drive.enable(Mode.POSITION)
    with pytest.raises(StateError, match="power was on"):
        drive.enable(Mode.POSITION)
    assert at_rest(drive)


def test_following_error_is_a_fault(drive: SimDrive) -> None:
    drive.write_parameters({"limit.following_error": 0.05})
    drive.enable(Mode.POSITION)
    drive.inject("blocked", drive.servo.time + 0.1)
    with pytest.raises(DriveFault, match="following error too large") as caught:
        run(drive, 2.0)
    assert caught.value.code == 0x8611
    assert at_rest(drive)
    assert "8611" in drive.faults()[0]
    with pytest.raises(DriveFault, match="when power was asked for"):
        drive.enable(Mode.POSITION)
    drive.inject("clear")
    drive.reset_faults()
    drive.enable(Mode.POSITION)
    run(drive, 0.2)


def test_overspeed_is_a_fault(drive: SimDrive) -> None:
    drive.write_parameters({"limit.speed": 3.0})
    drive.enable(Mode.TORQUE)
    with pytest.raises(DriveFault, match="speed too high") as caught:
        push(drive, 0.6)
    assert caught.value.code == 0x7310
    assert not drive.servo.powered
    for _ in range(1000):  # it coasts: in torque mode no drive brakes by an encoder that may lie
        drive.servo.idle()
    assert at_rest(drive)


def test_leaving_the_position_limits_is_a_fault(drive: SimDrive) -> None:
    drive.write_parameters({"limit.position_max": 0.5})
    drive.enable(Mode.TORQUE)
    with pytest.raises(DriveFault, match="position limit") as caught:
        push(drive, 0.45)
    assert caught.value.code == 0x8612
    assert 0.5 < drive.servo.position < 0.7


def test_demands_are_clamped_to_the_limits(drive: SimDrive) -> None:
    drive.write_parameters({"limit.position_max": 0.2, "limit.speed": 2.0})
    drive.enable(Mode.POSITION)
    for k in range(800):
        sample = drive.step(Command(position=0.5 * k * H))
    assert sample.reference == pytest.approx(0.2)
    drive.disable()
    drive.write_parameters({"limit.position_max": 20.0})
    drive.enable(Mode.VELOCITY)
    begin = drive.step(HOLD).position
    for _ in range(1000):
        sample = drive.step(Command(velocity=50.0))
    assert sample.position - begin == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("command", [Command(torque=math.nan), Command(torque_feedforward=math.inf)])
def test_impossible_commands_do_not_reach_the_axis(drive: SimDrive, command: Command) -> None:
    drive.enable(Mode.POSITION)
    with pytest.raises(DriveError, match="must be finite"):
        drive.step(command)
    assert math.isfinite(drive.step(HOLD).torque_command)


def test_parameters_volatile_and_stored(drive: SimDrive) -> None:
    before = drive.read_parameters()
    drive.write_parameters({"controller.kp": 30.1})
    assert drive.read_parameters(["controller.kp"]) == {"controller.kp": float(np.float32(30.1))}
    drive.power_cycle()
    assert drive.read_parameters() == before
    drive.write_parameters({"controller.kp": 30.1})
    drive.store()
    drive.power_cycle()
    assert drive.read_parameters(["controller.kp"])["controller.kp"] == pytest.approx(30.1)


def test_bad_parameters_change_nothing(drive: SimDrive) -> None:
    before = drive.read_parameters()
    with pytest.raises(ConfigurationError, match=r"did you mean 'controller\.kp'"):
        drive.write_parameters({"controller.ki": 1.0, "controler.kp": 1.0})
    with pytest.raises(ConfigurationError, match="allowed is"):
        drive.write_parameters({"controller.ki": 1.0, "controller.kd": -1.0})
    with pytest.raises(ConfigurationError, match="did you mean"):
        drive.read_parameters(["limit.sped"])
    assert drive.read_parameters() == before


def test_storing_needs_power_off(drive: SimDrive) -> None:
    drive.enable(Mode.POSITION)
    with pytest.raises(StateError, match="power off only"):
        drive.store()


def test_silence_stops_the_axis_and_every_question_times_out(drive: SimDrive) -> None:
    drive.enable(Mode.POSITION)
    drive.inject("silent", drive.servo.time + 0.2)
    with pytest.raises(LinkTimeout):
        run(drive, 1.0, speed=5.0)
    assert at_rest(drive)
    for ask in (drive.faults, drive.read_parameters, drive.store, lambda: drive.enable(Mode.POSITION)):
        with pytest.raises(LinkTimeout):
            ask()
    drive.disable()
    drive.close()


def test_power_loss_forgets_what_was_not_stored(drive: SimDrive) -> None:
    before = drive.read_parameters()
    drive.write_parameters({"controller.kp": 20.0})
    drive.enable(Mode.POSITION)
    drive.inject("power-loss", drive.servo.time + 0.1)
    with pytest.raises(LinkTimeout):
        run(drive, 1.0)
    assert at_rest(drive)
    assert drive.read_parameters() == before
    drive.enable(Mode.POSITION)


@pytest.mark.parametrize(
    ("name", "code"), [("drive-fault", 0x2310), ("following-error", 0x8611), ("brake-missing", 0xFF11)]
)
def test_rehearsed_faults_take_power_off(drive: SimDrive, name: str, code: int) -> None:
    drive.enable(Mode.POSITION)
    drive.inject(name, drive.servo.time + 0.1)
    with pytest.raises(DriveFault) as caught:
        run(drive, 1.0, speed=2.0)
    assert caught.value.code == code
    assert at_rest(drive)


def test_enable_input_missing_takes_torque_off_and_keeps_it_off(drive: SimDrive) -> None:
    drive.enable(Mode.POSITION)
    drive.inject("enable-missing", drive.servo.time + 0.1)
    with pytest.raises(DriveFault, match="enable input"):
        run(drive, 1.0)
    assert not drive.servo.powered
    drive.inject("clear")
    drive.reset_faults()
    drive.inject("enable-missing")
    with pytest.raises(StateError, match="switch on disabled"):
        drive.enable(Mode.POSITION)


def test_a_hot_motor_is_a_fault_until_it_is_cool(drive: SimDrive) -> None:
    drive.enable(Mode.POSITION)
    drive.inject("hot", drive.servo.time + 0.1)
    with pytest.raises(DriveFault, match="temperature") as caught:
        run(drive, 1.0)
    assert caught.value.code == 0x4310
    with pytest.raises(DriveFault, match="still there"):
        drive.reset_faults()
    drive.inject("clear")
    drive.reset_faults()
    assert drive.faults() == []


def test_lost_cycles_are_counted(drive: SimDrive) -> None:
    drive.enable(Mode.POSITION)
    drive.inject("missed-cycles", drive.servo.time + 0.05)
    samples = [drive.step(HOLD) for _ in range(100)]
    assert [s.missed for s in samples if s.missed] == [3]
    late = next(k for k, s in enumerate(samples) if s.missed)
    assert samples[late].time - samples[late - 1].time == pytest.approx(4 * H)


def test_memory_that_fails(drive: SimDrive) -> None:
    drive.inject("write-refused")
    with pytest.raises(TransferAborted, match="08000022h"):
        drive.write_parameters({"controller.kp": 20.0})
    drive.inject("clear")
    drive.inject("store-refused")
    with pytest.raises(TransferAborted):
        drive.store()
    drive.inject("clear")
    drive.inject("nvm")
    drive.write_parameters({"controller.kp": 20.0})
    with pytest.raises(DriveError, match=r"confirmed storing, but controller\.kp is 60 instead of 20"):
        drive.store()
    drive.power_cycle()
    assert drive.read_parameters()["controller.kp"] == 60.0


@pytest.mark.parametrize("name", REHEARSALS)
def test_every_rehearsal_leaves_the_axis_at_rest_after_disable(name: str) -> None:
    drive = open_sim(f"sim://edm-vertical?fault={name}@0.3")
    drive.enable(Mode.POSITION)
    try:
        run(drive, 1.0)
    except (DriveFault, LinkError):
        pass
    finally:
        with suppress(DriveFault):  # a fault in the stop itself is told by the stop
            drive.disable()
    assert at_rest(drive)


def test_urls_say_what_is_simulated() -> None:
    url = "sim://edm-vertical?seed=3&effect=stribeck:0.05&effect=spring&cycle=0.002&friction=0.5"
    axis = open_sim(url).servo.preset
    assert axis.period == 0.002
    assert axis.plant.stribeck == 0.05
    assert axis.plant.spring == 0.01
    nominal = open_sim("sim://edm-vertical?seed=3").servo.preset.plant
    assert axis.plant.friction == pytest.approx(0.5 * nominal.friction)
    assert open_sim("sim://lugre", cycle=0.004).period == 0.004
    assert open_sim("sim://lugre?cycle=0.001", cycle=0.004).period == 0.001
    assert open_sim("sim://lugre?dead_time=0.004&cycle=0.002").servo.preset.dead_time == 0.004


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("sim://edm-vertikal", "did you mean 'edm-vertical'"),
        ("sim://", "there is no simulated axis"),
        ("http://edm-vertical", "not a simulated axis"),
        ("sim://edm-vertical?sed=3", "did you mean 'seed'"),
        ("sim://edm-vertical?seed=x", "must be a number"),
        ("sim://edm-vertical?seed=-1", "must be 0 or above"),
        ("sim://edm-vertical?seed=1.5", "whole number"),
        ("sim://edm-vertical?seed=1&seed=2", "twice"),
        ("sim://edm-vertical?effect=stribek:1", "did you mean 'stribeck'"),
        ("sim://edm-vertical?effect=stribeck:", "must be a number"),
        ("sim://edm-vertical?effect=stribeck:9", "allowed is"),
        ("sim://edm-vertical?friction=", "must be a number"),
        ("sim://edm-vertical?cycle=0.1", "allowed is 0.001 to 0.004"),
        ("sim://edm-vertical?dead_time=0.0005", "0 to 4 whole cycles of 0.001 s"),
        ("sim://edm-vertical?dead_time=0.005", "0 to 4 whole cycles"),
        ("sim://edm-vertical?dead_time=-0.001", "0 to 4 whole cycles"),
        ("sim://edm-vertical?dead_time=nan", "0 to 4 whole cycles"),
        ("sim://edm-vertical?fault=silnt", "did you mean 'silent'"),
        ("sim://edm-vertical?fault=silent@x", "must be a number"),
    ],
)
def test_bad_urls_are_refused_in_words(url: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        open_sim(url)
