"""Motion, limits, stops and faults of the drive."""

from __future__ import annotations

import math
import struct

import pytest

from tests.node.support import CST, CSV, Bench

COUNT = 2 * math.pi / 50_000
AMPLITUDE = 1592  # counts, 0.2 rad


def sine(k: int, frequency: float = 1.0) -> int:
    return round(AMPLITUDE * math.sin(2 * math.pi * frequency * k * 1e-3))


def test_follows_a_sine_as_the_thesis_axis_does(bench: Bench) -> None:
    start = bench.enable()
    errors = []
    for k in range(3000):
        target = start + sine(k)
        _, position, _ = bench.cycle(15, target)
        errors.append(target - position)
    peak = max(map(abs, errors[1000:])) * COUNT
    assert 1.2e-3 < peak < 3.5e-3  # about 2 mrad with the gains of Table 6.3, noise and counts on top


def test_objects_of_one_cycle_agree(bench: Bench) -> None:
    start = bench.enable()
    for k in range(200):
        bench.cycle(15, start + 3 * k, offset=20_000)
    get = bench.get
    assert get(0x6062) - get(0x6064) == pytest.approx(get(0x60F4), abs=1)
    assert get(0x6074) * 500 == pytest.approx(get(0x2200, 1), abs=250)
    assert get(0x6077) * 500 == pytest.approx(get(0x2200, 2), abs=250)
    assert get(0x2200, 5) == 20_000
    assert get(0x2200, 6) == 0
    assert get(0x2200, 7) == pytest.approx(get(0x2200, 1) - 20_000, abs=1)
    assert get(0x606C) == pytest.approx(3000, abs=1500)
    assert int(get(0x60FD)) == 0x30000


def test_torque_offsets_add_up(bench: Bench) -> None:
    start = bench.enable()
    bench.put(0x60B2, 0, 100)  # 50 mN m
    for _ in range(5):
        bench.cycle(15, start, offset=10_000)
    assert bench.get(0x2200, 5) == 60_000


def test_own_feedforward_is_told_apart(bench: Bench) -> None:
    bench.put(0x2100, 9, 0.04)
    bench.put(0x2100, 1, 1)
    start = bench.enable()
    bench.cycle(15, start, offset=10_000)
    assert bench.get(0x2200, 6) == pytest.approx(40_000, abs=1)
    assert bench.get(0x2200, 5) == pytest.approx(50_000, abs=1)


def test_velocity_mode(bench: Bench) -> None:
    bench.enable(CSV)
    for _ in range(600):
        bench.cycle(15, velocity=20_000)
    assert bench.get(0x606C) == pytest.approx(20_000, rel=0.1)
    bench.cycle(15, velocity=10**9)
    assert int(bench.get(0x6041)) & 0x0800


def test_torque_mode_adds_the_fine_target(bench: Bench) -> None:
    bench.enable(CST)
    bench.put(0x6071, 0, 100)
    bench.cycle(15, torque=30_000, offset=5_000)
    assert bench.get(0x2200, 1) == pytest.approx(85_000, abs=1)


def test_torque_limit_clamps(bench: Bench) -> None:
    bench.put(0x6072, 0, 100)
    bench.enable(CST)
    bench.cycle(15, torque=900_000)
    assert bench.get(0x2200, 1) == pytest.approx(50_000, abs=5)
    assert int(bench.get(0x6041)) & 0x0800


def test_holds_where_it_is_when_enabled(bench: Bench) -> None:
    """A target from before power-on is history."""
    bench.put(0x607A, 0, 100_000)
    for controlword in (6, 7, 15):
        bench.put(0x6040, 0, controlword)
    bench.wait(0.5)
    assert bench.word == 0x27
    assert abs(bench.get(0x6064)) < 5


def test_a_leap_of_the_target_is_a_following_error(bench: Bench) -> None:
    start = bench.enable()
    for _ in range(100):
        word, *_ = bench.cycle(15, start + 30_000)
    assert word & 0x4F == 0x08
    assert word & 0x2000
    assert int(bench.get(0x603F)) == 0x8611
    assert int(bench.get(0x1001)) == 0x21
    assert int(bench.get(0x1003, 1)) & 0xFFFF == 0x8611
    (message,) = bench.take(0x085)
    assert message[:3] == bytes.fromhex("118621")


