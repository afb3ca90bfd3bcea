"""The main job over a moteus line: kept, rolled back, killed, and put right by the next run."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from autotune.recordings.files import read_recording
from autotune.tuning.journal import Journal
from tests.end_to_end.support import Bench, kill_hard, read_drive
from tests.support.commands import called

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical-moteus.toml"
WITHIN_SECONDS = 0.2
PATIENCE = 600.0  # s for a run; 60 on a quiet machine


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """The axis behind a moteus line, under the name that the bench's run folders have."""
    axis = tmp_path / "edm-vertical.toml"
    axis.write_text(EXAMPLE.read_text().replace('"edm-vertical-moteus"', '"edm-vertical"'))
    made = Bench(tmp_path, axis)
    try:
        yield made
    finally:
        made.stop()


def stage_of(bench: Bench) -> str:
    try:
        return Journal.load(bench.newest()).state.stage
    except (ValueError, OSError):
        return ""


def stops_after(bench: Bench, when: float) -> list[float]:
    """Times at which the drive began to stop: told by the cyclic process that is left, or by its watchdog."""
    stop = re.compile(r"^([\d.]+) (?:quick stop begun|state OPERATION_ENABLED ->)", re.MULTILINE)
    return [time for match in stop.finditer(bench.log.read_text()) if (time := float(match[1])) > when]


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_run_over_the_line_is_kept_and_can_be_rolled_back(bench: Bench) -> None:
    bench.start("--link", "moteus")
    before = read_drive(bench)
    done = bench.call(*bench.whole_run(), timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["outcome"] == "kept"
    assert 1.7e-3 <= result["before"]["peak_error"] <= 2.2e-3
    assert 2.5 < result["before"]["peak_error"] / result["after"]["peak_error"] < 50.0
    assert result["committed"]["peak_error"] <= 0.7e-3
    proof = read_recording(bench.newest() / "recordings" / "proof.parquet")
    assert {"before", "after"} <= set(proof.experiment)
    assert bench.last_state() == "SWITCH_ON_DISABLED"
    kept = read_drive(bench)
    assert kept["feedforward.enabled"] == 1.0
    limits = {name: value for name, value in before.items() if name.startswith("limit.")}
    assert {name: kept[name] for name in limits} == pytest.approx(limits)
    back = called("rollback", str(bench.axis), "--runs", str(bench.runs))
    assert back.returncode == 0, back.stderr
    assert read_drive(bench) == pytest.approx(before)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("stage", ["experiment", "commit"])
def test_a_killed_run_is_stopped_by_the_watchdog_and_put_right_by_the_next(bench: Bench, stage: str) -> None:
    bench.start()
    before = read_drive(bench)
    process = bench.popen()
    try:
        bench.wait_for(
            lambda: stage_of(bench) == stage and bench.last_state() == "OPERATION_ENABLED", PATIENCE
        )
    finally:
        killed = kill_hard(process)
        for stream in (process.stdout, process.stderr):
            if stream is not None:
                stream.close()
    bench.wait_for(lambda: stops_after(bench, killed) != [], 10.0)
    assert stops_after(bench, killed)[0] - killed < WITHIN_SECONDS
    done = bench.run("--only", "check")
    assert done.returncode == 0, done.stderr
    assert stage in " ".join(json.loads(done.stdout)["notes"])
    assert read_drive(bench) == pytest.approx(before)


def test_a_wrong_id_and_a_wrong_kind_of_link_are_said(bench: Bench) -> None:
    wrong = called("sim", str(bench.axis), "--link", "canopen")
    assert wrong.returncode == 2
    assert "moteus+serial" in wrong.stderr
    unknown = called("sim", str(bench.axis), "--link", "profibus")
    assert unknown.returncode == 2
    assert "canopen and moteus" in unknown.stderr
    bench.start()
    bench.change("id=1", "id=9")
    done = bench.run()
    assert done.returncode == 5
    assert "id=1" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("?id=1", "", "id"),
        ("?id=1", "?id=1&baud=1", "9600"),
        ("?id=1", "?id=1&bauds=9600", "did you mean 'baud'"),
        ('"autotune-sim-moteus"', '"autotune-sim"', "CANopen drives"),
        ("moteus+serial:", "moteus+serail:", r"moteus\+serial"),
    ],
)
def test_a_mistyped_axis_file_is_named_with_the_nearest_right_key(
    bench: Bench, old: str, new: str, message: str
) -> None:
    bench.change(old, new)
    done = bench.run()
    assert done.returncode == 2
    assert re.search(message, done.stderr), done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("drive-fault@12", "motor driver"),
        pytest.param("blocked@12", "blocked|follow", marks=pytest.mark.long),
        pytest.param("hot@12", "(?i)temperature", marks=pytest.mark.long),
    ],
)
@pytest.mark.long
def test_a_failure_in_the_middle_ends_at_rest_with_everything_kept(
    bench: Bench, fault: str, message: str
) -> None:
    bench.start("--fault", fault)
    before = read_drive(bench)
    done = bench.run()
    assert done.returncode in (4, 5), done.stderr
    assert re.search(message, done.stderr), done.stderr
    assert "Traceback" not in done.stderr
    assert bench.last_state() in ("SWITCH_ON_DISABLED", "FAULT")
    after = read_drive(bench)
    assert after == pytest.approx(before)
    assert (bench.newest() / "recordings" / "experiment.parquet").stat().st_size > 10_000
