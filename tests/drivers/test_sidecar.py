"""A sidecar and a simulated drive in one process; the master is this test."""

from __future__ import annotations

import struct
import time
from itertools import pairwise
from pathlib import Path

import pytest

from autotune.core.errors import ConfigurationError, StateError, TransferAborted
from autotune_drivers.canopen import sidecar as module
from autotune_drivers.canopen.frames import Frame
from autotune_drivers.canopen.sidecar import Foreign, Sidecar, Synchronised, Target, Told, open_sidecar
from autotune_drivers.profile import Profile, read_profile
from tests.drivers.simulator import axis_of
from tests.node.support import NODE, Bench

PROFILE = read_profile("autotune-sim")
AXIS = axis_of()
COUNT = AXIS.position_resolution
SET_POINTS, OWN = 0x200 + NODE, 0x500 + NODE


class Bus:
    """The sidecar's adapter: a bench's bus, on which a master may be alive."""

    name, hint = "bench", ""

    def __init__(self) -> None:
        self.bench = Bench()
        self.bench.now = time.monotonic()
        self.bench.wait(0.01)
        self.alive = True
        self.also: list[Frame] = []
        self.sent: list[Frame] = []
        self.target = 0
        self.start()

    def start(self) -> None:
        """The master: mapped, operational, axis enabled."""
        self.bench.map(0x1400, SET_POINTS, [0x60400010, 0x607A0020])
        self.bench.put(0x6060, 0, 8)
        self.bench.put(0x60C2, 1, 1)
        self.bench.nmt(1)
        for word in (0, 6, 7, 15):
            self.master(word)
        self.bench.frames.clear()

    def master(self, word: int = 15) -> None:
        data = struct.pack("<Hi", word, self.target)
        self.bench.frames.append((SET_POINTS, data))
        self.bench.send(SET_POINTS, data)
        self.bench.frames.append((0x080, b""))
        self.bench.send(0x080)

    def send(self, *frames: Frame) -> None:
        for cob_id, data in frames:
            self.sent.append((cob_id, data))
            self.bench.send(cob_id, data)

    def receive(self, timeout: float) -> list[Frame]:
        """A cycle of the master passes where somebody waits; who does not, gets what is there."""
        if timeout > 0.0:
            self.bench.now += AXIS.cycle
            self.bench.device.poll(self.bench.now)
            if self.alive:
                self.master()
        frames = [*self.also, *self.bench.frames]
        self.bench.frames.clear()
        if not frames:
            time.sleep(min(timeout, 0.01))
        return frames

    def close(self) -> None:
        pass


def listened(link: Bus, seconds: float) -> list[Frame]:
    """As `drain`, in the time of the bus."""
    return [frame for _ in range(round(seconds / AXIS.cycle)) for frame in link.receive(AXIS.cycle)]