def test_blocked_axis(bench: Bench) -> None:
    start = bench.enable()
    bench.device.firmware.servo.brake_stuck = True
    for k in range(1000):
        word, *_ = bench.cycle(15, start + 5 * k)
    assert word & 0x4F == 0x08
    assert int(bench.get(0x603F)) == 0x8611


def test_fault_is_reset_by_the_edge_alone(bench: Bench) -> None:
    bench.enable()
    bench.device.firmware.fault(0x2310)
    for _ in range(100):
        word, *_ = bench.cycle(0x80)
    assert word & 0x4F == 0x08  # bit 7 rose while the axis was still being stopped
    bench.cycle(0)
    word, *_ = bench.cycle(0x80)
    assert word & 0x4F == 0x40
    assert bench.get(0x603F) == 0
    assert bench.get(0x1001) == 0
    assert bench.take(0x085)[-1][:3] == b"\0\0\0"


def test_targets_are_held_within_the_software_limits(bench: Bench) -> None:
    bench.put(0x607D, 1, -500)
    bench.put(0x607D, 2, 500)
    start = bench.enable()
    for k in range(1500):
        word, position, _ = bench.cycle(15, start + k)
    assert 480 < position < 520
    assert word & 0x0800
    assert word & 0x6F == 0x27


def test_beyond_a_software_limit_is_a_fault(bench: Bench) -> None:
    bench.put(0x607D, 2, 500)
    bench.enable(CST)
    for _ in range(300):
        bench.cycle(15, torque=600_000)
    assert int(bench.get(0x603F)) == 0x8612
    assert bench.word == 0x08


def test_overspeed_is_a_fault(bench: Bench) -> None:
    bench.put(0x607F, 0, 20_000)
    bench.enable(CST)
    for _ in range(200):
        bench.cycle(15, torque=900_000)
    assert int(bench.get(0x603F)) == 0x7310


def moving(bench: Bench) -> int:
    """Brings the axis to 40 000 counts/s (5 rad/s); the target."""
    target = bench.enable()
    for k in range(300):
        target += min(k, 40)
        bench.cycle(15, target)
    assert bench.get(0x606C) == pytest.approx(40_000, rel=0.15)
    return target


def test_quick_stop_brakes_with_its_deceleration(bench: Bench) -> None:
    bench.put(0x6085, 0, 400_000)  # counts/s²: from 40 000 counts/s in 0.1 s over 2000 counts
    target = moving(bench)
    word, *_ = bench.cycle(2, target)
    assert word & 0x6F == 0x07
    cycles = 1
    while word & 0x6F == 0x07:
        word, position, _ = bench.cycle(2, target)
        cycles += 1
        assert cycles < 1000
    assert word & 0x6F == 0x40
    assert 100 <= cycles <= 130
    assert position - target == pytest.approx(2000, abs=150)


def test_quick_stop_that_stays_and_goes_on(bench: Bench) -> None:
    bench.put(0x605A, 0, 6)
    target = moving(bench)
    for _ in range(200):
        word, position, _ = bench.cycle(2, target)
    assert word & 0x6F == 0x07
    word, *_ = bench.cycle(15, position)
    assert word & 0x6F == 0x27


def test_quick_stop_without_ramp(bench: Bench) -> None:
    bench.put(0x605A, 0, 0)
    target = moving(bench)
    word, *_ = bench.cycle(2, target)
    assert word & 0x6F == 0x40


def test_quick_stop_from_torque_mode(bench: Bench) -> None:
    bench.enable(CST)
    for _ in range(30):
        bench.cycle(15, torque=600_000)
    assert bench.get(0x606C) > 10_000
    for _ in range(150):
        word, *_ = bench.cycle(2)
    assert word & 0x6F == 0x40
    assert abs(bench.get(0x606C)) < 1000


def test_a_stop_drops_the_torque_offset(bench: Bench) -> None:
    target = moving(bench)
    bench.cycle(15, target + 40, offset=100_000)
    bench.cycle(2, target, offset=100_000)
    bench.cycle(2, target, offset=100_000)
    assert bench.get(0x2200, 5) == 0


