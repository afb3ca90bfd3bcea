"""The power state machine: its table, and the drive going through it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune_sim.aborts import AbortCode
from autotune_sim.state_machine import POWERED, TRANSITIONS, State, Word, command, fault_reset
from tests.node.support import CST, CSV, Bench, Refused


@pytest.mark.parametrize(
    ("controlword", "word"),
    [
        (0x0000, Word.DISABLE_VOLTAGE),
        (0x0002, Word.QUICK_STOP),
        (0x000B, Word.QUICK_STOP),
        (0x0006, Word.SHUTDOWN),
        (0x0007, Word.SWITCH_ON),
        (0x000F, Word.ENABLE_OPERATION),
        (0x010F, Word.ENABLE_OPERATION),
        (0x000D, Word.DISABLE_VOLTAGE),
    ],
)
def test_commands(controlword: int, word: Word) -> None:
    assert command(controlword) is word


def test_voltage_off_is_possible_everywhere_outside_faults() -> None:
    for state in (
        State.READY_TO_SWITCH_ON,
        State.SWITCHED_ON,
        State.OPERATION_ENABLED,
        State.QUICK_STOP_ACTIVE,
    ):
        assert TRANSITIONS[state, Word.DISABLE_VOLTAGE] is State.SWITCH_ON_DISABLED


def test_power_only_from_ready_on() -> None:
    sources = {source for (source, _), target in TRANSITIONS.items() if target in POWERED}
    assert State.SWITCH_ON_DISABLED not in sources
    assert State.FAULT not in sources


def test_fault_reset_needs_the_edge() -> None:
    assert fault_reset(0x00, 0x80)
    assert not fault_reset(0x80, 0x80)
    assert not fault_reset(0x80, 0x00)


def test_up_and_down(bench: Bench) -> None:
    position = bench.enable()
    assert bench.device.firmware.servo.powered
    for controlword, wanted in ((7, 0x23), (6, 0x21), (0, 0x40)):
        for _ in range(100):
            word, position, _ = bench.cycle(controlword, position)
        assert word & 0x6F == wanted
        assert not bench.device.firmware.servo.powered


def test_up_by_sdo_alone(bench: Bench) -> None:
    for controlword, word in ((6, 0x21), (7, 0x23), (15, 0x27), (0, 0x40)):
        bench.put(0x6040, 0, controlword)
        assert bench.word == word
        assert bench.get(0x6041) == bench.device.firmware.statusword()


def test_without_a_mode_there_is_no_power(bench: Bench) -> None:
    bench.put(0x6060, 0, 0)
    for controlword in (6, 7, 15):
        bench.put(0x6040, 0, controlword)
    assert bench.word == 0x23


@pytest.mark.parametrize("mode", [CSV, CST])
def test_other_modes(bench: Bench, mode: int) -> None:
    bench.enable(mode)
    assert bench.get(0x6061) == mode
    assert int(bench.get(0x6502)) == 0x380


def test_mode_cannot_be_taken_away_under_power(bench: Bench) -> None:
    bench.enable()
    with pytest.raises(Refused) as refused:
        bench.put(0x6060, 0, 0)
    assert refused.value.code == AbortCode.STATE


@given(st.lists(st.integers(0, 0xFFFF), max_size=20))
def test_power_is_on_in_powered_states_only(words: list[int]) -> None:
    bench = BENCH
    for word in words:
        bench.put(0x6040, 0, word)
        bench.wait(0.03, 0.01)
        firmware = bench.device.firmware
        assert firmware.servo.powered == (firmware.state in POWERED)
        if command(word) is not Word.ENABLE_OPERATION:
            bench.wait(0.1, 0.05)
            assert firmware.state is not State.OPERATION_ENABLED


BENCH = Bench()