@pytest.fixture(autouse=True)
def in_the_time_of_the_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is listened to for 0.3 s are 300 cycles of the bus, not as many as this processor manages."""
    monkeypatch.setattr(module, "drain", listened)


@pytest.fixture
def bus() -> Bus:
    return Bus()


def opened(bus: Bus, keep: Path | None = None, profile: Profile = PROFILE) -> Sidecar:
    return open_sidecar(bus, NODE, AXIS, profile, keep)


def test_it_hears_master_and_drive_and_its_offset_acts(bus: Bus, tmp_path: Path) -> None:
    sidecar = opened(bus, tmp_path)
    sidecar.prepare()
    assert list(tmp_path.glob("*.json"))  # what will be changed is on disk
    bus.target = 3
    events = [event for _ in range(3) for event in sidecar.listen(0.01)]
    kinds = {type(event) for event in events}
    assert kinds == {Target, Synchronised, Told}
    assert Target(3 * COUNT) in events
    told = [event for event in events if isinstance(event, Told)]
    assert told[-1].following
    sidecar.send(0.1)
    sidecar.listen(0.01)
    assert bus.bench.device.firmware.host_offset == pytest.approx(0.1, abs=5e-4)  # one per mille of 0.5 N m
    sidecar.send(0.0)
    sidecar.listen(0.01)
    assert sidecar.close(dropped=True) == []
    assert bus.bench.get(0x1403, 1) == 0x80000505
    assert bus.bench.get(0x1403, 5) == 0
    assert not list(tmp_path.glob("*.json"))
    assert all(cob_id in (0x600 + NODE, OWN) for cob_id, _ in bus.sent)  # neither NMT nor SYNC nor set points


def test_a_drive_drops_the_offset_of_a_dead_sidecar_and_the_next_one_puts_back(
    bus: Bus, tmp_path: Path
) -> None:
    dead = opened(bus, tmp_path)
    dead.prepare()
    offsets = []
    for _ in range(200):
        dead.send(0.4)
        dead.listen(0.01)
    for _ in range(round(dead.gone_within / AXIS.cycle) + 2):
        bus.receive(0.01)
        offsets.append(bus.bench.device.firmware.host_offset)
    assert offsets[10] == pytest.approx(0.4, abs=5e-4)
    assert offsets[-1] == 0.0
    assert max(a - b for a, b in pairwise(offsets)) < 0.05 * AXIS.limits.torque
    sidecar = opened(bus, tmp_path)
    assert "put back" in " ".join(sidecar.left)
    assert bus.bench.get(0x1403, 1) == 0x80000505
    assert bus.bench.word == 0x27  # the master's axis was left alone


def test_a_sidecar_that_comes_at_once_waits_until_the_offset_of_the_dead_one_is_gone(
    bus: Bus, tmp_path: Path
) -> None:
    dead = opened(bus, tmp_path)
    dead.prepare()
    for _ in range(200):
        dead.send(0.4)
        dead.listen(0.01)
    sidecar = opened(bus, tmp_path)
    assert "put back" in " ".join(sidecar.left)
    assert bus.bench.get(0x60B2) == 0
    bus.receive(0.01)
    assert bus.bench.device.firmware.host_offset == 0.0
    sidecar.prepare()
    assert sidecar.close(dropped=True) == []


def test_settings_go_only_after_the_drive_has_dropped_what_stands(bus: Bus) -> None:
    sidecar = opened(bus)
    sidecar.prepare()
    for _ in range(200):
        sidecar.send(0.4)
        sidecar.listen(0.01)
    assert sidecar.close(dropped=False) == []
    assert bus.bench.get(0x60B2) == 0
    bus.receive(0.01)
    assert bus.bench.device.firmware.host_offset == 0.0


def test_another_producer_is_heard(bus: Bus) -> None:
    sidecar = opened(bus)
    sidecar.prepare()
    bus.also = [(OWN, b"\0\0")]
    assert Foreign(OWN) in sidecar.listen(0.01)


def written(bus: Bus) -> list[object]:
    """What is written to the drive from now on."""
    writes: list[object] = []
    bus.bench.device.on_write = writes.append
    return writes


def prepared_and_closed(bus: Bus, profile: Profile = PROFILE) -> None:
    sidecar = opened(bus, profile=profile)
    try:
        sidecar.prepare()
    finally:
        assert sidecar.close(dropped=True) == []


def test_another_producer_refuses(bus: Bus) -> None:
    bus.also = [(OWN, b"\0\0")]
    writes = written(bus)
    with pytest.raises(StateError, match="somebody sends 505h"):
        prepared_and_closed(bus)
    assert not writes


def test_no_master_refuses(bus: Bus) -> None:
    bus.alive = False
    writes = written(bus)
    with pytest.raises(StateError, match="no SYNC was heard"):
        prepared_and_closed(bus)
    assert not writes


def test_a_master_that_has_not_mapped_set_points_refuses(bus: Bus) -> None:
    bus.bench.put(0x1400, 1, 0x80000205)
    writes = written(bus)
    with pytest.raises(StateError, match="mapped to 0 PDOs"):
        prepared_and_closed(bus)
    assert not writes


def test_a_master_with_an_offset_of_its_own_refuses(bus: Bus) -> None:
    bus.bench.map(0x1401, 0x305, [0x60B20010])
    writes = written(bus)
    with pytest.raises(StateError, match=r"sends torque_feedforward|sends object"):
        prepared_and_closed(bus)
    assert not writes


def test_an_offset_that_stands_refuses(bus: Bus) -> None:
    bus.bench.put(0x60B2, 0, 5)
    writes = written(bus)
    with pytest.raises(StateError, match="is 5, not 0"):
        prepared_and_closed(bus)
    assert not writes


def test_no_free_pdo_refuses(bus: Bus) -> None:
    for number in (1, 2, 3):
        bus.bench.map(0x1400 + number, 0x205 + 0x100 * number, [0x60FF0020])
    writes = written(bus)
    with pytest.raises(StateError, match="all 4 receive PDOs"):
        prepared_and_closed(bus)
    assert not writes


def test_a_profile_without_a_time_out_refuses(bus: Bus) -> None:
    writes = written(bus)
    with pytest.raises(ConfigurationError, match="names no time-out"):
        prepared_and_closed(bus, PROFILE.model_copy(update={"offset_guard": None}))
    assert not writes


@pytest.mark.parametrize("held", [0, 100])
def test_a_drive_that_holds_another_time_out_refuses(bus: Bus, held: int) -> None:
    """It took the write and kept a value of its own; an offset would have stood for as long, or for ever."""
    timer = bus.bench.device.objects[0x1403, 5]
    timer.read = lambda: held if timer.value else 0
    with pytest.raises(StateError, match=f"holds {held} ms, where 20 were written"):
        prepared_and_closed(bus)
    assert not any(cob_id == OWN for cob_id, _ in bus.sent)
    assert bus.bench.get(0x1403, 1) == 0x80000505, "the mapping is as before"


def test_another_cycle_than_the_axis_refuses(bus: Bus) -> None:
    bus.bench.device.objects[0x60C2, 1].value = 2
    writes = written(bus)
    with pytest.raises(ConfigurationError, match="60C2h"):
        prepared_and_closed(bus)
    assert not writes


class Killed(BaseException):
    """kill -9: nothing after it is run."""


def cut(bus: Bus, number: int, *, arrives: bool) -> None:
    """The process dies with its frame of that number; that frame still reaches the drive, or not."""
    send, left = bus.send, iter(range(number, -1, -1))

    def dying(*frames: Frame) -> None:
        last = next(left) == 0
        if arrives or not last:
            send(*frames)
        if last:
            raise Killed

    bus.send = dying  # type: ignore[method-assign]


def of_the_drive(bus: Bus) -> list[int]:
    """All that a sidecar may change: both free PDOs and the offset."""
    places = [(index, sub) for index in (0x1403, 0x1803) for sub in (1, 2, 5)]
    places += [(index, sub) for index in (0x1603, 0x1A03) for sub in range(3)]
    return [bus.bench.get(*place) for place in (*places, (0x60B2, 0))]


def session(bus: Bus, keep: Path) -> None:
    sidecar = opened(bus, keep)
    sidecar.prepare()
    sidecar.close(dropped=True)


@pytest.mark.parametrize("arrives", [True, False])
def test_a_session_cut_at_any_write_is_put_right_by_the_next_start(
    tmp_path: Path, arrives: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While it prepares, and while it puts back: kill -9 runs no `finally`. Between two writes nothing changes."""
    monkeypatch.setattr(module, "_LISTEN", 0.01)
    whole = Bus()
    before = of_the_drive(whole)
    session(whole, tmp_path / "whole")
    writes = [number for number, (_, data) in enumerate(whole.sent) if data[0] >> 5 == 1]  # SDO downloads
    assert len(writes) > 20
    for number in writes:
        bus, keep = Bus(), tmp_path / f"{arrives}-{number}"
        send = bus.send
        cut(bus, number, arrives=arrives)
        with pytest.raises(Killed):
            session(bus, keep)
        bus.send = send  # type: ignore[method-assign]
        opened(bus, keep)
        assert of_the_drive(bus) == before, number
        assert not list(keep.glob("*.json")), number
        assert bus.bench.word == 0x27, number  # the master's axis goes on