def test_disable_operation_slows_down_first(bench: Bench) -> None:
    target = moving(bench)
    word, *_ = bench.cycle(7, target)
    assert word & 0x6F == 0x27
    for _ in range(150):
        word, *_ = bench.cycle(7, target)
    assert word & 0x6F == 0x23


def test_voltage_off_is_at_once(bench: Bench) -> None:
    target = moving(bench)
    word, *_ = bench.cycle(0, target)
    assert word & 0x6F == 0x40
    assert not bench.device.firmware.servo.powered


def test_nmt_stop_stops_the_axis(bench: Bench) -> None:
    moving(bench)
    bench.nmt(2)
    assert bench.word == 0x07
    bench.wait(0.3)
    assert bench.word == 0x40


def test_interpolation_over_four_periods(bench: Bench) -> None:
    bench.put(0x60C2, 1, 4)
    start = bench.enable()
    before = bench.get(0x2210, 1)
    demands = []
    bench.device.on_cycle = lambda device: demands.append(device.firmware.sample.position_demand / COUNT)
    bench.cycle(15, start + 40)
    assert bench.get(0x2210, 1) == before + 4
    assert [round(demand - start) for demand in demands] == [10, 20, 30, 40]


def test_temperature_limit(bench: Bench) -> None:
    bench.enable()
    bench.device.firmware.supervision.heating = 200.0
    for _ in range(60):
        word, *_ = bench.cycle(15)
    assert word & 0x4F == 0x08
    assert int(bench.get(0x603F)) == 0x4310
    bench.cycle(0)
    assert bench.cycle(0x80)[0] & 0x4F == 0x08  # still hot
    bench.device.firmware.supervision.heating = 0.0
    bench.cycle(0)
    assert bench.cycle(0x80)[0] & 0x4F == 0x40


def test_missing_enable_input(bench: Bench) -> None:
    bench.device.firmware.supervision.enable_input = False
    bench.prepare()
    word, *_ = bench.cycle(6)
    assert word & 0x4F == 0x40
    assert not word & 0x10
    assert int(bench.get(0x60FD)) == 0x20000


def test_enable_input_lost_under_power(bench: Bench) -> None:
    start = bench.enable()
    bench.device.firmware.supervision.enable_input = False
    bench.cycle(15, start)
    word, *_ = bench.cycle(15, start)
    assert word & 0x4F == 0x08
    assert int(bench.get(0x603F)) == 0xFF10
    assert not bench.device.firmware.servo.powered


def test_brake_that_does_not_open(bench: Bench) -> None:
    bench.device.firmware.supervision.brake_input = False
    bench.prepare()
    for controlword in (6, 7, 15):
        word, *_ = bench.cycle(controlword)
    assert word & 0x4F == 0x08
    assert int(bench.get(0x603F)) == 0xFF11


def test_heartbeat_lost(bench: Bench) -> None:
    bench.put(0x1016, 1, 127 << 16 | 150)
    bench.put(0x1017, 0, 100)
    moving(bench)
    bench.send(0x77F, b"\x05")
    bench.wait(0.149)
    assert bench.word == 0x27
    bench.wait(0.003)
    assert bench.word == 0x0F
    assert any("quick stop begun" in line for line in bench.log)
    bench.wait(0.3)
    assert bench.word == 0x08
    assert int(bench.get(0x603F)) == 0x8130
    assert bench.take(0x085)[0][:3] == bytes.fromhex("308111")
    assert bench.take(0x705)[-1] == b"\x7f"  # error behaviour 1029: pre-operational
    assert abs(bench.get(0x606C)) < 1000


@pytest.mark.parametrize(("option", "word"), [(0, 0x27), (2, 0x40), (3, 0x07)])
def test_other_reactions_to_a_lost_heartbeat(bench: Bench, option: int, word: int) -> None:
    bench.put(0x6007, 0, option)
    bench.put(0x1016, 1, 127 << 16 | 100)
    moving(bench)
    bench.send(0x77F, b"\x05")
    bench.wait(0.101)
    assert bench.word == word


