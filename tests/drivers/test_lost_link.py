"""A link that fails under power: power is taken off by whatever still arrives, and nothing unsure is called sure."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import pytest

from autotune.core.drive import Command, Mode
from autotune.core.errors import LinkError, LinkTimeout
from autotune_drivers.canopen.drive import CanopenDrive
from autotune_drivers.canopen.objects import ObjectRef
from tests.drivers import bus
from tests.drivers.bad_wire import BadWire, bad_wire
from tests.drivers.simulator import Simulator, simulator

HOLD = Command(0.0)
REACTION = ObjectRef(0x6007, 0, "i16")
SDO_ANSWERS, SYNC, RPDO_1, TPDO_1 = 0x585, 0x80, 0x205, 0x185


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    """A drive that, but for this program, does nothing about a lost link."""
    with simulator(tmp_path_factory.mktemp("lost")) as process:
        with bus.sdo(process.port) as client:
            client.write(REACTION, 0)
        yield process


@pytest.fixture
def rig(running: Simulator) -> Iterator[tuple[CanopenDrive, BadWire]]:
    drive, wire = bad_wire(running)
    drive._exchange._timeout = 0.1  # s; lost frames never come
    drive.enable(Mode.POSITION)
    at = drive.look().position
    for _ in range(20):
        drive.step(Command(at))
    yield drive, wire
    with suppress(LinkError):
        drive.close()


def lose(drive: CanopenDrive, wire: BadWire, *lost: int) -> LinkTimeout:
    """A cycle without these frames, and what follows it wherever a drive is played."""
    wire.lost.update(lost)
    with pytest.raises(LinkTimeout, match="did not answer SYNC") as caught:
        played(drive)
    return caught.value


def lost(*_: object) -> None:
    raise LinkTimeout("no answer")


def played(drive: CanopenDrive) -> None:
    try:
        drive.step(HOLD)
    finally:
        drive.disable()


def words(error: LinkTimeout) -> str:
    return "; ".join([str(error), *getattr(error, "__notes__", [])])


@pytest.mark.parametrize("lost", [(SYNC,), (TPDO_1,)])
def test_without_process_data_power_goes_by_service_data(
    rig: tuple[CanopenDrive, BadWire], running: Simulator, lost: tuple[int, ...]
) -> None:
    drive, wire = rig
    error = lose(drive, wire, *lost)
    assert drive.powered() is False
    assert "emergency stop" not in words(error)
    drive.close()
    assert not bus.powered(running.port)


def test_a_drive_that_says_nothing_is_not_called_at_rest(
    rig: tuple[CanopenDrive, BadWire], running: Simulator
) -> None:
    drive, wire = rig
    error = lose(drive, wire, SDO_ANSWERS, TPDO_1)
    assert "was not confirmed" in words(error)
    assert "emergency stop" in words(error)
    wire.lost.clear()
    drive.close()
    assert not bus.powered(running.port)


def test_a_guard_that_could_not_be_put_back_is_put_back_by_closing(
    running: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = bus.settings(running.port)
    drive, _ = bad_wire(running)
    drive.enable(Mode.POSITION)
    drive.step(HOLD)
    with monkeypatch.context() as during:
        during.setattr(drive._session, "undo", lost)
        drive.disable()
    drive.close()
    assert bus.settings(running.port) == before


def test_what_a_lost_wire_leaves_is_told_where_nobody_was_told_before(
    running: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive, wire = bad_wire(running)
    drive.enable(Mode.POSITION)
    drive.step(HOLD)
    monkeypatch.setattr(drive._session, "undo", lost)
    drive.disable()
    drive._sdo._channel.timeout = 0.05
    monkeypatch.setattr("autotune_drivers.canopen.sdo.TIMEOUT", 0.05)
    wire.lost.add(SDO_ANSWERS)
    with pytest.raises(LinkError, match=r"not left as it was found.*could not be set back"):
        drive.close()


def test_a_drive_that_may_have_power_keeps_its_own_guard(
    rig: tuple[CanopenDrive, BadWire], running: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive, wire = rig
    monkeypatch.setattr(drive._power, "abandon", lambda *_: False)
    lose(drive, wire, SYNC)
    wire.lost.clear()
    mark = running.mark
    with pytest.raises(LinkError, match=r"power may still be on.*guard.*was left as it is.*emergency stop"):
        drive.close()
    running.wait_for("heartbeat of node 127 lost", mark)
    running.wait_for("-> SWITCH_ON_DISABLED", mark)
    with bus.sdo(running.port) as client:
        client.write(ObjectRef(0x1016, 1, "u32"), 0)
