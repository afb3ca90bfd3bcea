"""The same run in process: other axes, an axis that feedforward cannot help, and the speed of it."""

from __future__ import annotations

import json
import signal
import time

import pytest

from autotune.models.model_file import read_model
from autotune_sim.presets import preset
from tests.end_to_end.support import Bench


def in_process(bench: Bench, query: str = "") -> None:
    bench.change(
        'link = "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5"',
        f'link = "sim://edm-vertical{query}"',
    )


# what a memory's note says where small loops of all friction close: it is suspected at best (decision 0028)
NOTHING_FORGETS = "Beside this reversal memory no contact is left that forgets"


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=[] if seed == 2 else pytest.mark.long) for seed in range(1, 6)]
)
def test_what_other_axes_lack_is_named_and_their_error_falls_to_the_floor(bench: Bench, seed: int) -> None:
    """The plant's true inverse leaves 0.06 mrad here; LuGre feedforward alone, which the drive holds, 0.5."""
    in_process(bench, f"?seed={seed}")
    done = bench.run()
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["outcome"] == "kept"
    before, after, alone = (result[name]["peak_error"] for name in ("before", "after", "committed"))
    assert 0.03e-3 < after < 0.25e-3
    assert 2.5 < before / alone < 10.0
    said = result["diagnosis"]
    alone_remembers = any(NOTHING_FORGETS in note for note in result["notes"])
    assert said["verdict"] == "named"
    assert said["confidence"] == ("suspected" if alone_remembers else "confirmed")
    assert set(said["effects"]) == {"reversal_memory", "torque_ripple"}
    # how much there was depends on what the base takes: many contacts in a contact's place leave a quarter of one's
    assert said["error_after"] < 1.1 * said["noise_floor_rms"]
    assert said["error_before"] > 3.0 * said["error_after"]
    assert said["feedforward"]["chosen"]
    true = preset("edm-vertical", seed).plant.stiffness
    assert said["stiffness"] == pytest.approx(true, rel=0.12)
    assert set(result["reduction"]["lost"]) == set(said["effects"])
    assert 0.75 < result["reduction"]["agreement"] < 1.25
    model = read_model(bench.newest() / "model.toml")
    errors = [entry.error_after for entry in model.history]
    assert errors == sorted(errors, reverse=True)
    assert len(errors) >= 2
    held = read_model(bench.newest() / "feedforward.toml")
    assert {effect.name for effect in held.effects} == set(said["effects"])


@pytest.mark.slow
@pytest.mark.long
def test_an_axis_that_is_plain_lugre_gets_no_name_and_no_other_feedforward(bench: Bench) -> None:
    bench.change(
        'link = "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5"', 'link = "sim://lugre?seed=1"'
    )
    done = bench.run()
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["diagnosis"]["verdict"], result["diagnosis"]["effects"]) == ("none", [])
    assert result["diagnosis"]["feedforward"] is None
    assert result["reduction"] == {}
    assert result["after"]["peak_error"] < 0.25e-3
    assert not (bench.newest() / "feedforward.toml").exists()


def test_an_axis_without_friction_is_left_as_it_is(bench: Bench) -> None:
    in_process(bench, "?friction=0")
    done = bench.run()
    assert done.returncode == 3, done.stderr
    result = json.loads(done.stdout)
    assert result["outcome"] == "not_applied"
    assert not (bench.runs / "backups").exists()


@pytest.mark.long
def test_one_stage_after_the_other_gives_what_a_whole_run_gives(bench: Bench) -> None:
    in_process(bench)
    for stage in ("check", "experiment", "fit", "diagnose", "adapt"):
        done = bench.run("--only", stage)
        assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["adaptation"]["refined"]["peak_error"] < 0.7e-3
    early = bench.run("--only", "commit")
    assert early.returncode == 2
    assert "proved" in early.stderr
    done = bench.run("--only", "prove")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["after"]["peak_error"] < 0.25e-3
    done = bench.run("--only", "commit")
    assert done.returncode == 0, done.stderr
    committed = json.loads(done.stdout)
    assert committed["outcome"] == "kept"
    assert committed["committed"]["peak_error"] < 0.7e-3
    wrong = bench.run("--only", "everything")
    assert wrong.returncode == 2
    assert "experiment" in wrong.stderr


@pytest.mark.usefixtures("signals_are_heard")
def test_a_second_run_cannot_have_the_axis_at_the_same_time(bench: Bench) -> None:
    in_process(bench)
    first = bench.popen()
    bench.wait_for(lambda: bench.runs.exists() and any(bench.runs.glob("2*-edm-vertical/journal.json")))
    second = bench.run()
    first.send_signal(signal.SIGINT)
    first.communicate(timeout=200)
    assert second.returncode == 2
    assert f"process {first.pid}" in second.stderr


@pytest.mark.long
def test_a_run_takes_less_than_a_tenth_of_its_machine_time(bench: Bench) -> None:
    """The second run: kernels are compiled then. Processor time, which a loaded machine does not stretch."""
    import resource

    in_process(bench)
    bench.call(*bench.whole_run("--only", "check"))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.monotonic()
    result = json.loads(bench.call(*bench.whole_run()).stdout)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    assert time.monotonic() > began
    assert spent < 0.1 * result["machine_seconds"]