def test_watching_begins_with_the_first_heartbeat(bench: Bench) -> None:
    bench.put(0x1016, 1, 127 << 16 | 100)
    bench.wait(0.5)
    assert bench.word == 0x40
    bench.send(0x77F, b"\x05")
    bench.wait(0.5)
    assert bench.word == 0x08


def test_axis_goes_on_by_the_wall_clock_while_it_stops(bench: Bench) -> None:
    moving(bench)
    cycles = bench.device.firmware.cycles
    bench.wait(0.05)
    assert bench.device.firmware.cycles == cycles  # a master that was held up finds the axis as it left it
    bench.put(0x6040, 0, 2)
    bench.wait(0.1)
    assert bench.word == 0x40
    assert 60 <= bench.device.firmware.cycles - cycles <= 110


def test_wall_clock_after_a_long_silence(bench: Bench) -> None:
    moving(bench)
    cycles = bench.device.firmware.cycles
    bench.wait(0.35)
    assert 90 <= bench.device.firmware.cycles - cycles <= 110


def test_real_time_runs_by_the_wall_clock(make_bench) -> None:  # type: ignore[no-untyped-def]
    bench = make_bench(real_time=True)
    bench.prepare()
    bench.wait(1.0)
    assert 990 <= bench.get(0x2210, 1) <= 1010
    before = bench.get(0x2210, 1)
    for _ in range(10):
        bench.send(0x080)
    assert bench.get(0x2210, 1) == before


def test_reset_of_the_node(bench: Bench) -> None:
    bench.put(0x2000, 1, 30.0)
    bench.enable()
    bench.take(0x705)
    bench.nmt(129)
    assert bench.word == 0x40
    assert not bench.device.firmware.servo.powered
    assert bench.take(0x705) == [b"\0"]
    assert bench.get(0x2000, 1) == 60.0


def test_reset_of_the_communication_keeps_the_application(bench: Bench) -> None:
    bench.put(0x2000, 1, 30.0)
    bench.put(0x1017, 0, 50)
    bench.nmt(130)
    assert bench.get(0x2000, 1) == 30.0
    assert bench.get(0x1017) == 0


def test_heartbeat_producer(bench: Bench) -> None:
    bench.put(0x1017, 0, 100)
    bench.take(0x705)
    bench.wait(1.0)
    assert 9 <= len(bench.take(0x705)) <= 11
    bench.nmt(1)
    bench.wait(0.2)
    assert bench.take(0x705)[-1] == b"\x05"


def test_one_node_is_watched_once(bench: Bench) -> None:
    bench.put(0x1016, 1, 127 << 16 | 100)
    with pytest.raises(Exception, match="06040043"):
        bench.download(0x1016, 2, struct.pack("<I", 127 << 16 | 200))


def test_error_history_is_cleared_by_zero_only(bench: Bench) -> None:
    bench.device.firmware.fault(0x2310)
    assert bench.get(0x1003, 0) == 1
    with pytest.raises(Exception, match="06090030"):
        bench.put(0x1003, 0, 1)
    bench.put(0x1003, 0, 0)
    assert bench.get(0x1003, 0) == 0


def test_emcy_inhibit_time(bench: Bench) -> None:
    bench.put(0x1015, 0, 500)  # 50 ms
    for code in (0x5000, 0x5001, 0x5002):
        bench.device.node.emergency.report(code, lasting=False)
    bench.wait(0.02)
    assert len(bench.take(0x085)) == 1
    bench.wait(0.06)
    assert len(bench.take(0x085)) == 1


def test_an_axis_that_loses_power_in_motion_rests_when_it_is_back(bench: Bench) -> None:
    """Time does not stand still while the drive starts: a fast master must not find the axis as it was left."""
    start = bench.enable()
    for k in range(100):
        bench.cycle(15, start + 40 * k)  # 5 rad/s
    assert bench.device.firmware.servo.true_velocity == pytest.approx(5.0, abs=0.5)
    bench.device.power_loss()
    bench.wait(0.31)
    assert abs(bench.device.firmware.servo.true_velocity) < 0.05  # its noise shakes it against the brake
