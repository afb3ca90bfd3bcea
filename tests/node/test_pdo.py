"""PDO parameters: the order that drives demand, and when PDOs go."""

from __future__ import annotations

import struct

import pytest

from autotune_sim.aborts import AbortCode
from tests.node.support import Bench, Refused


def refusal(bench: Bench, index: int, subindex: int, value: int) -> int:
    with pytest.raises(Refused) as refused:
        bench.put(index, subindex, value)
    return refused.value.code


def test_the_right_order_is_accepted(bench: Bench) -> None:
    bench.map(0x1800, 0x185, [0x60640020, 0x60410010])
    assert bench.get(0x1A00, 0) == 2
    assert bench.get(0x1800, 1) == 0x185


def test_a_valid_pdo_cannot_be_mapped_anew(bench: Bench) -> None:
    assert refusal(bench, 0x1600, 0, 0) == AbortCode.STATE
    assert refusal(bench, 0x1600, 1, 0x60600008) == AbortCode.STATE
    assert refusal(bench, 0x1400, 1, 0x206) == AbortCode.STATE
    assert refusal(bench, 0x1800, 3, 5) == AbortCode.STATE


def test_entries_only_while_their_number_is_zero(bench: Bench) -> None:
    bench.put(0x1400, 1, 0x80000205)
    assert refusal(bench, 0x1600, 1, 0x60600008) == AbortCode.ACCESS
    bench.put(0x1600, 0, 0)
    bench.put(0x1600, 1, 0x60600008)


@pytest.mark.parametrize(
    ("parameter", "mapping", "code"),
    [
        (0x1600, 0x60410010, AbortCode.NOT_MAPPABLE),  # status word from the master
        (0x1600, 0x60400008, AbortCode.NOT_MAPPABLE),  # wrong length
        (0x1600, 0x20000120, AbortCode.NOT_MAPPABLE),  # a gain
        (0x1600, 0x5FFF0010, AbortCode.NO_OBJECT),
        (0x1A00, 0x10180120, AbortCode.NOT_MAPPABLE),
    ],
)
def test_what_cannot_be_mapped(bench: Bench, parameter: int, mapping: int, code: int) -> None:
    bench.put(parameter - 0x200, 1, 0x80000000 | (0x205 if parameter < 0x1A00 else 0x185))
    bench.put(parameter, 0, 0)
    assert refusal(bench, parameter, 1, mapping) == code


def test_more_than_eight_bytes(bench: Bench) -> None:
    bench.put(0x1800, 1, 0x80000185)
    bench.put(0x1A00, 0, 0)
    for number in (1, 2, 3):
        bench.put(0x1A00, number, 0x60640020)
    assert refusal(bench, 0x1A00, 0, 3) == AbortCode.PDO_LENGTH
    bench.put(0x1A00, 0, 2)


@pytest.mark.parametrize("identifier", [0x000, 0x07F, 0x101, 0x601, 0x705])
def test_reserved_identifiers(bench: Bench, identifier: int) -> None:
    bench.put(0x1800, 1, 0x80000185)
    assert refusal(bench, 0x1800, 1, identifier) == AbortCode.RANGE


@pytest.mark.parametrize("kind", [241, 252, 253])
def test_reserved_transmission_types(bench: Bench, kind: int) -> None:
    assert refusal(bench, 0x1800, 2, kind) == AbortCode.RANGE


def test_synchronous_process_data_wait_for_sync(bench: Bench) -> None:
    bench.prepare()
    bench.send(0x205, struct.pack("<Hi", 6, 0))
    assert bench.word == 0x40
    bench.send(0x080)
    assert bench.word == 0x21


def test_asynchronous_process_data_act_at_once(bench: Bench) -> None:
    bench.nmt(1)
    bench.send(0x205, struct.pack("<H", 6))
    assert bench.word == 0x21


def test_no_process_data_outside_operational(bench: Bench) -> None:
    bench.send(0x205, struct.pack("<H", 6))
    assert bench.word == 0x40
    bench.map(0x1800, 0x185, [0x60410010])
    bench.send(0x080)
    assert bench.take(0x185) == []


def test_every_third_sync(bench: Bench) -> None:
    bench.map(0x1800, 0x185, [0x60410010], kind=3)
    bench.nmt(1)
    counts = []
    for _ in range(9):
        bench.send(0x080)
        counts.append(len(bench.take(0x185)))
    assert counts == [0, 0, 1] * 3


def test_sync_start_value(bench: Bench) -> None:
    bench.put(0x1019, 0, 10)
    bench.put(0x1800, 1, 0x80000185)
    bench.put(0x1800, 6, 4)
    bench.map(0x1800, 0x185, [0x60410010], kind=2)
    bench.nmt(1)
    sent = []
    for counter in range(1, 11):
        bench.send(0x080, bytes((counter,)))
        sent.append(len(bench.take(0x185)))
    assert sent == [0, 0, 0, 0, 1, 0, 1, 0, 1, 0]


def test_event_driven_on_change_with_inhibit_time_and_event_timer(bench: Bench) -> None:
    bench.put(0x1800, 1, 0xC0000185)
    bench.put(0x1800, 3, 100)  # 10 ms
    bench.put(0x1800, 5, 50)  # ms
    bench.put(0x1800, 1, 0x40000185)
    bench.nmt(1)
    bench.wait(0.002)
    assert bench.take(0x185) == [struct.pack("<H", 0x250)]
    bench.put(0x6040, 0, 6)
    bench.wait(0.005)
    assert bench.take(0x185) == []
    bench.wait(0.006)
    assert bench.take(0x185) == [struct.pack("<H", 0x231)]
    bench.wait(0.2)
    assert 3 <= len(bench.take(0x185)) <= 4


def test_too_short_a_frame_is_told_once(bench: Bench) -> None:
    bench.prepare()
    for _ in range(3):
        bench.send(0x205, b"\x06\x00")
    bench.wait(0.003)
    emergencies = bench.take(0x085)
    assert len(emergencies) == 1
    assert emergencies[0][:2] == bytes.fromhex("1082")
    assert bench.word == 0x40


def test_values_out_of_range_are_left_alone(bench: Bench) -> None:
    bench.map(0x1400, 0x205, [0x60600008], kind=255)
    bench.nmt(1)
    bench.send(0x205, b"\x07")
    assert bench.get(0x6061) == 8


def test_sync_counter_and_gaps(bench: Bench) -> None:
    bench.put(0x1019, 0, 100)
    for counter in (1, 2, 3, 6, 7, 100, 1):
        bench.send(0x080, bytes((counter,)))
    assert bench.get(0x2210, 3) == 7
    assert bench.get(0x2210, 5) == 2 + 92
    bench.send(0x080)
    bench.wait(0.002)
    assert bench.take(0x085)[0][:2] == bytes.fromhex("4082")
    assert bench.get(0x2210, 3) == 7
    bench.put(0x1006, 0, 1000)
    assert refusal(bench, 0x1019, 0, 0) == AbortCode.STATE
