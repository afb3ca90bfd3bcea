"""What can break inside the axis: the same names in process and behind the wire, and a log of the truth."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from autotune.core.drive import HOLD, Command, Mode
from autotune.core.errors import AutotuneError, ConfigurationError, DriveFault, LinkError
from autotune_sim.faults import parse_order
from autotune_sim.hurts import HURTS
from autotune_sim.inprocess import SimDrive, open_sim
from autotune_sim.truth import Truth, powered, read_truth
from autotune_sim.unfit import UNFIT

H = 1e-3
WHEN = 0.2  # s
TORQUE = 0.42  # N m: moves the axis, and not faster than it may


def broken(order: str, mode: Mode = Mode.POSITION, command: Command | None = None) -> tuple[SimDrive, Truth]:
    """Half a second on an axis on which something breaks at WHEN; it moves at 1 rad/s where nothing is said."""
    drive = open_sim(f"sim://edm-vertical?fault={order}@{WHEN}")
    truth = Truth(capacity=4096)
    drive.keep_truth(truth)
    drive.enable(mode)
    try:
        for k in range(500):
            drive.step(command or Command(position=1.0 * k * H))
    except AutotuneError:
        pass
    return drive, truth


def shown_and_true(order: str) -> tuple[np.ndarray, np.ndarray]:
    """Readings and positions of the shaft after the fault."""
    _, truth = broken(order, Mode.TORQUE, Command(torque=TORQUE))
    rows = truth.rows()
    later = rows[rows["time"] > WHEN + 2 * H]
    return later["reading"].astype(float), later["position"].astype(float)


def test_a_frozen_encoder_says_the_same_for_ever() -> None:
    reading, position = shown_and_true("encoder-frozen")
    assert np.ptp(reading) == 0.0
    assert np.ptp(position) > 0.1


@pytest.mark.parametrize(("order", "gain"), [("encoder-reversed", -1.0), ("encoder-scale=0.1", 0.1)])
def test_an_encoder_with_another_gain(order: str, gain: float) -> None:
    reading, position = shown_and_true(order)
    slope = np.polyfit(position, reading, 1)[0]
    assert slope == pytest.approx(gain, abs=0.05)  # the reading is one cycle older than the shaft


def test_an_encoder_that_leaps() -> None:
    reading, position = shown_and_true("encoder-jump=0.25")
    assert np.median(reading - position) == pytest.approx(0.25, abs=0.05)  # a cycle at 20 rad/s is 0.02 rad


def torque_and_push(order: str) -> tuple[float, float]:
    """Medians after the fault, with TORQUE demanded."""
    _, truth = broken(order, Mode.TORQUE, Command(torque=TORQUE))
    rows = truth.rows()
    later = rows[(rows["time"] > WHEN + 0.01) & (rows["mode"] >= 0)]
    return float(np.median(later["torque"])), float(np.median(later["push"]))


@pytest.mark.parametrize(
    ("order", "torque", "push"),
    [
        ("torque-constant=0.5", 0.5 * TORQUE, 0.0),
        ("torque-reversed", -TORQUE, 0.0),
        ("runaway=-0.8", -0.8 * 1.34, 0.0),
        ("stage-stuck=0.3", 0.3, 0.0),
        ("load-step=-0.45", TORQUE, -0.45 * 1.34),
    ],
)
def test_torque_at_the_shaft(order: str, torque: float, push: float) -> None:
    assert torque_and_push(order) == pytest.approx((torque, push), abs=1e-6)


def test_a_stuck_stage_outlives_power() -> None:
    _, truth = broken("stage-stuck=0.3", Mode.TORQUE, Command(torque=TORQUE))
    rows = truth.rows()
    off = rows[rows["mode"] < 0]
    assert len(off) == 0 or np.all(off["torque"][1:] == pytest.approx(0.3))
    drive, truth = broken("stage-stuck=0.3")
    drive.close()
    last = truth.rows()[-1]
    assert last["mode"] == -1
    assert last["live"] == 1
    assert last["torque"] == pytest.approx(0.3)


def test_hard_stops_hold_the_axis() -> None:
    _, truth = broken("end-stop=0.05", Mode.TORQUE, Command(torque=0.6))
    rows = truth.rows()
    at = rows["position"][np.searchsorted(rows["time"], WHEN)]
    assert abs(rows["position"][-1] - at) < 0.06  # the stop gives way by a few mrad


def test_the_drives_own_velocity_in_another_unit() -> None:
    _, truth = broken("velocity-unit=0.1")
    rows = truth.rows()
    later = rows[(rows["time"] > WHEN + 0.05) & (rows["time"] < 0.4)]
    assert np.mean(later["shown_velocity"]) == pytest.approx(0.1, rel=0.1)
    assert np.mean(later["velocity"]) == pytest.approx(1.0, rel=0.1)


def test_a_dead_temperature_sensor_hides_a_hot_motor() -> None:
    drive = open_sim("sim://edm-vertical?fault=temperature-frozen@0.1&fault=temperature-rise=70@0.2")
    drive.enable(Mode.POSITION)
    for _ in range(400):
        sample = drive.step(HOLD)
    assert sample.temperature == pytest.approx(25.0, abs=0.5)


def test_a_fault_in_the_last_stop_is_raised_once_and_power_is_off() -> None:
    drive, truth = broken("stop-fault")
    with pytest.raises(DriveFault, match="2310h"):
        drive.disable()
    assert not drive.servo.powered
    drive.disable()
    assert drive.faults()
    assert [event.kind for event in truth.events if event.kind in ("enabled", "disabled")][-1] == "disabled"


def test_lost_commands_leave_the_drive_with_the_last_one() -> None:
    _, truth = broken("rpdo-lost", Mode.TORQUE)
    assert len(truth.rows())
    drive, truth = broken("rpdo-lost")
    rows = truth.rows()
    later = rows[(rows["time"] > WHEN + 0.02) & (rows["mode"] >= 0)]
    assert np.ptp(later["target"]) == 0.0
    assert drive.faults() == []


@pytest.mark.parametrize(
    ("order", "mode", "change"),
    [
        ("rpdo-lost", Mode.POSITION, Command(position=H)),
        ("rpdo-lost", Mode.VELOCITY, Command(velocity=2.0 * H)),
        ("rpdo-lost", Mode.TORQUE, Command(torque=0.1 * H)),
        ("rpdo-lost", Mode.POSITION, Command(torque_feedforward=0.1 * H)),
        ("second-master=0.03", Mode.POSITION, Command(position=H)),
    ],
)
def test_a_target_that_is_not_ours_is_read_back(order: str, mode: Mode, change: Command) -> None:
    drive = open_sim(f"sim://edm-vertical?fault={order}@{WHEN}")
    drive.enable(mode)
    told = []

    def play() -> None:
        for cycle in range(500):
            told.append(cycle * H)
            drive.step(Command(*(cycle * part for part in change)))

    with pytest.raises(LinkError, match="does not have the target"):
        play()
    assert 0.02 <= told[-1] - WHEN <= 0.05  # two looks, 20 cycles apart
    drive.disable()
    assert not drive.servo.powered


def test_a_lost_command_that_says_what_the_one_before_said_is_no_matter() -> None:
    drive = open_sim(f"sim://edm-vertical?fault=rpdo-lost@{WHEN}")
    drive.enable(Mode.POSITION)
    for _ in range(500):
        drive.step(HOLD)
    drive.disable()
    assert drive.faults() == []
    assert not drive.servo.powered


def test_another_masters_target_is_followed() -> None:
    _, truth = broken("second-master=0.03")
    rows = truth.rows()
    later = rows[(rows["time"] > WHEN + 0.02) & (rows["mode"] >= 0)]
    assert later["target"][0] == pytest.approx(WHEN + 0.03, abs=0.01)
    assert np.ptp(later["target"]) == 0.0


@pytest.mark.parametrize("name", HURTS)
def test_the_same_names_on_both_sides(name: str) -> None:
    assert parse_order(f"{name}@2.5").name == name
    drive = open_sim(f"sim://edm-vertical?fault={name}@0.01")
    drive.enable(Mode.POSITION)
    with suppress(DriveFault):  # some are found by the drive itself
        for _ in range(20):
            drive.step(HOLD)
    with suppress(DriveFault):  # or by what watches its stop
        drive.close()
    assert not drive.servo.powered


@pytest.mark.parametrize(
    "order", ["encoder-frozen=1", "load-step=much", "encoder-forzen", "temperature-slow=-1"]
)
def test_orders_that_cannot_be(order: str) -> None:
    with pytest.raises(ConfigurationError):
        open_sim(f"sim://edm-vertical?fault={order}@1")
    with pytest.raises(ConfigurationError):
        parse_order(f"{order}@1")


def test_a_log_in_a_file_says_the_same_as_one_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "truth"
    drive = open_sim(f"sim://edm-vertical?truth={path}&fault=load-step@0.05")
    drive.enable(Mode.POSITION)
    for k in range(100):
        drive.step(Command(position=k * H))
    assert powered(path)
    drive.write_parameters({"limit.speed": 5.0})
    drive.close()
    assert not powered(path)
    log = read_truth(path)
    assert np.all(np.diff(log.rows["time"]) > 0)
    assert log.rows["mode"][-1] == -1
    kinds = [event.kind for event in log.events]
    assert kinds == ["open", "enabled", "fault put in", "written", "disabled", "closed"]
    assert log.events[-1].details["parameters"]["limit.speed"] == 5.0
    assert log.events[0].details["parameters"]["limit.speed"] != 5.0


def test_a_log_goes_round() -> None:
    drive = open_sim("sim://edm-vertical")
    drive.keep_truth(Truth(capacity=100))
    drive.enable(Mode.POSITION)
    for _ in range(250):
        drive.step(HOLD)
    truth = drive.servo.truth
    assert truth is not None
    time = truth.rows()["time"]
    assert len(time) == 100
    assert np.all(np.diff(time) == pytest.approx(H))
    assert time[-1] == pytest.approx(drive.servo.time)


@pytest.mark.parametrize("name", UNFIT)
@pytest.mark.parametrize("size", [0.0, 1.0])
def test_unfit_axes_can_be_made(name: str, size: float) -> None:
    drive = open_sim(f"sim://edm-vertical?seed=7&unfit={name}:{size}")
    drive.enable(Mode.POSITION)
    for _ in range(50):
        sample = drive.step(HOLD)
    assert math.isfinite(sample.position)
    drive.close()


def test_unfit_axes_differ_by_seed() -> None:
    one, other = (
        open_sim(f"sim://edm-vertical?seed={seed}&unfit=resonance").servo.preset.plant for seed in (1, 2)
    )
    assert one.transmission_stiffness != other.transmission_stiffness
    with pytest.raises(ConfigurationError, match="did you mean 'resonance'"):
        open_sim("sim://edm-vertical?unfit=resonace")
    with pytest.raises(ConfigurationError, match="allowed is 0 to 1"):
        open_sim("sim://edm-vertical?unfit=resonance:2")
