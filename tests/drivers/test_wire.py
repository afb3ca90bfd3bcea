"""Our heartbeat and the node's: sent while the wire is used, and never believed for too long."""

from __future__ import annotations

import time

import pytest

from autotune_drivers.canopen.frames import Frame
from autotune_drivers.canopen.node import OPERATIONAL, SILENT, Node
from autotune_drivers.canopen.wire import Wire
from tests.drivers.fake_node import FakeNode


def beats(link: FakeNode) -> int:
    return sum(frame == (0x77F, b"\x05") for frame in link.sent)


def test_the_heartbeat_goes_out_with_whatever_uses_the_wire(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [10.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    link = FakeNode({})
    wire = Wire(link, 127, 0.025)
    wire.send((0x80, b""))
    assert beats(link) == 0
    wire.start_heartbeat()
    for _ in range(100):
        wire.send((0x80, b""))
        now[0] += 1e-3
    assert beats(link) == 4
    now[0] += 1.0  # a stall is not made up for
    wire.pump(0.0)
    wire.pump(0.0)
    assert beats(link) == 5
    wire.stop_heartbeat()
    now[0] += 1.0
    wire.pump(0.0)
    assert beats(link) == 5


def test_a_node_that_was_operational_long_ago_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [10.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    link = FakeNode({})
    wire = Wire(link, 127, 0.025)
    node = Node(wire, 5)
    node.monitor(0.1)
    link.reply((0x705, b"\x05"))
    wire.pump(0.0)
    assert node.nmt_state == OPERATIONAL
    now[0] += 0.29
    assert node.nmt_state == OPERATIONAL
    now[0] += 0.02
    assert node.nmt_state == SILENT


def test_emergencies_and_boots_are_kept() -> None:
    link = FakeNode({})
    wire = Wire(link, 127, 0.025)
    node = Node(wire, 5)
    link.reply((0x085, bytes.fromhex("1086 21 0000000000")), (0x705, b"\0"), (0x085, b"\1"))
    wire.pump(0.0)
    assert [(emergency.code, emergency.register) for emergency in node.take_emergencies()] == [(0x8610, 0x21)]
    assert node.take_emergencies() == []
    assert node.boots == 1


def test_a_babbling_bus_does_not_hold_us(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each frame takes a millisecond here, on a clock of the test's own."""
    clock = [0.0]

    def babble(timeout: float) -> list[Frame]:
        clock[0] += 1e-3
        return [(0x7FF, b"")]

    link = FakeNode({})
    link.receive = babble  # type: ignore[method-assign]
    wire = Wire(link, 127, 0.025)
    monkeypatch.setattr("autotune_drivers.canopen.wire.time.monotonic", lambda: clock[0])
    wire.drain()
    assert 0.0 < clock[0] < 0.01


def test_a_heartbeat_that_is_due_and_not_sent_yet_is_late_already(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that was stopped learns first that its drive has stopped the axis."""
    clock = [1000.0]
    monkeypatch.setattr("autotune_drivers.canopen.wire.time.monotonic", lambda: clock[0])
    wire = Wire(FakeNode({}), 127, 0.025)
    wire.look_at_the_clock()
    assert wire.punctuality.worst == 0.0  # none is to be sent
    wire.start_heartbeat()
    clock[0] += 0.4
    wire.look_at_the_clock()
    assert wire.punctuality.worst == pytest.approx(0.4, abs=0.1)
