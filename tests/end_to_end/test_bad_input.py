"""Every wrong input and every failure: a sentence, the right exit code, the axis at rest, nothing lost."""

from __future__ import annotations

import json
import re
import signal

import pytest

from tests.end_to_end.support import AT_REST, Bench, read_drive
from tests.support.commands import called


def limits_of(bench: Bench) -> dict[str, float]:
    return {name: value for name, value in read_drive(bench).items() if not name.startswith("controller.")}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("following_error", "folowing_error", "did you mean 'following_error'"),
        ('profile = "autotune-sim"', 'profile = "autotun-sim"', "autotune-sim"),
        ("canopen+slcan:edm", "canopen+slcn:edm", "canopen\\+slcan"),
        ("node=5", "nod=5", "node"),
        ("node=5", "node=500", "127"),
        ("amplitude = 0.2", "amplitude = -0.2", "benchmark.amplitude"),
    ],
)
def test_a_mistyped_axis_file_is_named_with_the_nearest_right_key(
    bench: Bench, old: str, new: str, message: str
) -> None:
    bench.change(old, new)
    done = bench.run()
    assert done.returncode == 2
    assert re.search(message, done.stderr), done.stderr
    assert "Traceback" not in done.stderr


def test_a_wrong_port_is_said_with_what_to_check(bench: Bench) -> None:
    done = bench.run()
    assert done.returncode == 5
    assert "edm-vertical.tty" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(bench.runs.glob("2*"))


@pytest.mark.parametrize(
    ("fault", "reached", "message"),
    [
        ("silent", False, "node 5"),
        pytest.param("other-identity", False, "(?i)vendor|identity", marks=pytest.mark.long),
        ("drive-fault", True, "2310|over-?current"),
        pytest.param("enable-missing", True, "(?i)enable", marks=pytest.mark.long),
        pytest.param("brake-missing", True, "(?i)brake", marks=pytest.mark.long),
    ],
)
def test_a_drive_that_cannot_work_is_said_before_anything_moves(
    bench: Bench, fault: str, reached: bool, message: str
) -> None:
    bench.start("--fault", fault)
    done = bench.run()
    assert done.returncode == 5, done.stderr
    assert re.search(message, done.stderr), done.stderr
    assert "Traceback" not in done.stderr
    assert bench.last_state() in (AT_REST, "FAULT")
    outcomes = [json.loads(path.read_text())["outcome"] for path in bench.runs.glob("2*/run.json")]
    assert outcomes == (["aborted"] if reached else [])


def test_a_wrong_node_is_said(bench: Bench) -> None:
    bench.start()
    bench.change("node=5", "node=6")
    done = bench.run()
    assert done.returncode == 5
    assert "node 6" in done.stderr


@pytest.mark.parametrize(
    ("old", "new", "limit"),
    [
        ("position_max = 20.0", "position_max = -19.8", "position|travel"),
        ("speed = 20.0", "speed = 0.5", "limits.speed"),
        ("machine_seconds = 300.0", "machine_seconds = 30.0", "machine_seconds"),
    ],
)
def test_limits_too_small_for_an_experiment_say_which_and_what_is_needed(
    bench: Bench, old: str, new: str, limit: str
) -> None:
    bench.change(old, new)
    bench.start()
    done = bench.run()
    assert done.returncode == 2, done.stderr
    assert re.search(limit, done.stderr), done.stderr
    assert "OPERATION_ENABLED" not in bench.log.read_text()


@pytest.mark.parametrize(
    ("fault", "codes"),
    [
        pytest.param("blocked@12", (4, 5), marks=pytest.mark.long),
        ("drive-fault@12", (5,)),
        pytest.param("emcy@12", (5,), marks=pytest.mark.long),
        pytest.param("hot@12", (4, 5), marks=pytest.mark.long),
        pytest.param("enable-missing@12", (5,), marks=pytest.mark.long),
    ],
)
def test_a_failure_in_the_middle_ends_at_rest_with_everything_kept(
    bench: Bench, fault: str, codes: tuple[int, ...]
) -> None:
    bench.start("--fault", fault)
    before = limits_of(bench)
    done = bench.run()
    assert done.returncode in codes, done.stderr
    assert "Traceback" not in done.stderr
    assert bench.last_state() in (AT_REST, "FAULT")
    assert limits_of(bench) == before
    assert (bench.newest() / "recordings" / "experiment.parquet").stat().st_size > 10_000
    assert json.loads(done.stdout or "{}").get("outcome", "aborted") == "aborted"


@pytest.mark.parametrize("fault", [pytest.param("silent@12", marks=pytest.mark.long), "unplugged@12"])
def test_a_node_lost_in_the_middle_stops_by_itself_and_the_next_run_puts_it_right(
    bench: Bench, fault: str
) -> None:
    bench.start("--fault", fault.replace("@", "=8@"))
    done = bench.run()
    assert done.returncode == 5, done.stderr
    assert "Traceback" not in done.stderr
    assert "quick stop begun" in bench.log.read_text()
    assert bench.ends_in(AT_REST, "FAULT")
    assert (bench.newest() / "recordings" / "experiment.parquet").stat().st_size > 10_000


@pytest.mark.usefixtures("signals_are_heard")
@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        *(pytest.param(number, marks=pytest.mark.long) for number in (signal.SIGTERM, signal.SIGHUP)),
    ],
)
def test_an_interrupted_run_ends_at_rest_and_restores_what_it_changed(bench: Bench, number: int) -> None:
    bench.start()
    before = limits_of(bench)
    process = bench.popen()
    bench.wait_for(lambda: "OPERATION_ENABLED" in bench.log.read_text())
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert "without power, as the drive confirms" in errors
    assert bench.last_state() == AT_REST
    assert limits_of(bench) == before
    assert bench.result()["outcome"] == "aborted"


def test_a_real_drive_is_never_moved_unasked(bench: Bench) -> None:
    bench.change('profile = "autotune-sim"', 'profile = "cia402"')
    done = called("run", str(bench.axis), "--runs", str(bench.runs))
    assert done.returncode == 2
    assert "--yes" in done.stderr
    assert not bench.runs.exists()


def test_the_simulated_drive_needs_nobody_to_be_asked(bench: Bench) -> None:
    bench.start()
    done = called("run", str(bench.axis), "--only", "check", "--runs", str(bench.runs))
    assert done.returncode == 0, done.stderr
