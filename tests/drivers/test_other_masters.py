"""What is taken for true has to be fresh and ours: slow signals, targets, the bus, the encoder's counts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from autotune.core.axis import Mechanics
from autotune.core.drive import HOLD, Command, Mode
from autotune.core.errors import AutotuneError, ConfigurationError, LinkError, LinkTimeout, StateError
from autotune_drivers.canopen.drive import CanopenDrive
from autotune_drivers.canopen.exchange import SLOW_LOST
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.read_back import BAD, EVERY_SECONDS, LOOKS, RECENT, ReadBack
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.wire import Wire
from autotune_drivers.profile import read_profile
from tests.drivers import bus
from tests.drivers.bad_wire import BadWire, bad_wire
from tests.drivers.fake_node import FakeNode
from tests.drivers.simulator import Simulator, axis_of, simulator
from tests.support.refusals import refusal

Rig = tuple[CanopenDrive, BadWire]
PERIOD = 1e-3
# two objects in turn, and the disagreements that count; once more for where the cut falls
FOUND_WITHIN = (2 * BAD + 1) * round(EVERY_SECONDS / PERIOD) + RECENT


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("others")) as process:
        yield process


@pytest.fixture
def rig(running: Simulator) -> Iterator[Rig]:
    before = bus.settings(running.port)
    drive, wire = bad_wire(running)
    yield drive, wire
    wire.lost.clear()
    wire.overwrite.clear()
    drive.close()
    assert not bus.powered(running.port)
    assert bus.settings(running.port) == before


def play(drive: CanopenDrive, command: Command, played: list[Command]) -> None:
    """2 s of one command; what was played is noted."""
    for _ in range(2000):
        drive.step(command)
        played.append(command)


def sine(drive: CanopenDrive, cycles: int) -> None:
    start = drive.step(HOLD).position
    for k in range(cycles):
        drive.step(Command(start + 0.2 * math.sin(2.0 * math.pi * k * PERIOD), torque_feedforward=1e-4 * k))


# Slow signals


def test_a_temperature_that_no_longer_comes_ends_the_motion(rig: Rig) -> None:
    drive, wire = rig
    drive.enable(Mode.POSITION)
    sine(drive, 50)
    wire.lost.add(0x485)
    count = drive._exchange.count
    with pytest.raises(LinkTimeout, match=r"has not told its temperature .*2220h:01.* 25\.\d °C, is too old"):
        sine(drive, 1000)
    every = read_profile("autotune-sim").cycle.slow_cycles
    assert SLOW_LOST * every <= drive._exchange.count - count + every <= (SLOW_LOST + 1) * every + 2
    drive.disable()
    assert drive.faults() == []


def test_single_losses_of_the_temperature_are_none(rig: Rig) -> None:
    drive, wire = rig
    drive.enable(Mode.POSITION)
    for _ in range(3):
        wire.lost.add(0x485)
        sine(drive, (SLOW_LOST - 1) * read_profile("autotune-sim").cycle.slow_cycles)
        wire.lost.clear()
        sine(drive, 110)
    assert drive.step(HOLD).temperature == pytest.approx(25.0, abs=1.0)
    drive.disable()
    assert drive.faults() == []


# Our own targets


@pytest.mark.parametrize("mode", [Mode.TORQUE, Mode.VELOCITY])
def test_process_data_that_are_lost_are_noticed_and_the_axis_is_stopped(rig: Rig, mode: Mode) -> None:
    """Neither target nor quick stop reach the drive by PDO any more: then by SDO."""
    drive, wire = rig
    drive.enable(mode)
    moving = Command(torque=0.06, velocity=3.0)
    for _ in range(100):
        drive.step(moving)
    wire.lost.add(0x205)
    played: list[Command] = []
    with pytest.raises(
        LinkError, match=r"does not have the target that it was sent: object 60.* sent 0 to 0"
    ):
        play(drive, Command(), played)
    assert len(played) <= FOUND_WITHIN
    drive.disable()
    assert int(drive._sdo.read(bus.STATUS)) & 0x6F not in (0x27, 0x07)


def test_another_masters_target_is_noticed(rig: Rig) -> None:
    drive, wire = rig
    drive.enable(Mode.TORQUE)
    for _ in range(100):
        drive.step(Command())
    wire.overwrite.append((0x205, b"\x0f\x00\x1e\x00\x00\x00"))  # operation enabled, 30 ‰
    played: list[Command] = []
    with pytest.raises(LinkError, match=r"6071h:00 is 30, .* another master writes them"):
        play(drive, Command(), played)
    assert len(played) <= FOUND_WITHIN
    drive.disable()  # he says "operation enabled" in every cycle, before and after our SDO
    wire.overwrite.clear()


def test_a_long_motion_disagrees_with_nothing(rig: Rig) -> None:
    drive, _ = rig
    for mode in Mode:
        drive.enable(mode)
        start = drive.step(HOLD).position
        for k in range(600):
            swing = math.sin(2.0 * math.pi * k * PERIOD)
            drive.step(Command(start + 0.2 * swing, 1.5 * swing, 0.05 * swing, 0.02 * swing))
        drive.disable()
        assert drive.faults() == [], mode


def looks(values: list[int], sent: list[int]) -> None:
    """Reads a target back that has `values` one after the other, while `sent` is commanded."""
    ref = ObjectRef.parse("6071:00 i16")
    link = FakeNode({(0x6071, 0): b"\0\0"})
    wire = Wire(link, 127, 0.05)
    reader = ReadBack(Sdo(wire, 5), EVERY_SECONDS)
    reader.begin([(ref, 1)])
    for value, target in zip(values, sent, strict=True):
        link.objects[0x6071, 0] = ref.encode(value)
        reader.cycle((0x0F, target, 0))
        wire.drain()


def test_a_drive_that_does_not_show_its_target_is_not_accused() -> None:
    assert refusal(lambda: looks([0] * 40, list(range(40)))) == ""
    assert refusal(lambda: looks([7] * 40, list(range(100, 140)))) == ""


def test_a_target_that_moves_without_us_is() -> None:
    with pytest.raises(LinkError, match="is 55"):
        looks([3] * 20 + [55] * 20, [3] * 40)


def test_one_disagreement_is_none() -> None:
    looks([*range(20), -9, *range(21, 41), -9, *range(42, 50)], list(range(50)))
    assert BAD <= LOOKS


def test_an_object_that_cannot_be_read_is_left_alone() -> None:
    ref = ObjectRef.parse("6071:00 i16")
    link = FakeNode({})
    wire = Wire(link, 127, 0.05)
    reader = ReadBack(Sdo(wire, 5), EVERY_SECONDS)
    reader.begin([(ref, 1)])
    asked = len(link.sent)
    for _ in range(50):
        reader.cycle((0x0F, 5, 0))
        wire.drain()
    assert len(link.sent) == asked


def test_an_object_that_can_no_longer_be_read_is_asked_once() -> None:
    ref = ObjectRef.parse("6071:00 i16")
    link = FakeNode({(0x6071, 0): b"\0\0"})
    wire = Wire(link, 127, 0.05)
    reader = ReadBack(Sdo(wire, 5), EVERY_SECONDS)
    reader.begin([(ref, 1)])
    link.refuse[0x6071, 0, "read"] = 0x08000022
    asked = len(link.sent)
    for _ in range(50):
        reader.cycle((0x0F, 5, 0))
        wire.drain()
    assert len(link.sent) == asked + 1


def test_a_drive_that_no_longer_answers_sdo_is_told() -> None:
    ref = ObjectRef.parse("6071:00 i16")
    link = FakeNode({(0x6071, 0): b"\0\0"})
    wire = Wire(link, 127, 0.05)
    reader = ReadBack(Sdo(wire, 5), EVERY_SECONDS)
    reader.begin([(ref, 1)])

    def played(cycles: int) -> None:
        for _ in range(cycles):
            reader.cycle((0x0F, 0, 0))
            wire.drain()

    played(20)
    link.swallow = 1000
    with pytest.raises(LinkTimeout, match="can no longer be read back"):
        played(200)


# Who else is on the bus

STRANGERS = {
    "NMT commands": [(0x000, b"\x80\x00")],
    "SYNC messages": [(0x080, b"")] * 3,
    "process data for node 5": [(0x205, b"\x0f\x00\x1e\x00\x00\x00")] * 3,
    "SDO requests to node 5": [(0x605, b"\x40\x41\x60\x00\0\0\0\0")],
    "the heartbeat of node 127": [(0x77F, b"\x05")],
}


@pytest.mark.parametrize("who", STRANGERS)
def test_another_master_is_named_while_power_is_on(rig: Rig, who: str) -> None:
    drive, wire = rig
    drive.enable(Mode.POSITION)
    sine(drive, 20)
    wire.heard += STRANGERS[who]
    with pytest.raises(StateError, match=rf"another master.*{who}.*COB-ID {STRANGERS[who][0][0]:03X}h"):
        sine(drive, 3)
    drive.disable()


@pytest.mark.parametrize("who", STRANGERS)
def test_no_power_beside_another_master(rig: Rig, who: str) -> None:
    drive, wire = rig
    wire.heard += STRANGERS[who]
    with pytest.raises(StateError, match="another master") as caught:
        drive.enable(Mode.POSITION)
    assert not hasattr(caught.value, "__notes__")  # there was no power to be taken off
    with pytest.raises(AutotuneError):
        drive.step(HOLD)


HARMLESS = [
    (0x000, b"\x01\x07"),  # another node is started
    (0x205, b"\0\0"),  # one bit flipped in our own drive's 285h
    (0x206, b"\0\0"),  # process data of a neighbour
    (0x606, b"\x40\x41\x60\x00\0\0\0\0"),
    (0x605, b"\x05"),  # one bit flipped in 705h
    (0x100, b"\0\0\0\0\0\0"),
    (0x701, b"\x05"),
]


def test_a_neighbour_and_a_corrupted_frame_are_no_master(rig: Rig) -> None:
    drive, wire = rig
    drive.enable(Mode.POSITION)
    wire.heard += HARMLESS
    sine(drive, 50)
    assert not wire.heard  # all of them were looked at
    drive.disable()
    assert drive.faults() == []


# The encoder


@pytest.mark.parametrize("counts", [5000, 12500, 500000])
def test_an_axis_that_counts_otherwise_than_its_drive_is_refused(running: Simulator, counts: int) -> None:
    before = bus.settings(running.port)
    with pytest.raises(
        ConfigurationError, match=rf"is {counts} in the axis file, but node 5 counts 50000 in"
    ):
        bad_wire(running, axis_of(mechanics=Mechanics(counts_per_revolution=counts)))
    assert bus.settings(running.port) == before


def test_a_profile_may_say_that_608f_is_not_to_be_compared(running: Simulator, tmp_path: Path) -> None:
    from autotune_drivers.canopen.opening import open_drive
    from autotune_drivers.canopen.slcan import open_slcan

    profile = read_profile("autotune-sim").model_copy(update={"encoder": "none"})
    axis = axis_of(mechanics=Mechanics(counts_per_revolution=5000))
    drive = open_drive(open_slcan(running.port, 1000000), 5, axis, profile)
    try:
        assert drive.faults() == []
    finally:
        drive.close()
