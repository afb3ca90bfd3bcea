"""A line that loses most of what is sent is given up in time, and each new beginning is tried all the same."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from autotune.core.errors import LinkTimeout
from autotune_drivers.moteus import node as module
from autotune_drivers.moteus.node import MoteusNode

WAIT = 0.25  # s, of one request


class DeafPort:
    """Nothing ever comes back; waiting for it costs its time on a clock of its own."""

    name = "deaf"
    baud = 921600

    def __init__(self) -> None:
        self.now = 0.0
        self.sent = 0
        self.reader = SimpleNamespace(garbled=0, received=0, unfinished=False, understood=0)

    def monotonic(self) -> float:
        return self.now

    def lines(self, timeout: float) -> list[Any]:
        self.now += max(timeout, 0.0) + 1e-6
        return []

    def write(self, data: bytes) -> None:
        self.sent += 1

    def drain(self) -> None:
        return


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> DeafPort:
    port = DeafPort()
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=port.monotonic))
    return port


def ask(node: MoteusNode) -> None:
    with pytest.raises(LinkTimeout):
        node.request(b"", lambda data: True, WAIT)


def test_what_is_asked_on_a_line_that_loses_everything_ends_in_time(port: DeafPort) -> None:
    """Sixty settings: a minute where each is asked for four times, twenty-odd seconds where patience ends."""
    node = MoteusNode(port, 1)  # type: ignore[arg-type]
    for _ in range(60):
        ask(node)
    assert port.now < 25.0
    with pytest.raises(LinkTimeout, match="loses so much"):
        node.tell(b"", WAIT)


def test_a_new_beginning_is_tried_as_often_as_ever(port: DeafPort) -> None:
    node = MoteusNode(port, 1)  # type: ignore[arg-type]
    ask(node)
    often, port.sent = port.sent, 0
    for _ in range(40):
        ask(node)
    port.sent = 0
    ask(node)
    assert port.sent == 1
    node.be_patient()
    port.sent = 0
    ask(node)
    assert port.sent == often == 4


def test_a_loss_now_and_then_never_adds_up(port: DeafPort) -> None:
    node = MoteusNode(port, 1)  # type: ignore[arg-type]
    for _ in range(200):
        ask(node)
        port.now += 12.0
    port.sent = 0
    ask(node)
    assert port.sent == 4
