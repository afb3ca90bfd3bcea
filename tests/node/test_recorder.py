"""The drive's own data recorder."""

from __future__ import annotations

import itertools
import struct

import pytest

from autotune_sim.aborts import AbortCode
from tests.node.support import Bench, Refused


def channels(bench: Bench, *mappings: int) -> None:
    for number in range(1, 9):
        bench.put(0x2401, number, mappings[number - 1] if number <= len(mappings) else 0)


def rows(bench: Bench, layout: str) -> list[tuple[int, ...]]:
    data = bench.upload(0x2402)
    assert len(data) == bench.get(0x2400, 9) * bench.get(0x2400, 11)
    return list(struct.iter_unpack(layout, data))


def test_records_at_once_every_cycle(bench: Bench) -> None:
    start = bench.enable()
    channels(bench, 0x22100120, 0x60620020, 0x60410010)
    bench.put(0x2400, 4, 50)
    bench.put(0x2400, 1, 2)
    targets = [start + k for k in range(60)]
    for target in targets:
        bench.cycle(15, target)
    assert bench.get(0x2400, 2) == 3
    recorded = rows(bench, "<IiH")
    assert len(recorded) == 50
    assert [demand for _, demand, _ in recorded] == targets[:50]
    assert [cycle - recorded[0][0] for cycle, _, _ in recorded] == list(range(50))
    assert recorded[0][0] == bench.get(0x2400, 10)


def test_divider(bench: Bench) -> None:
    channels(bench, 0x22100120)
    bench.put(0x2400, 3, 4)
    bench.put(0x2400, 4, 10)
    bench.put(0x2400, 1, 2)
    for _ in range(50):
        bench.send(0x080)
    recorded = [cycle for (cycle,) in rows(bench, "<I")]
    assert [later - earlier for earlier, later in itertools.pairwise(recorded)] == [4] * 9


@pytest.mark.parametrize(("edge", "level"), [(1, 20), (2, -20)])
def test_trigger_with_samples_before_it(bench: Bench, edge: int, level: int) -> None:
    start = bench.enable()
    channels(bench, 0x60620020, 0x22100120)
    for subindex, value in ((4, 30), (5, 10), (6, 0x60620020), (7, start + level), (8, edge)):
        bench.put(0x2400, subindex, value)
    bench.put(0x2400, 1, 1)
    direction = 1 if edge == 1 else -1
    assert bench.get(0x2400, 2) == 1
    for k in range(60):
        bench.cycle(15, start + direction * k)
    recorded = rows(bench, "<iI")
    assert [demand - start for demand, _ in recorded] == [direction * k for k in range(10, 40)]
    assert bench.get(0x2400, 10) == recorded[0][1]


def test_settings_are_fixed_while_it_runs(bench: Bench) -> None:
    bench.put(0x2400, 1, 2)
    with pytest.raises(Refused) as refused:
        bench.put(0x2400, 3, 2)
    assert refused.value.code == AbortCode.STATE
    bench.put(0x2400, 1, 0)
    bench.put(0x2400, 3, 2)


def test_nothing_to_record_and_nothing_recorded(bench: Bench) -> None:
    assert bench.upload(0x2402) == b""
    channels(bench)
    with pytest.raises(Refused) as refused:
        bench.put(0x2400, 1, 2)
    assert refused.value.code == AbortCode.PARAMETERS
    channels(bench, 0x20000120)
    with pytest.raises(Refused) as refused:
        bench.put(0x2400, 1, 2)
    assert refused.value.code == AbortCode.NOT_MAPPABLE
