"""What survives power-off, and what does not."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from autotune_sim.aborts import AbortCode
from autotune_sim.memory import Memory
from tests.node.support import Bench, Refused

SAVE, LOAD = 0x65766173, 0x64616F6C
MakeBench = Callable[..., Bench]


def store(bench: Bench, subindex: int = 1, index: int = 0x1010, signature: int = SAVE) -> None:
    bench.take(0x585)
    bench.send(0x605, struct.pack("<BHBI", 0x23, index, subindex, signature))
    assert bench.take(0x585) == []  # the answer comes when it is done
    bench.wait(0.31)
    (answer,) = bench.take(0x585)
    assert answer[0] == 0x60


def test_stored_values_survive_a_power_loss(bench: Bench) -> None:
    bench.put(0x2100, 7, 31.5)
    bench.put(0x6065, 0, 1000)
    store(bench)
    bench.put(0x2100, 7, 99.0)
    bench.device.power_loss()
    bench.wait(0.5)
    assert bench.get(0x2100, 7) == 31.5
    assert bench.get(0x6065) == 1000
    assert bench.device.firmware.servo.parameters["feedforward.stiffness"] == 31.5


def test_volatile_values_do_not(bench: Bench) -> None:
    bench.put(0x2100, 7, 31.5)
    bench.put(0x607A, 0, 5)
    bench.device.power_loss()
    bench.take(0x705)
    bench.wait(0.5)
    assert bench.take(0x705) == [b"\0"]
    assert bench.get(0x2100, 7) == 0.0
    assert bench.get(0x607A) == 0


def test_a_restarted_process_finds_them(make_bench: MakeBench, tmp_path: Path) -> None:
    first = make_bench(Memory(tmp_path / "state.json", print))
    first.put(0x2000, 1, 45.0)
    first.map(0x1800, 0x185, [0x60640020], kind=1)
    store(first)
    second = make_bench(Memory(tmp_path / "state.json", print))
    assert second.get(0x2000, 1) == 45.0
    assert second.get(0x1A00, 1) == 0x60640020
    second.nmt(1)
    second.send(0x080)
    assert len(second.take(0x185)) == 1


def test_areas_are_stored_by_themselves(bench: Bench) -> None:
    bench.put(0x2000, 1, 45.0)
    bench.put(0x6065, 0, 1000)
    store(bench, 4)
    bench.device.power_loss()
    bench.wait(0.5)
    assert bench.get(0x2000, 1) == 45.0
    assert bench.get(0x6065) == 2387


def test_defaults_come_back_after_a_reset(bench: Bench) -> None:
    bench.put(0x2000, 1, 45.0)
    store(bench)
    store(bench, 1, 0x1011, LOAD)
    assert bench.get(0x2000, 1) == 45.0
    bench.nmt(129)
    assert bench.get(0x2000, 1) == 60.0


def test_power_lost_in_the_middle_of_storing(bench: Bench) -> None:
    bench.put(0x2100, 7, 31.5)
    store(bench)
    bench.put(0x2100, 7, 50.0)
    bench.send(0x605, struct.pack("<BHBI", 0x23, 0x1010, 1, SAVE))
    bench.wait(0.1)
    bench.device.power_loss()
    bench.take(0x585)
    bench.wait(0.6)
    assert bench.take(0x585) == []
    assert bench.get(0x2100, 7) == 31.5


def test_no_storing_under_power(bench: Bench) -> None:
    bench.enable()
    with pytest.raises(Refused) as refused:
        bench.put(0x1010, 1, SAVE)
    assert refused.value.code == AbortCode.STATE


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        '{"schema": 9, "axis": "", "parameters": {}}',
        '{"schema": 1, "axis": "other", "parameters": {}}',
        '{"schema": 1, "axis": "", "parameters": {"x": "y"}}',
    ],
)
def test_a_broken_state_file_means_factory_settings(
    make_bench: MakeBench, tmp_path: Path, content: str
) -> None:
    path = tmp_path / "state.json"
    path.write_text(content)
    told: list[str] = []
    bench = make_bench(Memory(path, told.append))
    assert bench.get(0x2000, 1) == 60.0
    assert "cannot be used" in told[0]


@pytest.mark.parametrize(
    ("key", "value"), [("1A00:01", "20FFFFFF"), ("2000:01", "00007fff"), ("2000:01", "00")]
)
def test_values_that_cannot_be_mean_factory_settings(
    make_bench: MakeBench, tmp_path: Path, key: str, value: str
) -> None:
    path = tmp_path / "state.json"
    path.write_text(json.dumps({"schema": 1, "axis": "", "parameters": {key: value, "6065:00": "e8030000"}}))
    bench = make_bench(Memory(path, print))
    assert bench.get(0x2000, 1) == 60.0
    assert bench.get(0x6065) == 2387
    assert any("cannot be used" in line for line in bench.log)


def test_a_memory_that_cannot_be_written_is_told(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(Memory(tmp_path / "missing" / "state.json", print))
    bench.send(0x605, struct.pack("<BHBI", 0x23, 0x1010, 1, SAVE))
    bench.wait(0.31)
    (answer,) = bench.take(0x585)
    assert struct.unpack_from("<I", answer, 4)[0] == AbortCode.HARDWARE


def test_a_lossy_memory_confirms_and_forgets(bench: Bench) -> None:
    bench.memory.lossy = True
    bench.put(0x2100, 7, 31.5)
    store(bench)
    bench.device.power_loss()
    bench.wait(0.5)
    assert bench.get(0x2100, 7) == 0.0
