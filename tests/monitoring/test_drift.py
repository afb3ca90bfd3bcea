"""What counts as drift: doubt is not drift, one check is only suspicion, a rough signal is no measurement."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.axis import read_axis
from autotune.core.paths import config_directory
from autotune.monitoring.check_figures import CheckFigures, Figure, Tracking, straight_line
from autotune.monitoring.drift import Before, Committed, Drift, DriftSettings, Evidence, judge
from autotune.monitoring.segments import breaks
from autotune.monitoring.trend import analyse, sentence
from autotune.service.observe import Told, decode, encode, may_tune, news, worth_a_notice
from autotune.tuning.committed import in_force
from autotune.tuning.proof import TrackingError

SETTINGS = DriftSettings()
COMMITTED = Committed("20260101-030000-one", 0.5e-3, {"feedforward.enabled": 1.0})
START = datetime(2026, 1, 1, 3, tzinfo=UTC)


def figures(friction: float = 1.0, peak: float = 0.5e-3, without: float = 2e-3, noise: float = 4e-5,
            error: float = 0.001) -> CheckFigures:  # fmt: skip
    def tracking(value: float) -> Tracking:
        return Tracking(TrackingError(value, 1.1 * value, 0.3 * value), 0.02 * value)

    return CheckFigures(
        Figure(0.33 * friction, 0.33 * error, "N m"), {}, 0.33, tracking(peak), tracking(without), 25.0, noise,
        0.01, 0, 20_000,
    )  # fmt: skip


def before(change: float = 0.0, beyond: bool = False, run: str = COMMITTED.run) -> Before:
    return Before("2026-01-02T03:00:00+00:00", run, change, beyond, 0.33 * (1 + change), 25.0, 4e-5)


def evidence(measured: CheckFigures, *earlier: Before, held: bool | None = True) -> Evidence:
    return Evidence(measured, COMMITTED, held, earlier, 1.26e-4)


def test_an_axis_as_committed_has_not_drifted() -> None:
    assert judge(evidence(figures()), SETTINGS).drift is Drift.NONE


@pytest.mark.parametrize("friction", [1.14, 0.87])
def test_a_change_within_the_size_is_no_drift(friction: float) -> None:
    assert judge(evidence(figures(friction)), SETTINGS).drift is Drift.NONE


def test_a_change_beyond_the_size_but_not_beyond_doubt_is_no_drift() -> None:
    assert judge(evidence(figures(1.17, error=0.05)), SETTINGS).drift is Drift.NONE


def test_one_check_is_suspicion_and_two_are_drift() -> None:
    first = judge(evidence(figures(1.3), before()), SETTINGS)
    assert (first.drift, first.beyond, first.wants_tuning) == (Drift.SUSPECTED, True, False)
    second = judge(evidence(figures(1.3), before(0.3, True)), SETTINGS)
    assert (second.drift, second.wants_tuning) == (Drift.DRIFTED, True)
    assert "30% above" in second.sentence.replace(" %", "%")
    assert "lubrication" in second.advice


def test_two_that_contradict_or_belong_to_another_commit_do_not_confirm() -> None:
    assert judge(evidence(figures(1.3), before(-0.3, True)), SETTINGS).drift is Drift.SUSPECTED
    assert judge(evidence(figures(1.3), before(0.3, True, "earlier")), SETTINGS).drift is Drift.SUSPECTED


def test_after_acceptance_only_what_moved_since_counts() -> None:
    accepted = replace(COMMITTED, accepted="20260201-030000-one")
    old = replace(evidence(figures(1.3), before(0.3, True)), committed=accepted)
    verdict = judge(old, SETTINGS)
    assert verdict.drift is Drift.SUSPECTED, "checks against the model before do not confirm"
    assert "20260201-030000-one" in verdict.sentence
    new = replace(evidence(figures(1.3), before(0.3, True, accepted.accepted)), committed=accepted)
    assert judge(new, SETTINGS).drift is Drift.DRIFTED
    harms = replace(evidence(figures(1.0, peak=3e-3, without=1e-3)), committed=accepted)
    assert judge(harms, SETTINGS).drift is Drift.HARMFUL, "no acceptance hides harm"


def test_compensation_that_harms_is_acted_on_at_once() -> None:
    verdict = judge(evidence(figures(0.4, peak=3e-3, without=1e-3)), SETTINGS)
    assert verdict.drift is Drift.HARMFUL
    assert verdict.wants_tuning


def test_worse_tracking_at_the_same_friction_is_drift_of_something_else() -> None:
    verdict = judge(evidence(figures(1.0, peak=1e-3)), SETTINGS)
    assert verdict.drift is Drift.SUSPECTED
    assert "backlash" in verdict.advice


def test_a_rough_signal_starts_no_tuning_whatever_friction_seems_to_be() -> None:
    verdict = judge(evidence(figures(2.0, noise=9e-4), before(0.9, True)), SETTINGS)
    assert verdict.drift is Drift.SIGNAL
    assert not verdict.wants_tuning
    assert "encoder" in verdict.advice.lower()


def test_a_drive_that_lost_what_was_committed_is_told_apart_from_drift() -> None:
    assert judge(evidence(figures(), held=False), SETTINGS).drift is Drift.LOST
    nothing = replace(evidence(figures()), committed=None)
    assert judge(nothing, SETTINGS).drift is Drift.UNKNOWN


def test_temperature_is_taken_out_where_its_influence_is_known() -> None:
    warm = replace(evidence(figures(0.8)), temperature_coefficient=-0.02, reference_temperature=15.0)
    assert judge(warm, SETTINGS).drift is Drift.NONE
    assert judge(replace(warm, temperature_coefficient=None), SETTINGS).drift is Drift.SUSPECTED


def test_straight_line_gives_back_what_was_put_in() -> None:
    from autotune.identify.steady_state import Points

    speed = np.array([0.2, 0.5, 1.0, -0.2, -0.5, -1.0])
    torque = 0.3 * np.sign(speed) + 0.02 * speed + 0.05
    found = straight_line(Points(speed, torque, np.full(6, 1e-3)))
    for name, value in (("coulomb", 0.3), ("viscous", 0.02), ("offset", 0.05)):
        assert found[name][0] == pytest.approx(value, abs=1e-9)
        assert 0.0 < found[name][1] < 5e-3


@pytest.mark.parametrize(("host", "known"), [([], True), (["offset"], False)])
def test_tracking_with_a_host_beside_the_drive_is_no_measure_for_a_check(
    tmp_path: Path, host: list[str], known: bool
) -> None:
    axis = read_axis(config_directory() / "axes" / "simulated.toml")
    run = tmp_path / "20260301-120000-simulated"
    run.mkdir()
    content = {
        "axis": axis.name, "outcome": "kept", "fingerprint": axis.fingerprint, "reduction": {"host": host},
        "committed": {"peak_error": 1e-4}, "feedforward": {"feedforward.coulomb": 0.3},
    }  # fmt: skip
    (run / "run.json").write_text(json.dumps(content))
    found = in_force(tmp_path, axis, {"feedforward.coulomb": 0.3, "feedforward.enabled": 1.0})
    assert found.held
    assert found.committed is not None
    assert (found.committed.peak_error == 1e-4) is known


def left(folder: Path, file: str, **content: object) -> None:
    folder.mkdir(exist_ok=True)
    (folder / file).write_text(json.dumps({"axis": "simulated", **content}))


def test_what_is_accepted_belongs_to_what_is_committed(tmp_path: Path) -> None:
    axis = read_axis(config_directory() / "axes" / "simulated.toml")
    mark = axis.fingerprint
    first, later, other = (tmp_path / f"2026030{day}-120000-simulated" for day in (1, 2, 3))
    gains = {"feedforward.coulomb": 0.3}
    left(
        first, "run.json", outcome="kept", fingerprint=mark, committed={"peak_error": 1e-4}, feedforward=gains
    )
    left(other, "accepted.json", committed="20260101-000000-simulated", peak_error=9e-4, fingerprint=mark)
    held = {**gains, "feedforward.enabled": 1.0}
    assert in_force(tmp_path, axis, held).committed == Committed(first.name, 1e-4, held)
    left(later, "accepted.json", committed=first.name, peak_error=2e-4, fingerprint=mark)
    found = in_force(tmp_path, axis, held)
    assert found.held
    assert found.committed is not None
    assert found.committed == Committed(first.name, 2e-4, held, later.name)
    assert found.committed.baseline == later.name
    left(
        other, "run.json", outcome="kept", fingerprint=mark, committed={"peak_error": 1e-4}, feedforward=gains
    )
    assert in_force(tmp_path, axis, held).committed == Committed(other.name, 1e-4, held)


# Trends


def series(days: int, seed: int = 0) -> tuple[list[datetime], np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    times = [START + timedelta(days=n) for n in range(days)]
    return times, 0.33 * np.exp(random.normal(0.0, 0.006, days)), 25.0 + random.normal(0.0, 1.0, days)


@pytest.mark.parametrize("seed", range(20))
def test_a_steady_axis_has_no_changes(seed: int) -> None:
    times, values, temperature = series(200, seed)
    trend = analyse(times, values.tolist(), temperature.tolist())
    assert trend is not None
    assert trend.changes == ()


@pytest.mark.parametrize("seed", range(10))
def test_a_step_is_found_on_its_day_two_days_later(seed: int) -> None:
    times, values, temperature = series(102, seed)
    values[100:] *= 0.72
    trend = analyse(times, values.tolist(), temperature.tolist())
    assert trend is not None
    (step,) = trend.changes
    assert (step.kind, step.at) == ("step", times[100])
    assert step.size == pytest.approx(-0.28, abs=0.03)
    assert "re-greasing" in sentence(step, "Coulomb friction")


@pytest.mark.parametrize("seed", range(10))
def test_creeping_wear_is_found_with_its_beginning(seed: int) -> None:
    times, values, temperature = series(120, seed)
    values *= 1.0 + 0.2 * np.clip((np.arange(120) - 60) / 60, 0.0, None)
    trend = analyse(times, values.tolist(), temperature.tolist())
    assert trend is not None
    grown = math.prod(1.0 + change.size for change in trend.changes if change.kind != "odd")
    assert grown == pytest.approx(1.2, abs=0.05)
    first = trend.changes[0]
    assert abs((first.at - times[60]).days) <= 20
    assert "check lubrication" in sentence(first, "Coulomb friction")


def test_one_odd_day_is_an_odd_day_and_no_step() -> None:
    times, values, temperature = series(100)
    values[60] *= 1.7
    trend = analyse(times, values.tolist(), temperature.tolist())
    assert trend is not None
    (odd,) = trend.changes
    assert (odd.kind, odd.at) == ("odd", times[60])
    assert odd.size == pytest.approx(0.7, abs=0.06)


def test_a_season_is_temperature_and_no_change() -> None:
    times, values, _ = series(365)
    temperature = 25.0 - 8.0 * np.cos(2 * np.pi * np.arange(365) / 365)
    values *= 1.0 - 0.01 * (temperature - 25.0)
    trend = analyse(times, values.tolist(), temperature.tolist())
    assert trend is not None
    assert trend.temperature_coefficient == pytest.approx(-0.01, abs=0.002)
    assert all(abs(change.size) < 0.06 for change in trend.changes)


def test_wear_between_a_season_and_a_re_greasing_is_said_as_it_is() -> None:
    """Wear of 40 % over days 60 to 130, re-greased on day 131 by 35 %; 0.6 % of scatter, 1.5 K of weather."""
    random = np.random.default_rng(3)
    day = np.arange(220)
    temperature = 25.0 - 8.0 * np.cos(2 * np.pi * (day - 20) / 365) + random.normal(0.0, 1.5, len(day))
    friction = (1.0 + 0.4 * np.clip((day - 60) / 70, 0.0, 1.0)) * np.where(day >= 131, 0.65, 1.0)
    values = (
        0.33 * friction * (1.0 - 0.007 * (temperature - 25.0)) * np.exp(random.normal(0.0, 0.006, len(day)))
    )
    times = [START + timedelta(days=int(number)) for number in day]
    told: list[Told] = []
    heard: list[tuple[int, str]] = []
    for number in range(40, len(day), 1):
        trend = analyse(times[:number], values[:number].tolist(), temperature[:number].tolist())
        for one, words in news(trend, told):
            told.append(one)
            heard.append((number - 1, words))
    assert trend is not None
    wear, greased = trend.changes
    assert (wear.kind, greased.kind, greased.at) == ("trend", "step", times[131])
    assert wear.size == pytest.approx(0.4, abs=0.03)
    assert greased.size == pytest.approx(-0.35, abs=0.02)
    assert wear.until is not None
    assert abs((wear.until - times[131]).days) <= 1
    assert "from" in sentence(wear, "Coulomb friction")
    assert trend.temperature_coefficient == pytest.approx(-0.007, abs=0.0007)
    first, words = heard[0]
    assert first <= 69 + 3, "5 % up on day 69"
    assert "up" in words
    steps = [number for number, words in heard if "re-greasing" in words]
    assert steps == [132]
    assert all(60 < number <= 132 for number, _ in heard), heard
    assert len(heard) <= 6


@given(st.integers(0, 10_000), st.integers(4, 9))
def test_the_cut_is_the_best_of_all(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(0.5, 2.0, count))
    y = random.normal(0.0, 1.0, count) + 4.0 * (np.arange(count) >= random.integers(0, count))

    def worth(cuts: tuple[int, ...]) -> float:
        total = 0.0
        for begin, end in pairwise([0, *cuts, count]):
            line = np.polyfit(t[begin:end] - t[begin], y[begin:end], 1)
            total += float(np.sum((np.polyval(line, t[begin:end] - t[begin]) - y[begin:end]) ** 2)) + 3.0
        return total

    every = [
        cuts
        for pieces in range(count // 2)
        for cuts in combinations(range(1, count), pieces)
        if all(end - begin >= 2 for begin, end in pairwise([0, *cuts, count]))
    ]
    found = tuple(breaks(t, y, 1.0, 3.0))
    assert worth(found) == pytest.approx(min(worth(cuts) for cuts in every), abs=1e-6)


def test_few_points_say_nothing() -> None:
    times, values, temperature = series(5)
    assert analyse(times, values.tolist(), temperature.tolist()) is None


def test_unknown_temperatures_do_no_harm() -> None:
    times, values, _ = series(50)
    trend = analyse(times, values.tolist(), [math.nan] * 50)
    assert trend is not None
    assert trend.temperature_coefficient is None


# What follows


def test_a_change_is_told_once_and_again_only_when_it_has_grown() -> None:
    times, values, temperature = series(120)
    values *= 1.0 + 0.4 * np.clip((np.arange(120) - 60) / 60, 0.0, None)
    told: list[Told] = []
    count = 0
    for day in range(62, 120):
        trend = analyse(times[:day], values[:day].tolist(), temperature[:day].tolist())
        fresh = news(trend, told)
        told += [one for one, _ in fresh]
        count += len(fresh)
    assert 1 <= count <= 6


def test_what_was_told_survives_being_stored() -> None:
    told = Told("step", START, -0.25)
    assert decode(f"one:trend:{encode(told)}") == told
    assert decode("something else") is None


def test_tuning_is_not_tried_again_and_again() -> None:
    now = START + timedelta(days=10)
    assert may_tune(None, None, now)
    assert not may_tune({"outcome": "kept"}, now - timedelta(hours=3), now)
    assert may_tune({"outcome": "kept"}, now - timedelta(days=1), now)
    assert not may_tune({"outcome": "not_applied"}, now - timedelta(days=2), now)
    assert may_tune({"outcome": "not_applied"}, now - timedelta(days=15), now)


def test_a_last_point_that_stands_alone_says_nothing_yet() -> None:
    times, values, temperature = series(100)
    values[99] *= 0.7
    trend = analyse(times, values.tolist(), temperature.tolist())
    assert trend is not None
    assert trend.changes == ()


def test_the_same_state_is_told_when_it_is_new_and_then_once_a_week() -> None:
    states = ["none"] * 3 + ["drifted"] * 15
    told = [n for n in range(3, len(states)) if worth_a_notice(states[: n + 1])]
    assert told == [3, 10, 17]
