"""SDO transfers: every kind, every way to fail, put in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import LinkError, LinkTimeout, TransferAborted
from autotune_drivers.canopen import sdo as sdo_module
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.wire import Wire
from tests.drivers import bus
from tests.drivers.fake_node import FakeNode
from tests.drivers.simulator import Simulator, simulator

SPEED = ObjectRef(0x607F, 0, "u32", "speed limit")
NAME = ObjectRef(0x1008, 0, "u8", "name")


@pytest.fixture
def node() -> FakeNode:
    return FakeNode({(0x607F, 0): b"\x10\0\0\0", (0x1008, 0): b"a drive with a long name"})


@pytest.fixture
def client(node: FakeNode, monkeypatch: pytest.MonkeyPatch) -> Sdo:
    monkeypatch.setattr(sdo_module, "TIMEOUT", 0.02)
    return Sdo(Wire(node, 127, 0.05), 5)


def test_expedited(client: Sdo, node: FakeNode) -> None:
    assert client.read(SPEED) == 16
    client.write(SPEED, 70000)
    assert node.writes == [(0x607F, 0, (70000).to_bytes(4, "little"))]


def test_segmented(client: Sdo, node: FakeNode) -> None:
    assert client.read_bytes(NAME) == b"a drive with a long name"
    client.write(ObjectRef(0x1008, 0, "f64"), 1.5)
    assert client.read(ObjectRef(0x1008, 0, "f64")) == 1.5


def test_block_upload_falls_back_to_segments(client: Sdo) -> None:
    assert client.read_block(NAME) == b"a drive with a long name"


@given(st.binary(min_size=1, max_size=100))
def test_any_content_arrives_whole(content: bytes) -> None:
    node = FakeNode({(0x1008, 0): content})
    assert Sdo(Wire(node, 127, 0.05), 5).read_bytes(NAME) == content


def test_a_lost_request_is_repeated(client: Sdo, node: FakeNode) -> None:
    node.swallow = 2  # the request and its abort
    assert client.read(SPEED) == 16


def test_silence_is_a_time_out_in_words(client: Sdo, node: FakeNode) -> None:
    node.swallow = 1000
    with pytest.raises(LinkTimeout, match=r"read speed limit \(607Fh:00\).*3 times. Check power"):
        client.read(SPEED)


def test_a_drive_that_answers_at_once_is_asked_again_soon(
    node: FakeNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sdo_module, "TIMEOUT", 100.0)
    monkeypatch.setattr(sdo_module, "_QUICK", 0.001)
    client = Sdo(Wire(node, 127, 0.05), 5)
    for _ in range(20):
        client.read(SPEED)
    asked: list[float] = []
    wait = client._channel._wire.wait

    def noting(seconds: float, until: Callable[[], bool]) -> bool:
        asked.append(seconds)
        return wait(seconds, until) if seconds < 10.0 else False

    monkeypatch.setattr(client._channel._wire, "wait", noting)
    node.swallow = 1000
    with pytest.raises(LinkTimeout, match="within 100 s, 3 times"):
        client.read(SPEED)
    assert len(asked) == 3
    assert asked[0] == asked[1] < 1.0
    assert asked[2] == 100.0
    asked.clear()
    with pytest.raises(LinkTimeout, match="within 200 s, 3 times"):
        client.write(SPEED, 1, timeout=200.0)
    assert asked == [200.0] * 3


def test_a_late_answer_is_not_taken_for_the_next_one(client: Sdo, node: FakeNode) -> None:
    node.reply((0x585, b"\x43\x00\x10\x00\x92\x01\x02\x00"))
    assert client.read(SPEED) == 16


def test_an_answer_for_another_object_is_not_believed(client: Sdo, node: FakeNode) -> None:
    node.swallow = 1000
    wire = Wire(node, 127, 0.05)
    other = Sdo(wire, 5)
    node.inbox.clear()

    def interloper(*frames: tuple[int, bytes]) -> None:
        node.reply((0x585, b"\x43\x00\x10\x00\x92\x01\x02\x00"))

    node.send = interloper  # type: ignore[method-assign]
    with pytest.raises(LinkTimeout, match="another SDO client"):
        other.read(SPEED)


def test_a_write_that_arrives_at_another_object_is_repeated_and_told(client: Sdo, node: FakeNode) -> None:
    node.objects[0x6073, 0] = b"\x05\0\0\0"
    whole = node._answer

    def changed_once(request: bytes) -> bytes | None:
        node._answer = whole  # type: ignore[method-assign]
        return whole(request[:1] + b"\x73\x60" + request[3:])

    node._answer = changed_once  # type: ignore[method-assign]
    client.write(SPEED, 20)
    assert node.objects[0x607F, 0] == b"\x14\0\0\0"
    (said,) = client.strays()
    assert said.startswith("object 6073h:00 may have been written")


def test_a_confirmation_that_comes_twice_is_not_the_next_one(client: Sdo, node: FakeNode) -> None:
    node.objects[0x6073, 0] = b"\x05\0\0\0"
    client.write(SPEED, 20)
    whole = node._answer

    def after_an_old_one(request: bytes) -> bytes | None:
        node.reply((0x585, b"\x60\x7f\x60\0\0\0\0\0"))
        return whole(request)

    node._answer = after_an_old_one  # type: ignore[method-assign]
    client.write(ObjectRef(0x6073, 0, "u32"), 6)
    assert node.objects[0x6073, 0] == b"\x06\0\0\0"
    assert client.strays() == []


def test_an_answer_that_is_too_short_is_asked_for_again(client: Sdo, node: FakeNode) -> None:
    whole, asked = node.objects[0x607F, 0], node._answer

    def short_once(request: bytes) -> bytes | None:
        node.objects[0x607F, 0] = whole[:2] if node.objects[0x607F, 0] == whole else whole
        return asked(request)

    node._answer = short_once  # type: ignore[method-assign]
    assert client.read(SPEED) == 16


def test_an_object_that_is_always_too_short_is_told(client: Sdo, node: FakeNode) -> None:
    node.objects[0x607F, 0] = b"\x10\x00"
    with pytest.raises(LinkError, match="came with 2 bytes, its type u32 has 4"):
        client.read(SPEED)


def test_an_abort_names_object_code_reason_and_remedy(client: Sdo, node: FakeNode) -> None:
    node.refuse[0x607F, 0, "write"] = 0x06090031
    with pytest.raises(TransferAborted) as caught:
        client.write(SPEED, 1)
    assert caught.value.code == 0x06090031
    for words in ("write speed limit (607Fh:00)", "too high", "06090031h", "smaller value"):
        assert words in str(caught.value)


def test_an_abort_is_not_repeated(client: Sdo, node: FakeNode) -> None:
    node.refuse[0x607F, 0, "read"] = 0x08000000
    with pytest.raises(TransferAborted):
        client.read(SPEED)
    assert sum(identifier == 0x605 for identifier, _ in node.sent) == 1


def test_a_transfer_inside_a_frame_handler_is_refused(node: FakeNode) -> None:
    wire = Wire(node, 127, 0.05)
    client = Sdo(wire, 5)
    caught: list[LinkError] = []

    def handler(data: bytes) -> None:
        try:
            client.read(SPEED)
        except LinkError as error:
            caught.append(error)

    wire.on(0x185, handler)
    node.reply((0x185, b""))
    assert client.read(SPEED) == 16
    assert "inside another transfer" in str(caught[0])


def test_too_few_bytes_are_said(client: Sdo, node: FakeNode) -> None:
    node.objects[0x607F, 0] = b"\1\2"
    with pytest.raises(LinkError, match="profile does not fit"):
        client.read(SPEED)


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Simulator]:
    with simulator(tmp_path) as process:
        yield process


def test_block_upload_from_the_simulated_drive(running: Simulator) -> None:
    """What block upload fetches is what segments fetch, byte for byte."""
    with bus.sdo(running.port) as client:
        client.write(ObjectRef(0x2400, 4, "u32"), 500)
        client.write(ObjectRef(0x2400, 1, "u8"), 1)
        done = ObjectRef(0x2400, 9, "u32")
        for _ in range(400):
            if client.read(done) == 500:
                break
            client._channel._wire.wait(0.05, lambda: False)
        data = ObjectRef(0x2402, 0, "u8", "recorder data")
        block = client.read_block(data)
        assert len(block) == 500 * int(client.read(ObjectRef(0x2400, 11, "u16")))
        assert client.read_bytes(data) == block
