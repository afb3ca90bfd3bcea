"""A sample of the fault campaign, and that a case is the same case every time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import pytest

from autotune_sim.faults import parse_order
from autotune_sim.inprocess import open_sim
from bench.faults.__main__ import main
from bench.faults.cases import CUT_SHORT, DURATIONS, KINDS, NAMED, draw
from bench.faults.mixed import MOTIONS, draw_link, held_out
from bench.faults.pool import Result
from bench.faults.proxy import Operation, Proxy
from bench.faults.table import read_results, table

ROOT = Path(__file__).resolve().parents[2]


def campaign(*options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "bench.faults", *options]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=250, check=False)


def test_a_seed_is_a_case() -> None:
    assert [draw(seed) for seed in range(200)] == [draw(seed) for seed in range(200)]
    assert {draw(seed).kind for seed in range(400)} == set(KINDS)
    assert {draw(seed, "wire").kind for seed in range(5)} == {"wire"}


def test_a_bad_wire_may_be_bad_while_everything_is_put_back() -> None:
    new = [draw(seed, "wire") for seed in range(CUT_SHORT, CUT_SHORT + 100)]
    both = [case for case in new if case.proxy and case.host]
    assert both
    assert all(f"process:int-owner@{case.host[2]:g}" in case.text() for case in both if case.host)
    reported = [draw(seed, "wire") for seed in range(1000, 1100)]
    assert not any(case.proxy and case.host for case in reported)


@pytest.mark.parametrize("kind", KINDS)
def test_every_case_can_be_told_to_the_drive(kind: str) -> None:
    """What is drawn is understood by whoever has to do it."""
    for seed in range(300):
        case = draw(seed, kind)
        assert case.programme in DURATIONS
        for order in case.orders:
            if kind in ("wire", "line"):
                parse_order(order)
            else:
                open_sim(f"sim://edm-vertical?fault={order}")
        for operation in case.proxy:
            assert 0.0 < Operation.parse(operation).share <= 1.0
        assert str(case.programme) in case.text()


@pytest.mark.slow(8)
def test_a_sample_of_the_campaign_is_sound() -> None:
    """Plant, drive, disk and signals: what the whole campaign (`make faults`) does two thousand times."""
    named = {seed: draw(seed) for seed in NAMED}
    brief = (seed for seed, case in named.items() if case.kind == "plant" and DURATIONS[case.programme] < 60)
    seeds = (*SAMPLE, *brief)
    done = campaign("--case", *map(str, seeds))
    lines = [line for line in done.stdout.splitlines() if " -> " in line]
    assert len(lines) == len(seeds), done.stdout + done.stderr
    assert done.returncode == 0, done.stdout
    assert all(line.endswith(": sound") for line in lines)


SAMPLE = (1001, 1003, 1007, 1008, 1009, 1010, 1015, 1018, 1034, 1035, 1036)


@pytest.mark.slow(6)
def test_behind_a_wire(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A proxy between two pseudo-terminals, processes of their own, and a table of the results."""
    out = tmp_path / "results.jsonl"
    done = campaign("--case", *map(str, WIRE), "--kind", "wire", "--out", str(out))
    assert done.returncode == 0, done.stdout + done.stderr
    results = read_results(out)
    assert [result.seed for result in results] == list(WIRE)
    assert [result.findings for result in results] == [(), ()]
    assert "| wire | 2 |" in table(results)  # a host that is held up may end before its fault has come
    assert main(["--case", *map(str, WIRE), "--kind", "wire", "--out", str(out)]) == 0
    assert " -> " not in capsys.readouterr().out  # what was played is not played again


WIRE = (1014, 1020)


def test_a_table_names_what_was_found(tmp_path: Path) -> None:
    one = Result(
        7, "plant", "check encoder-frozen@1", "encoder-frozen", "done", 0, 1.0, 0.5, 0.1, 0.2, ("speed: 31",)
    )
    path = tmp_path / "out.jsonl"
    path.write_text(json.dumps(asdict(one)) + "\n{cut off")
    (read,) = read_results(path)
    assert read == one
    assert "| speed | 1 | encoder-frozen 1 | 7: speed: 31 |" in table([read])


def test_held_out_motions_see_what_feedforward_gains_and_what_it_spoils() -> None:
    link, unfit = draw_link(1000, "")
    assert unfit == ""
    assert link == draw_link(1000, "")[0]
    plain = held_out(open_sim("sim://edm-vertical"))
    assert set(plain) == {f"{name} {side}" for name in MOTIONS for side in ("motor", "load")}
    drive = open_sim("sim://edm-vertical")
    drive.write_parameters(GOOD)
    assert held_out(drive)["waves motor"] < 0.8 * plain["waves motor"]
    drive.write_parameters({"feedforward.coulomb": 1.0, "feedforward.break_away": 1.0})
    assert held_out(drive)["waves motor"] > 1.2 * plain["waves motor"]


GOOD = {
    "feedforward.enabled": 1.0,
    "feedforward.inertia": 6.66e-4,
    "feedforward.viscous": 4.13e-3,
    "feedforward.coulomb": 0.3,
    "feedforward.break_away": 0.3,
    "feedforward.stiffness": 34.0,
    "feedforward.offset": 0.048,
}
"""Of the nominal axis (thesis, Table 6.3)."""


def test_a_fault_of_the_wire_ends_by_the_clock_where_the_host_sends_no_sync(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    master, slave = os.openpty()
    operation = Operation.parse("lose=1:2@0.002")
    proxy = Proxy(tmp_path / "host", Path(os.ttyname(slave)), "wire", operation, 1, tmp_path / "note")
    now = [50.0]
    monkeypatch.setattr("bench.faults.proxy.time", SimpleNamespace(monotonic=lambda: now[0]))
    assert proxy._handle(b"t0800\r", True) == b"t0800\r"
    assert proxy._handle(b"t0800\r", True) == b""
    now[0] += 1.9
    assert proxy._handle(b"z\r", False) == b""
    now[0] += 0.2
    assert proxy._handle(b"z\r", False) == b"z\r"
    os.close(master)
    os.close(slave)