def test_what_the_master_has_mapped_since_is_left_to_it(bus: Bus, tmp_path: Path) -> None:
    dead = opened(bus, tmp_path)
    dead.prepare()
    bus.bench.map(0x1403, 0x306, [0x60FF0020])  # its start-up list, while nobody plays
    sidecar = opened(bus, tmp_path)
    assert "left as they are" in " ".join(sidecar.left)
    assert bus.bench.get(0x1403, 1) == 0x306
    assert bus.bench.get(0x1603, 1) == 0x60FF0020


def test_a_drive_that_was_switched_off_since_needs_nothing(bus: Bus, tmp_path: Path) -> None:
    opened(bus, tmp_path).prepare()
    again = Bus()
    before = of_the_drive(again)
    sidecar = opened(again, tmp_path)
    assert of_the_drive(again) == before
    assert sidecar.left == ()
    assert not list(tmp_path.glob("*.json"))


def test_a_drive_that_maps_in_pre_operational_only_is_told_and_left_as_it_was(
    bus: Bus, tmp_path: Path
) -> None:
    before, send = of_the_drive(bus), bus.send

    def refusing(*frames: Frame) -> None:
        for cob_id, data in frames:
            index, sub = struct.unpack_from("<HB", data, 1)
            if data[0] >> 5 == 1 and index == 0x1603:
                bus.bench.frames.append((0x580 + NODE, struct.pack("<BHBI", 0x80, index, sub, 0x08000022)))
            else:
                send((cob_id, data))

    bus.send = refusing  # type: ignore[method-assign]
    sidecar = opened(bus, tmp_path)
    with pytest.raises(TransferAborted, match=r"1603h.*device state"):
        sidecar.prepare()
    assert sidecar.close(dropped=True) == []
    assert of_the_drive(bus) == before
    assert not list(tmp_path.glob("*.json"))
