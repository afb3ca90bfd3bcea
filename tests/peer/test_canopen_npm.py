"""An independent implementation of CANopen agrees with ours, in both roles."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Iterator

import pytest

from autotune.core.errors import TransferAborted
from autotune_drivers.canopen.exchange import Exchange
from autotune_drivers.canopen.node import OPERATIONAL, PRE_OPERATIONAL, Node
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.wire import Wire
from autotune_drivers.profile import read_profile
from tests.node.support import NODE, Bench
from tests.peer.peer import Peer


@pytest.fixture
def slave() -> Iterator[Peer]:
    peer = Peer("slave", str(NODE))
    try:
        peer.wait_for_words()
        yield peer
    finally:
        peer.close()


def ref(text: str) -> ObjectRef:
    return ObjectRef.parse(text)


def test_our_sdo_client_and_its_server(slave: Peer) -> None:
    sdo = Sdo(Wire(slave, 127, 0.025), NODE)
    assert sdo.read(ref("2000:00 u32")) == 0x12345678
    assert sdo.read(ref("2001:00 f32")) == 1.5
    assert sdo.read(ref("2002:00 i16")) == -7
    assert sdo.read_bytes(ref("2003:00 u8")).rstrip(b"\0") == b"a text that needs several segments"
    sdo.write(ref("2001:00 f32"), 0.25)
    sdo.write(ref("2002:00 i16"), -300)
    assert (sdo.read(ref("2001:00 f32")), sdo.read(ref("2002:00 i16"))) == (0.25, -300)
    with pytest.raises(TransferAborted, match="2FFFh"):
        sdo.read(ref("2FFF:00 u32"))


def test_our_block_upload_and_its_server(slave: Peer) -> None:
    assert Sdo(Wire(slave, 127, 0.025), NODE).read_block(ref("2004:00 u8")) == b"\x5a" * 3000


def test_our_cycle_and_its_pdos(slave: Peer) -> None:
    """SYNC by SYNC: what we send in an RPDO comes back in its TPDO of the same SYNC."""
    wire = Wire(slave, 127, 0.025)
    node = Node(wire, NODE)
    node.command(OPERATIONAL)
    exchange = Exchange(node, read_profile("cia402"), 1e-3, lock_step=True)
    exchange.settings(ref("607A:00 i32"))
    exchange.restart()
    for k in range(300):
        assert exchange.cycle((15, 1000 - 7 * k, k - 150)) == 0
        status, position, demand, torque, velocity = exchange.values
        assert (status, position, demand) == (15, 1000 - 7 * k, k - 150)
        assert (torque, velocity) == (-3, 77)


def test_our_view_of_its_heartbeat(slave: Peer) -> None:
    wire = Wire(slave, 127, 0.025)
    node = Node(wire, NODE)
    node.monitor(1.0)
    assert wire.wait(5.0, lambda: node.told)
    node.command(OPERATIONAL)
    assert wire.wait(5.0, lambda: node.nmt_state == OPERATIONAL)
    node.command(PRE_OPERATIONAL)
    assert wire.wait(5.0, lambda: node.nmt_state == PRE_OPERATIONAL)


def served(bench: Bench, tasks: list[dict[str, object]]) -> list[str]:
    """Its SDO client does `tasks` at our simulated drive; what it got."""
    peer = Peer("client", str(NODE), json.dumps(tasks))
    try:
        end = time.monotonic() + 40.0
        while len(peer.answers) < len(tasks):
            assert time.monotonic() < end, peer.answers
            for cob_id, data in peer.receive(0.05):
                bench.send(cob_id, data)
            bench.now += 1e-3
            bench.device.poll(bench.now)
            frames, bench.frames = bench.frames, []
            if frames:
                peer.send(*frames)
    finally:
        peer.close()
    return peer.answers


def test_its_sdo_client_and_our_simulated_drive() -> None:
    half = struct.pack("<f", 0.5).hex()
    bench = Bench()
    answers = served(
        bench,
        [
            {"index": 0x1018, "sub": 1},
            {"index": 0x1008, "sub": 0},
            {"index": 0x2000, "sub": 1, "write": half},
            {"index": 0x2000, "sub": 1},
            {"index": 0x2100, "sub": 7},
            {"index": 0x2FFF, "sub": 0},
            {"index": 0x6041, "sub": 0, "write": "0000"},
        ],
    )
    assert answers[0] == struct.pack("<I", 0x7FFFA701).hex()
    assert bytes.fromhex(answers[1]) == b"autotune-sim"
    assert answers[2:4] == ["done", half]
    assert bench.get(0x2000, 1) == 0.5
    assert struct.unpack("<f", bytes.fromhex(answers[4])) == (0.0,)
    assert answers[5].startswith("error")
    assert answers[6].startswith("error")


def test_its_block_upload_of_our_recorder() -> None:
    """3000 samples of the drive's recorder with CRC, as our own server has them."""
    bench = Bench()
    bench.put(0x2400, 4, 3000)
    bench.put(0x2400, 1, 2)
    for _ in range(3000):
        bench.send(0x080)
    recorded = bench.upload(0x2402)
    assert len(recorded) == 3000 * 16
    answers = served(bench, [{"index": 0x2402, "sub": 0, "block": True}])
    assert bytes.fromhex(answers[0]) == recorded
