"""The same run in process: other axes, an axis that feedforward cannot help, and the speed of it."""

from __future__ import annotations

import json
import time

import pytest

from tests.end_to_end.support import Bench


def in_process(bench: Bench, query: str = "") -> None:
    bench.change(
        'link = "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5"',
        f'link = "sim://edm-vertical{query}"',
    )


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
def test_axes_with_other_parameters_are_improved_at_least_two_and_a_half_fold(
    bench: Bench, seed: int
) -> None:
    in_process(bench, f"?seed={seed}")
    done = bench.run()
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["outcome"] == "kept"
    assert 2.5 < result["before"]["peak_error"] / result["after"]["peak_error"] < 10.0


def test_an_axis_without_friction_is_left_as_it_is(bench: Bench) -> None:
    in_process(bench, "?friction=0")
    done = bench.run()
    assert done.returncode == 3, done.stderr
    result = json.loads(done.stdout)
    assert result["outcome"] == "not_applied"
    assert not (bench.runs / "backups").exists()


def test_one_stage_after_the_other_gives_what_a_whole_run_gives(bench: Bench) -> None:
    in_process(bench)
    for stage in ("check", "experiment", "fit", "adapt"):
        done = bench.run("--only", stage)
        assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["adaptation"]["refined"]["peak_error"] < 0.7e-3
    early = bench.run("--only", "commit")
    assert early.returncode == 2
    assert "proved" in early.stderr
    wrong = bench.run("--only", "everything")
    assert wrong.returncode == 2
    assert "experiment" in wrong.stderr


def test_a_second_run_cannot_have_the_axis_at_the_same_time(bench: Bench) -> None:
    in_process(bench)
    first = bench.popen()
    bench.wait_for(lambda: bench.runs.exists() and any(bench.runs.glob("2*-edm-vertical/journal.json")))
    second = bench.run()
    first.communicate(timeout=200)
    assert second.returncode == 2
    assert f"process {first.pid}" in second.stderr


def test_a_run_takes_less_than_a_tenth_of_its_machine_time(bench: Bench) -> None:
    """The second run: kernels are compiled then. Processor time, which a loaded machine does not stretch."""
    import resource

    in_process(bench)
    bench.run("--only", "check")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.monotonic()
    result = json.loads(bench.run().stdout)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    assert time.monotonic() > began
    assert spent < 0.1 * result["machine_seconds"]
