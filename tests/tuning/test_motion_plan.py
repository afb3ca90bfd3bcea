"""A question is asked only for what will happen, in the numbers that will happen."""

from __future__ import annotations

import pytest

from autotune.cli.run import confirmation
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import ConfigurationError
from autotune.monitoring.motion_plan import planned_check
from autotune.tuning.motion_plan import planned_programme, planned_run
from tests.end_to_end.support import EXAMPLE


def axis() -> Axis:
    real = {"link": "canopen+socketcan://can0?node=5", "profile": "cia402"}
    return read_axis(EXAMPLE).model_copy(update=real)


@pytest.mark.parametrize("stage", ["check", "fit"])
def test_what_moves_nothing_asks_nobody(stage: str) -> None:
    assert planned_run(axis(), stage) is None
    confirmation(axis(), False, None)


@pytest.mark.parametrize("stage", [None, "experiment", "diagnose", "adapt", "prove", "commit"])
def test_what_moves_is_told_in_its_own_numbers(stage: str | None) -> None:
    plan, limits = planned_run(axis(), stage), axis().limits
    assert plan is not None
    assert limits.position_min < plan.low < 0.0 < plan.high < limits.position_max
    assert 0.0 < plan.speed <= limits.speed
    assert 5.0 < plan.seconds <= limits.machine_seconds
    told = plan.sentence(axis())
    assert f"{plan.low:.3g} and {plan.high:.3g} rad" in told
    assert f"about {plan.seconds:.0f} s" in told


def test_a_proof_alone_stays_in_the_benchmarks_own_travel() -> None:
    plan, benchmark = planned_run(axis(), "prove"), axis().benchmark
    assert plan is not None
    assert plan.high < 1.1 * benchmark.amplitude
    assert plan.seconds < 100.0


def test_check_and_programmes_tell_theirs() -> None:
    assert planned_check(axis()).seconds <= 60.0
    assert planned_programme(axis(), "benchmark").high < 0.3


def test_without_a_terminal_only_what_moves_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    with pytest.raises(ConfigurationError, match="--yes"):
        confirmation(axis(), False, planned_run(axis(), "prove"))


def test_a_run_that_may_decide_a_diagnosis_says_what_that_adds() -> None:
    without, may = planned_run(axis(), "diagnose"), planned_run(axis(), "diagnose", decide=True)
    assert without is not None
    assert may is not None
    assert may.seconds == pytest.approx(without.seconds + 60.0)
    assert (may.low, may.high, may.speed) != (without.low, without.high, without.speed)
    assert may.low <= without.low < without.high <= may.high
    assert planned_run(axis(), "check", decide=True) is None


@pytest.mark.parametrize(
    "profile", ["moteus", "beckhoff-ax8000", "autotune-sim-harmonics", "autotune-sim-moteus"]
)
def test_a_drive_that_holds_ripple_is_swept_over_a_turn_and_that_is_told(profile: str) -> None:
    without, holds = (
        planned_run(axis(), "commit"),
        planned_run(axis().model_copy(update={"profile": profile}), "commit"),
    )
    assert without is not None
    assert holds is not None
    assert holds.high - holds.low > 6.28 > without.high - without.low
    assert holds.seconds > without.seconds + 10.0
