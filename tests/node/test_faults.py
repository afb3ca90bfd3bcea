"""Faults on order: the language, and what each does."""

from __future__ import annotations

import pytest

from autotune.core.errors import ConfigurationError
from autotune_sim.faults import Faults, Order, parse_order
from tests.node.support import Bench, Refused


class Cable:
    """Stands for the adapter's cable."""

    def __init__(self) -> None:
        self.plugged = True

    def plug(self) -> None:
        self.plugged = True

    def unplug(self) -> None:
        self.plugged = False


@pytest.fixture
def cable() -> Cable:
    return Cable()


@pytest.fixture
def faults(bench: Bench, cable: Cable) -> Faults:
    return Faults(bench.device, cable, lambda: bench.now, bench.log.append)


@pytest.mark.parametrize(
    ("text", "order"),
    [
        ("silent", Order("silent")),
        ("silent=0.5@2.5", Order("silent", "0.5", "motion", 2.5)),
        ("drive-fault=3210@500c", Order("drive-fault", "3210", "sync", 500)),
        ("unplugged@3w", Order("unplugged", "", "wall", 3)),
        ("power-loss@store", Order("power-loss", "", "store")),
        ("power-loss@write", Order("power-loss", "", "write", 1)),
        ("power-loss@write3", Order("power-loss", "", "write", 3)),
        ("sdo-abort=2100:07:06090030", Order("sdo-abort", "2100:07:06090030")),
    ],
)
def test_orders(text: str, order: Order) -> None:
    assert parse_order(text) == order


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("silnet", "did you mean 'silent'"),
        ("silent@soon", "is no time"),
        ("silent=long", "must be seconds"),
        ("drive-fault=xyz", "four hexadecimal digits"),
        ("sdo-abort", "must be INDEX"),
        ("blocked=1", "left out"),
        ("", "known are"),
        ("= @", "known are"),
    ],
)
def test_orders_that_cannot_be(text: str, hint: str) -> None:
    with pytest.raises(ConfigurationError, match=hint):
        parse_order(text)


def put(faults: Faults, text: str) -> None:
    faults.add(parse_order(text))


def test_silent_for_a_while(bench: Bench, faults: Faults) -> None:
    put(faults, "silent=0.5")
    bench.send(0x605, bytes.fromhex("4000100000000000"))
    assert bench.take(0x585) == []
    bench.wait(0.6)
    faults.poll(bench.now)
    assert bench.upload(0x1000)


def test_unplugged_and_back(bench: Bench, faults: Faults, cable: Cable) -> None:
    put(faults, "unplugged=0.5")
    assert not cable.plugged
    assert faults.poll(bench.now) == pytest.approx(bench.now + 0.5)
    bench.wait(0.6)
    faults.poll(bench.now)
    assert cable.plugged


def test_after_two_tenths_of_motion(bench: Bench, faults: Faults) -> None:
    put(faults, "drive-fault=3210@0.2")
    bench.prepare()
    for _ in range(100):
        bench.cycle(0)
    start = bench.enable()
    cycles = 0
    while bench.word == 0x27:
        bench.cycle(15, start)
        cycles += 1
        assert cycles < 300
    assert 198 <= cycles <= 201
    for _ in range(50):
        bench.cycle(15, start)
    assert int(bench.get(0x603F)) == 0x3210


def test_after_so_many_syncs(bench: Bench, faults: Faults) -> None:
    put(faults, "drive-fault@10c")
    bench.prepare()
    for _ in range(9):
        bench.cycle(0)
    assert bench.word == 0x40
    bench.cycle(0)
    assert bench.word == 0x08


def test_at_a_time_of_the_wall_clock(bench: Bench, faults: Faults) -> None:
    put(faults, "drive-fault@2w")
    bench.wait(1.9)
    faults.poll(bench.now)
    assert bench.word == 0x40
    bench.wait(0.2)
    faults.poll(bench.now)
    assert bench.word == 0x08


def test_power_lost_at_the_third_write(bench: Bench, faults: Faults) -> None:
    put(faults, "power-loss@write3")
    bench.put(0x2100, 2, 0.1)
    bench.put(0x1017, 0, 100)
    bench.put(0x2100, 3, 0.1)
    bench.take(0x585)
    bench.send(0x605, bytes.fromhex("23002104") + b"\0\0\0\0")
    assert bench.take(0x585) == []
    bench.wait(0.5)
    assert bench.get(0x2100, 2) == 0.0


def test_power_lost_while_storing(bench: Bench, faults: Faults) -> None:
    put(faults, "power-loss@store")
    bench.put(0x2100, 2, 0.1)
    bench.send(0x605, bytes.fromhex("23101001") + b"save")
    bench.wait(0.7)
    assert bench.take(0x585) == []
    assert bench.get(0x2100, 2) == 0.0


def test_refused_transfers(bench: Bench, faults: Faults) -> None:
    put(faults, "sdo-abort=2100:07:06090030")
    bench.put(0x2100, 6, 1.0)
    with pytest.raises(Refused) as refused:
        bench.put(0x2100, 7, 1.0)
    assert refused.value.code == 0x06090030
    put(faults, "sdo-abort=2000")
    with pytest.raises(Refused) as refused:
        bench.get(0x2000, 3)
    assert refused.value.code == 0x08000000
    put(faults, "clear")
    bench.put(0x2100, 7, 1.0)


def test_emcy_alone(bench: Bench, faults: Faults) -> None:
    put(faults, "emcy=6320")
    bench.wait(0.002)
    assert bench.take(0x085)[0][:2] == bytes.fromhex("2063")
    assert bench.word == 0x40
    assert bench.get(0x603F) == 0


@pytest.mark.parametrize(
    ("text", "code"),
    [("blocked", 0x8611), ("hot", 0x4310), ("brake-missing", 0xFF11), ("enable-missing", 0xFF10)],
)
def test_faults_of_the_axis(bench: Bench, faults: Faults, text: str, code: int) -> None:
    start = bench.enable()
    put(faults, text)
    for k in range(1000):
        bench.cycle(15, start + 5 * k)
    assert bench.word == 0x08
    assert int(bench.get(0x603F)) == code
    put(faults, "clear")
    bench.cycle(0)
    assert bench.cycle(0x80)[0] & 0x4F == 0x40


def test_other_identity_and_nvm(bench: Bench, faults: Faults) -> None:
    put(faults, "other-identity=9A")
    assert bench.get(0x1018, 1) == 0x9A
    put(faults, "nvm")
    assert bench.memory.lossy
    put(faults, "clear")
    assert bench.get(0x1018, 1) == 0x7FFFA701
    assert not bench.memory.lossy
