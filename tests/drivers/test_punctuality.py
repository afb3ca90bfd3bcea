"""Whose silence was it: the host's own delay is told apart from the drive's."""

from __future__ import annotations

import logging
import pickle

import pytest

from autotune.core.errors import DriveFault, HostLate, LinkTimeout
from autotune_drivers import punctuality as module
from autotune_drivers.canopen.frames import Frame
from autotune_drivers.punctuality import LASTS, Punctuality
from tests.drivers.power_rig import StateDrive, power_of


class Clock:
    now = 50.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


def test_a_delay_counts_while_it_is_fresh(clock: Clock) -> None:
    late = Punctuality()
    assert not late.blamed(0.15)
    late.note(-0.01)
    late.note(0.12)
    late.note(0.03)
    assert late.recent == pytest.approx(0.12)
    assert late.blamed(0.15)
    clock.now += 1.01 * LASTS
    assert late.recent == 0.0
    assert not late.blamed(0.15, usual=0.1)
    late.note(0.02)
    assert late.recent == pytest.approx(0.02)
    assert late.worst == pytest.approx(0.12)
    late.begin()
    assert late.worst == 0.0


def test_a_late_host_is_blamed_for_a_lost_heartbeat() -> None:
    drive = StateDrive()
    power, exchange = power_of(drive)
    drive.fail(0x8130)
    exchange.cycle((0x0F, 0, 0))
    exchange._wire.punctuality.note(0.3)
    error = power.lost()
    assert isinstance(error, HostLate)
    assert "heard nothing from it for 325 ms, where 150 ms are allowed" in str(error)
    assert "8130h" in str(error)


def test_a_host_in_time_is_not() -> None:
    drive = StateDrive()
    power, exchange = power_of(drive)
    drive.fail(0x8130)
    exchange.cycle((0x0F, 0, 0))
    error = power.lost()
    assert isinstance(error, DriveFault)
    assert "this host sent every heartbeat" in str(error)


def test_a_late_host_hides_no_fault_of_the_drive() -> None:
    drive = StateDrive()
    power, exchange = power_of(drive)
    drive.emergency(0x8130)
    drive.fail(0x2310)
    exchange.cycle((0x0F, 0, 0))
    exchange._wire.punctuality.note(0.3)
    error = power.lost()
    assert isinstance(error, DriveFault)
    assert error.code == 0x2310


def test_unanswered_syncs_are_the_hosts_own_where_it_stood_still_in_between(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drive = StateDrive()
    _, exchange = power_of(drive)
    monkeypatch.setattr(exchange, "_timeout", 0.05)
    exchange._wire.punctuality.note(0.3)  # before this cycle: no excuse for it
    drive.node.on_sync = lambda rpdos: []
    with pytest.raises(LinkTimeout, match="did not answer SYNC"):
        exchange.cycle((0x0F, 0, 0))

    def stand_still(rpdos: object) -> list[Frame]:
        exchange._wire.punctuality.note(0.3)
        return []

    drive.node.on_sync = stand_still
    with pytest.raises(HostLate, match="1 answers to SYNC in a row did not come"):
        exchange.cycle((0x0F, 0, 0))


def test_a_drive_that_left_operational_in_time_is_to_be_looked_at() -> None:
    drive = StateDrive()
    _, exchange = power_of(drive)
    exchange._wire.punctuality.note(0.04)
    assert exchange._own_delay("pre-operational") is None
    exchange._wire.punctuality.note(0.08)
    assert exchange._own_delay("silent") is None
    error = exchange._own_delay("pre-operational")
    assert error is not None
    assert "went to 'pre-operational'" in str(error)


def test_a_host_that_is_nearly_too_late_is_told_once_a_session(caplog: pytest.LogCaptureFixture) -> None:
    drive = StateDrive()
    power, exchange = power_of(drive)
    with caplog.at_level(logging.WARNING):
        power.look_back()
        assert not caplog.records
        exchange._wire.punctuality.note(0.08)
        power.look_back()
        power.look_back()
    assert [record.getMessage()[:40] for record in caplog.records] == [
        "this host is hardly fast enough: node 5 "
    ]


def test_the_error_travels_between_processes() -> None:
    late = HostLate("late", 0.3)
    late.add_note("power could not be taken off")
    error = pickle.loads(pickle.dumps(late))
    assert isinstance(error, HostLate)
    assert (str(error), error.seconds, error.exit_code) == ("late", 0.3, 5)
    assert error.__notes__ == ["power could not be taken off"]
