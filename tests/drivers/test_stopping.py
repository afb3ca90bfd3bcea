"""Taking power off: what the axis does is watched, and no fault in it is lost."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.arrays import Floats
from autotune.core.drive import Command, Drive, Mode
from autotune.core.errors import DriveFault
from autotune.core.loop import LocalLoop, Publish
from autotune.core.stopping import IN_A_ROW, TAKES_OVER, StopLimits, StopWatch, Ways
from autotune_sim.inprocess import SimDrive, open_sim
from tests.drivers.power_rig import AXIS, DISABLED, FAULT, StateDrive, power_of
from tests.drivers.routines import Calls
from tests.support.refusals import refusal

LIMITS = StopLimits.of(AXIS)
SPEED = AXIS.limits.speed


def watched(speeds: list[float], position: float = 0.0, unit: float = 1.0) -> StopWatch:
    """`unit`: times the true velocity, as the drive tells it."""
    watch = StopWatch(LIMITS, unit * speeds[0], speeds[0])
    for speed in speeds:
        position += speed * LIMITS.period
        watch.see(position, unit * speed)
        if watch.runs_away:
            break
    return watch


@given(
    st.floats(-SPEED, SPEED),
    st.floats(0.1, 3.0),
    st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=60),
)
def test_an_axis_that_brakes_is_left_to_its_drive(start: float, share: float, noise: list[float]) -> None:
    """Whatever the deceleration, and with one count of noise either way in each velocity."""
    count = AXIS.position_resolution / LIMITS.period
    slower = share * AXIS.limits.deceleration * LIMITS.period
    speeds = [
        math.copysign(max(abs(start) - k * slower, 0.0), start) + 0.5 * count * wiggle
        for k, wiggle in enumerate(noise)
    ]
    assert not watched(speeds).trouble


@given(st.floats(0.0, SPEED), st.floats(0.3, 20.0), st.sampled_from([1.0, -1.0]))
def test_a_speed_that_grows_ends_the_stop(start: float, gain: float, sign: float) -> None:
    """`gain` a cycle [rad/s]: found as soon as the allowance is used up and three samples have shown it."""
    speeds = [sign * (start + gain * k) for k in range(200)]
    watch = StopWatch(LIMITS, speeds[0])
    position, seen = 0.0, 0
    while not watch.runs_away:
        position += speeds[seen] * LIMITS.period
        watch.see(position, speeds[seen])
        seen += 1
    assert seen <= math.ceil(LIMITS.allowance / gain) + TAKES_OVER + IN_A_ROW
    assert "rose from" in watch.trouble


def test_a_velocity_that_stays_at_zero_hides_nothing() -> None:
    watch = StopWatch(LIMITS, 0.0)
    position = 0.0
    for k in range(30):
        position += 1.0 * k * LIMITS.period
        watch.see(position, 0.0)
    assert watch.runs_away


def test_a_speed_that_is_no_number_is_too_fast() -> None:
    assert watched([0.0, *[math.nan] * 5]).runs_away
    watch = StopWatch(LIMITS, math.nan)
    for _ in range(5):
        watch.see(math.nan, 0.0)
    assert watch.runs_away


def test_lost_cycles_are_no_speed() -> None:
    watch = StopWatch(LIMITS, 5.0)
    for k in range(1, 8):
        watch.see(0.05 * k, 5.0, missed=9)
    assert not watch.trouble


def test_answers_in_a_burst_tell_one_place_twice() -> None:
    """A host that was held up gets two answers of one control period; an axis that stands still tells more of them."""
    watch, position = StopWatch(LIMITS, 10.0, 10.0), 0.0
    for _ in range(2):
        position += 0.01
        watch.see(position, 10.0, passed=1.7)
        watch.see(position, 10.0, passed=0.3)
    assert not watch.trouble
    for _ in range(2):
        watch.see(position, 10.0, passed=1.0)
    assert "vanished" in watch.trouble


@pytest.mark.parametrize("when", ["before", "within"])
def test_an_axis_that_has_waited_for_a_late_host_is_no_dead_encoder(when: str) -> None:
    ways = Ways(LIMITS.period)
    for k in range(4):
        ways.see(0.01 * k, missed=60 * (k == 2))
    assert ways.late
    watch = StopWatch(LIMITS, 10.0, 10.0, late=when == "before")
    watch.see(0.0, 10.0)
    watch.see(0.0, 0.0, missed=60 * (when == "within"))
    for _ in range(5):
        watch.see(0.0, 0.0)
    assert not watch.trouble
    ways.begin()
    assert not ways.late


def test_an_axis_that_lags_behind_its_demand_catches_up() -> None:
    def speeds(demanded: float) -> bool:
        watch, position = StopWatch(LIMITS, 0.0, 0.0, demanded), 0.0
        for k in range(20):
            speed = 0.5 * SPEED * (k >= TAKES_OVER)
            position += speed * LIMITS.period
            watch.see(position, speed)
        return watch.runs_away

    assert not speeds(-0.5 * SPEED)
    assert speeds(math.nan)


def test_an_axis_that_leaves_its_travel_is_told() -> None:
    watch = watched([5.0] * 100, AXIS.limits.position_max)
    assert "left its travel" in watch.trouble
    assert not watch.runs_away  # its drive brakes it: better than nobody
    assert not watched([-5.0] * 100, AXIS.limits.position_max).trouble


def test_where_the_stop_drives_the_axis_power_goes_at_once() -> None:
    drive = StateDrive(lambda cycle: 1.0 * cycle)
    power, _ = power_of(drive)
    with pytest.raises(DriveFault, match=r"did not bring its axis to rest.*rose from"):
        power.off(Mode.POSITION)
    assert drive.status == DISABLED
    assert len(drive.controls) < 20  # rad/s, as it gains one a cycle; its limit is 20


def test_a_fault_in_the_stop_is_told_once() -> None:
    drive = StateDrive()
    power, _ = power_of(drive)
    drive.fail(0x2310)
    with pytest.raises(DriveFault, match=r"while power was taken off.*over-current") as caught:
        power.off(Mode.POSITION)
    assert caught.value.code == 0x2310
    power.off(Mode.POSITION)


def test_a_fault_without_a_code_is_told() -> None:
    drive = StateDrive()
    power, _ = power_of(drive)
    drive.status = FAULT
    with pytest.raises(DriveFault, match="no error code"):
        power.off(Mode.POSITION)


def test_an_old_error_code_of_a_drive_in_order_is_no_fault() -> None:
    drive = StateDrive()
    power, _ = power_of(drive)
    drive.node.objects[0x603F, 0] = b"\x10\x23"
    assert refusal(lambda: power.off(Mode.POSITION)) == ""
    assert drive.status == DISABLED


def test_the_gravest_of_several_faults_comes_first_and_all_are_named() -> None:
    drive = StateDrive()
    power, exchange = power_of(drive)
    drive.emergency(0x8130)
    drive.fail(0x2310)
    exchange.cycle((0x0F, 0, 0))
    fault = power.lost()
    assert fault.code == 0x2310
    assert "over-current" in str(fault)
    assert "heartbeat" in str(fault)


@pytest.mark.parametrize(
    ("codes", "register", "reset"),
    [
        ([0x8611], 0b0010_0001, True),  # the motion that we have commanded
        ([0x8130], 0b0001_0001, True),  # our silence
        ([0x8130, 0x2310], 0b0001_0001, False),  # and then something that is not ours
        ([0x8130], 0b0000_0011, False),  # whatever 603Fh says, the register tells of a current
    ],
)
def test_only_what_we_have_caused_is_acknowledged(codes: list[int], register: int, reset: bool) -> None:
    drive = StateDrive()
    power, exchange = power_of(drive)
    for code in codes:
        drive.fail(code, register)
    exchange.cycle((0x0F, 0, 0))
    power.lost()
    power.acknowledge()
    written = [data for index, _, data in drive.node.writes if index == 0x6040]
    assert (b"\x80\x00" in written) == reset


def test_an_emergency_that_came_first_does_not_cover_the_present_fault() -> None:
    """The node is asked again: what made it fault may have come after what was told."""
    drive = StateDrive()
    power, exchange = power_of(drive)
    drive.fail(0x8130)
    exchange.cycle((0x0F, 0, 0))
    power.lost()
    drive.node.objects[0x603F, 0] = b"\x10\x23"
    power.acknowledge()
    assert not [index for index, _, _ in drive.node.writes if index == 0x6040]


def test_a_loop_passes_on_what_came_with_the_last_stop_and_all_rows() -> None:
    """Nobody who plays can believe that all went well."""
    drive = open_sim("sim://edm-vertical")
    rows: list[Floats] = []

    def routine(drive: Drive, publish: Publish) -> str:
        drive.enable(Mode.VELOCITY)
        for _ in range(120):
            publish(drive.step(Command(velocity=5.0)), 0, 0)
        assert isinstance(drive, SimDrive)
        drive.inject("drive-fault")
        return "all well"

    with pytest.raises(DriveFault, match="over-current"):
        LocalLoop(drive).play(Calls(routine), rows.append)
    assert sum(map(len, rows)) == 120
    assert not drive.servo.powered


def test_a_stop_that_swings_ends_although_no_swing_is_faster_than_its_beginning() -> None:
    swing = 0.9 * LIMITS.allowance
    watch = watched([swing * math.cos(0.3 * k) for k in range(300)])
    assert watch.runs_away
    assert "swung to and fro" in watch.trouble


def test_a_stop_that_rings_down_is_left_to_its_drive() -> None:
    swing = 2.0 * LIMITS.allowance
    assert not watched([swing * math.exp(-0.06 * k) * math.cos(0.2 * k) for k in range(300)]).trouble


@pytest.mark.parametrize("start", [3.0, 8.0, -15.0])
def test_a_speed_that_vanishes_at_once_is_not_braked_by(start: float) -> None:
    """An encoder that dies in the cycle of a stop: a drive that brakes by it drove its axis to 42 rad/s for 33 ms."""
    watch = watched([start, 0.0, 0.0, 0.0])
    assert watch.runs_away
    assert "vanished" in watch.trouble


@pytest.mark.parametrize("start", [5.0, 8.0, -15.0])
@pytest.mark.parametrize("gain", [0.1, 0.25])
def test_an_encoder_that_tells_a_part_from_the_stop_on_is_not_braked_by(start: float, gain: float) -> None:
    """In the moment of Ctrl-C it began to tell a tenth: the ramp that followed it drove the axis to 27 rad/s from 5."""
    watch = watched([start, *[gain * start] * 4])
    assert watch.runs_away
    assert "most of it" in watch.trouble


@pytest.mark.parametrize("unit", [0.1, 10.0])
def test_a_velocity_in_another_unit_is_no_part_of_a_motion(unit: float) -> None:
    slower = AXIS.limits.deceleration * LIMITS.period
    while_it_moves = range(int(6.0 / slower))
    assert not watched([6.0 - k * slower for k in while_it_moves], unit=unit).trouble


def test_counts_alone_are_no_part_of_a_motion() -> None:
    count = LIMITS.count / LIMITS.period
    assert not watched([4.0 * count, *[k % 2 * 2.0 * count for k in range(20)]]).runs_away


@pytest.mark.parametrize("start", [0.3, 1.0])
def test_slow_axes_may_rest_at_once(start: float) -> None:
    assert not watched([start, *[0.0] * 20]).trouble


def test_an_axis_that_brakes_three_times_as_hard_is_left_alone_until_it_rests() -> None:
    slower = 3.0 * AXIS.limits.deceleration * LIMITS.period
    assert not watched([max(12.0 - k * slower, 0.0) for k in range(40)]).trouble
