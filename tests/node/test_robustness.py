"""Whatever is on the bus, the drive stays a drive."""

from __future__ import annotations

import struct

from hypothesis import given
from hypothesis import strategies as st

from autotune_sim.faults import Faults, parse_order
from autotune_sim.state_machine import POWERED
from tests.node.support import Bench

IDENTIFIERS = st.sampled_from([0x000, 0x080, 0x205, 0x305, 0x405, 0x505, 0x605, 0x77F, 0x181, 0x7FF])
FRAMES = st.lists(st.tuples(IDENTIFIERS, st.binary(max_size=8)), max_size=40)


class NoCable:
    def plug(self) -> None:
        """Nothing to do."""

    def unplug(self) -> None:
        """Nothing to do."""


@given(FRAMES)
def test_any_frames(frames: list[tuple[int, bytes]]) -> None:
    for cob_id, data in frames:
        BENCH.send(cob_id, data)
        BENCH.wait(0.001)
    firmware = BENCH.device.firmware
    assert firmware.servo.powered == (firmware.state in POWERED)
    BENCH.nmt(129)
    BENCH.frames.clear()
    BENCH.wait(0.4, 0.1)
    assert BENCH.get(0x1000) == 0x20192
    assert BENCH.word == 0x40


def test_lost_frames(bench: Bench) -> None:
    faults = Faults(bench.device, NoCable(), lambda: bench.now, bench.log.append)
    bench.prepare()
    faults.add(parse_order("frames-lost=20"))
    answers = 0
    for _ in range(1000):
        bench.send(0x080)
        answers += len(bench.take(0x185))
    assert 560 < answers < 720  # 0.8 × 0.8, five standard deviations
    faults.add(parse_order("clear"))
    bench.cycle(0)


def test_lost_heartbeat_is_told_whatever_the_reaction(bench: Bench) -> None:
    bench.put(0x6007, 0, 3)
    bench.put(0x1016, 1, 127 << 16 | 100)
    bench.send(0x77F, b"\x05")
    bench.wait(0.15)
    assert struct.unpack_from("<H", bench.take(0x085)[0])[0] == 0x8130
    assert bench.word == 0x40


BENCH = Bench()
