"""Every experiment: continuous, inside what it declares, labelled as promised, about as long as predicted."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from functools import cache
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.control.feedforward import FixedFeedforward, LugreParameters
from autotune.core.axis import Axis
from autotune.core.drive import Command, Sample
from autotune.core.errors import ConfigurationError
from autotune.experiments.dahl import dahl
from autotune.experiments.experiment import Experiment, PlannedExperiment
from autotune.experiments.guard import Guard
from autotune.experiments.high_speed import HighSpeed, high_speed
from autotune.experiments.path import Mark, Motion
from autotune.experiments.programmes import PROGRAMMES, Choices, build
from autotune.experiments.sines import AdaptiveSine, BenchmarkSine, period_samples
from autotune.experiments.steady_state import SteadyState, steady_state
from tests.experiments.support import axis, sample

RIVALS = ("torque_ripple", "spring")
LAW = FixedFeedforward(LugreParameters(6.66e-4, 4.13e-3, 0.33, 40.0, 0.1, 0.05, 0.33), 1e-3)


def rehearse(experiment: Experiment, start: float = 0.0) -> tuple[list[Command], list[tuple[str, int]]]:
    """Commands of an experiment on an axis that follows exactly, with their labels."""
    seen = sample(position=start, reference=start)
    steps = experiment.run(seen)
    commands: list[Command] = []
    labels: list[tuple[str, int]] = []
    now = ("", -1)
    item = next(steps)
    while True:
        if isinstance(item, Mark):
            now = (item.label, item.repeat)
        elif isinstance(item, Command):
            commands.append(item)
            labels.append(now)
            seen = Sample(
                len(commands) * 1e-3, item.position, item.position, 0.0, item.torque_feedforward,
                item.torque_feedforward, item.torque_feedforward, 0.0, math.nan, 0,
            )  # fmt: skip
        try:
            item = steps.send(seen)
        except StopIteration:
            return commands, labels


@cache
def planned(name: str) -> list[PlannedExperiment]:
    """A programme's experiments on the usual axis, whose references are worked out once."""
    return [
        one
        for one in build(name, axis(), Choices(seed=3, rivals=RIVALS))
        if isinstance(one, PlannedExperiment)
    ]


@pytest.mark.parametrize("name", sorted(PROGRAMMES))
@given(start=st.floats(-15.0, 15.0))
@settings(max_examples=3, deadline=None)
def test_references_are_continuous_and_within_their_needs(name: str, start: float) -> None:
    where = axis()
    for experiment in planned(name):
        needs = experiment.needs(where.limits)
        commands, _ = rehearse(experiment, start)
        positions = np.array([start, *(command.position for command in commands)])
        speed = np.abs(np.diff(positions)) / where.cycle
        assert speed.max() <= max(needs.speed, experiment.motion.speed)
        assert np.abs(np.diff(positions, 2)).max() / where.cycle**2 < where.limits.deceleration
        assert speed[-1] < 1e-3
        there = positions[-len(experiment.plan.reference) :]
        assert there.min() >= needs.position_min
        assert there.max() <= needs.position_max
        assert max(abs(command.torque_feedforward) for command in commands) <= needs.torque


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name in ("diagnosis", "identification") else name
        for name in sorted(PROGRAMMES)
    ],
)
def test_the_guard_lets_every_programme_pass_with_limits_that_are_just_enough(name: str) -> None:
    where = axis()
    for experiment in planned(name):
        needs = experiment.needs(where.limits)
        tight = where.limits.model_copy(
            update={
                "position_min": needs.position_min,
                "position_max": needs.position_max,
                "speed": needs.speed,
            }
        )
        experiment.requirements(tight)
        guard = Guard(tight, where.cycle, where.position_resolution, 1e9)
        plan = experiment.plan
        before = sample(position=plan.reference[0], reference=plan.reference[0])
        guard.begin(experiment.mode, before)
        for position, velocity in zip(plan.reference.tolist(), plan.velocity.tolist(), strict=True):
            guard.check(before, Command(position))
            before = sample(position=position, reference=position, velocity=velocity)
        assert guard.elapsed == pytest.approx(len(plan.reference) * where.cycle, abs=5e-3)  # to its end


@pytest.mark.parametrize("name", sorted(PROGRAMMES))
def test_labels_and_durations_are_as_declared(name: str) -> None:
    for experiment in planned(name):
        commands, labels = rehearse(experiment, experiment.motion.centre)
        assert {label for label, _ in labels} == set(experiment.labels)
        assert len(commands) * 1e-3 == pytest.approx(experiment.duration, abs=2e-3)


def test_durations_fit_into_the_machine_time_of_a_run() -> None:
    bounds = {
        "identification": (105, 125),
        "steady-state": (43, 46),
        "presliding": (30, 42),
        "dahl": (23, 27),
        "high-speed": (7, 13),
        "benchmark": (19, 22),
        "diagnosis": (150, 190),
    }
    for name, (low, high) in bounds.items():
        assert low < sum(one.duration for one in build(name, axis())) < high, name


@pytest.mark.parametrize("cycle", [2.5e-4, 2e-3, 4e-3, 1e-2])
def test_durations_hardly_depend_on_the_cycle(cycle: float) -> None:
    where = axis().model_copy(update={"cycle": cycle})
    assert 100 < sum(one.duration for one in build("identification", where)) < 130
    assert 140 < sum(one.duration for one in build("diagnosis", where)) < 200


def test_experiments_survive_pickling_without_their_plans() -> None:
    for one in (*build("identification", axis()), *build("diagnosis", axis())):
        one.prepare()
        copy = pickle.loads(pickle.dumps(one))
        assert copy == one
        assert copy.duration == one.duration
    assert len(pickle.dumps(build("steady-state", axis()))) < 5000


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"position_min": -0.1, "position_max": 0.1}, r"limits\.position_min is -0\.1 but -0\.2.* is needed"),
        ({"speed": 1.0}, r"limits\.speed is 1 but 1\.38"),
        ({"deceleration": 5.0}, r"limits\.deceleration is 5 but 12"),
    ],
)
def test_limits_that_are_too_small_are_named_with_what_is_needed(
    changed: dict[str, float], says: str
) -> None:
    where = axis(**changed)
    with pytest.raises(ConfigurationError, match=says) as error:
        BenchmarkSine(Motion.of(where)).requirements(where.limits)
    assert "'benchmark'" in str(error.value)


def test_torque_that_an_experiment_adds_is_held_against_the_limit() -> None:
    motion = Motion.of(axis())
    with pytest.raises(ConfigurationError, match=r"limits\.torque is 0\.05 but 0\.067"):
        high_speed(motion).requirements(axis(torque=0.05).limits)


@pytest.mark.parametrize("make", [lambda motion: steady_state(motion, np.random.default_rng(0)), high_speed])
def test_a_travel_that_is_too_small_is_said(make: Callable[[Motion], Experiment]) -> None:
    motion = Motion.of(axis(position_min=-0.05, position_max=0.05))
    with pytest.raises(ConfigurationError, match=r"needs a travel of ±0\.\d+ round 0.*leave ±0\.05"):
        make(motion)


@pytest.mark.slow
@given(
    travel=st.floats(1.0, 60.0),
    speed=st.floats(3.0, 60.0),
    braking=st.floats(60.0, 2000.0),
    amplitude=st.floats(0.05, 0.4),
    cycle=st.sampled_from([1e-3, 2e-3, 4e-3]),
    seed=st.integers(0, 5),
)
@settings(max_examples=25, deadline=None)
def test_programmes_adapt_to_the_axis_or_say_why_not(
    travel: float, speed: float, braking: float, amplitude: float, cycle: float, seed: int
) -> None:
    where = axis(position_min=-travel, position_max=travel, speed=speed, deceleration=braking)
    benchmark = where.benchmark.model_copy(update={"amplitude": amplitude})
    where = where.model_copy(update={"benchmark": benchmark, "cycle": cycle})
    refused = {name: why for name in ("identification", "diagnosis") if (why := refusal(name, where, seed))}
    assert not refused or travel < 6.0 * amplitude + 1.0 or speed < 15.0 * amplitude, refused


def refusal(name: str, where: Axis, seed: int) -> str:
    """Why a programme cannot be played on this axis; empty where it can."""
    try:
        for one in build(name, where, Choices(seed=seed)):
            one.requirements(where.limits)
    except ConfigurationError as error:
        return str(error)
    return ""


def test_linear_axes_have_no_revolution_to_average_over() -> None:
    rotary = axis()
    mechanics = rotary.mechanics.model_copy(update={"counts_per_metre": 1e6})
    linear = rotary.model_copy(update={"motion_unit": "m", "mechanics": mechanics})
    experiment = steady_state(Motion.of(linear), np.random.default_rng(0))
    assert experiment.duration == pytest.approx(45.0, abs=1.0)
    assert len(experiment.stretches) == 14


def test_steady_state_goes_both_ways_over_the_same_stretch_at_constant_speed() -> None:
    experiment = steady_state(Motion.of(axis()), np.random.default_rng(1))
    commands, labels = rehearse(experiment)
    positions = np.array([command.position for command in commands])
    for index, (speed, stretch) in enumerate(zip(experiment.speeds, experiment.stretches, strict=True)):
        rows = np.array(
            [label in (("steady_state", 2 * index), ("steady_state", 2 * index + 1)) for label in labels]
        )
        assert rows.sum() * 1e-3 == pytest.approx(2 * stretch / speed, abs=3e-3)
        steps = np.diff(positions)[rows[1:] & rows[:-1]] / 1e-3
        assert np.median(np.abs(steps)) == pytest.approx(speed, rel=1e-6)
        assert 0.48 < (steps > 0).mean() < 0.52
        ends = positions[rows]
        lag = 0.005 * speed  # of the reference filter
        assert ends.min() == pytest.approx(-0.5 * stretch, abs=2.5 * lag)
        assert ends.max() == pytest.approx(0.5 * stretch, abs=2.5 * lag)


def test_steady_state_speeds_are_log_spaced_shuffled_and_seeded() -> None:
    make = lambda seed: steady_state(Motion.of(axis()), np.random.default_rng(seed))  # noqa: E731
    assert make(1) == make(1)
    assert make(1).speeds != make(2).speeds
    ratios = np.diff(np.log(sorted(make(1).speeds)))
    assert np.allclose(ratios, ratios[0])
    assert list(make(1).speeds) != sorted(make(1).speeds)


def test_steady_state_stretches_are_whole_revolutions_or_whole_parts() -> None:
    experiment: SteadyState = steady_state(Motion.of(axis()), np.random.default_rng(0))
    turns = np.array(experiment.stretches) / (2 * math.pi)
    whole = np.where(turns >= 1.0, turns, 1.0 / turns)
    assert np.allclose(whole, np.round(whole))
    assert max(turns) >= 1.0


def test_dahl_loops_are_slow_close_and_shrink() -> None:
    experiment = dahl(Motion.of(axis()))
    commands, labels = rehearse(experiment)
    positions = np.array([command.position for command in commands])
    assert np.abs(np.diff(positions)).max() / 1e-3 <= experiment.speed * (1 + 1e-9)
    assert experiment.speed < 0.12
    for repeat in range(3):
        rows = np.array([label == ("dahl", repeat) for label in labels])
        assert np.ptp(positions[rows]) == pytest.approx(2 * experiment.large, rel=0.01)
    assert list(experiment.small) == sorted(experiment.small, reverse=True)


def test_high_speed_never_turns_back_and_excites_with_whole_prbs_periods() -> None:
    experiment: HighSpeed = high_speed(Motion.of(axis()))
    commands, labels = rehearse(experiment)
    for index in range(experiment.passes):
        rows = [c for c, label in zip(commands, labels, strict=True) if label == ("high_speed", index)]
        assert len(rows) == experiment.periods * (2**experiment.bits - 1) * 2
        steps = np.diff([c.position for c in rows])
        assert (steps > 0).all() or (steps < 0).all()
        assert {abs(c.torque_feedforward) for c in rows} == {experiment.excitation}


def test_benchmark_windows_are_whole_periods_of_the_sine() -> None:
    motion = Motion.of(axis())
    commands, labels = rehearse(BenchmarkSine(motion, repeats=3, periods=2, first_repeat=4, label="before"))
    n = period_samples(motion)
    for repeat in (4, 5, 6):
        r = np.array([c.position for c, x in zip(commands, labels, strict=True) if x == ("before", repeat)])
        assert len(r) == 2 * n
        spectrum = np.abs(np.fft.rfft(r)) / n
        assert spectrum[2] == pytest.approx(0.2, rel=0.01)
        assert np.delete(spectrum, 2).max() < 1e-6


class Law:
    """Notes what it is asked; settled after some steps."""

    def __init__(self, settles_after: int = 10**9) -> None:
        self.asked: list[tuple[float, float, float, Sample | None]] = []
        self.settles_after = settles_after

    @property
    def settled(self) -> bool:
        return len(self.asked) >= self.settles_after

    def prepare(self) -> None:
        return

    def step(self, reference: float, velocity: float, acceleration: float, previous: Sample | None) -> float:
        self.asked.append((reference, velocity, acceleration, previous))
        return 0.1


def test_feedforward_is_for_the_reference_that_it_is_sent_with() -> None:
    motion = Motion.of(axis())
    experiment = BenchmarkSine(motion, 1, 2, Law())
    commands, labels = rehearse(experiment)
    asked = rehearse_law(experiment).asked
    n = period_samples(motion)
    assert [c.position for c in commands[: 4 * n - 1]] == [reference for reference, *_ in asked][: 4 * n - 1]
    assert asked[0][3] is None
    # what it sees is the sample of the command before
    assert all(asked[k][3].torque_feedforward == commands[k - 1].torque_feedforward for k in (5, 700, 3000))  # type: ignore[union-attr]
    measured = [c.torque_feedforward for c, x in zip(commands, labels, strict=True) if x[0] == "benchmark"]
    assert set(measured) == {0.1}
    assert abs(commands[-1].torque_feedforward) == 0.0


def rehearse_law(experiment: BenchmarkSine | AdaptiveSine) -> Law:
    steps = experiment.run(sample())
    item = next(steps)
    seen = sample()
    while True:
        if isinstance(item, Command):
            seen = sample(position=item.position, torque_feedforward=item.torque_feedforward)
        try:
            item = steps.send(seen)
        except StopIteration as end:
            return cast(Law, end.value)


def test_velocity_and_acceleration_are_those_of_the_sine() -> None:
    motion = Motion.of(axis())
    asked = np.array([row[:3] for row in rehearse_law(BenchmarkSine(motion, 1, 2, Law())).asked])
    n, w = period_samples(motion), 2 * math.pi
    reference, velocity, acceleration = asked[n : 3 * n].T
    # a sine obeys r'' = −w² r and r'² + w² r² = const; the rest is what differences of 1 ms leave
    assert np.allclose(acceleration, -w * w * reference, atol=2e-4)
    assert np.allclose(velocity**2 + (w * reference) ** 2, (0.2 * w) ** 2, rtol=3e-3)


def test_adaptation_ends_when_settled_and_returns_the_law() -> None:
    motion = Motion.of(axis())
    n = period_samples(motion)
    experiment = AdaptiveSine(motion, Law(settles_after=3 * n + 10), longest=20.0)
    law = rehearse_law(experiment)
    _, labels = rehearse(experiment)
    assert law.settled
    assert {repeat for label, repeat in labels if label == "adaptation"} == {0, 1, 2}
    assert not experiment.feedforward.asked  # type: ignore[attr-defined]


def test_adaptation_ends_at_its_longest() -> None:
    experiment = AdaptiveSine(Motion.of(axis()), Law(), longest=8.0)
    commands, labels = rehearse(experiment)
    assert len(commands) * 1e-3 == pytest.approx(experiment.duration, abs=0.01)
    assert experiment.duration <= 8.2
    assert {repeat for label, repeat in labels if label == "adaptation"} == set(range(6))
    positions = np.array([command.position for command in commands])
    assert np.abs(np.diff(positions, 2)).max() / 1e-6 < 15.0


def test_a_real_law_compensates_smoothly() -> None:
    commands, _ = rehearse(BenchmarkSine(Motion.of(axis()), 1, 2, LAW))
    torque = np.array([command.torque_feedforward for command in commands])
    assert 0.3 < np.abs(torque).max() < 0.5
    assert np.abs(np.diff(torque)).max() < 0.02
    assert torque[0] == pytest.approx(0.0, abs=1e-6)
    assert torque[-1] == 0.0


def test_diagnosis_plays_everything_twice_from_seeded_draws() -> None:
    one, same, other = (build("diagnosis", axis(), Choices(seed=seed)) for seed in (1, 1, 2))
    names = [experiment.name for experiment in one]
    assert names[0] == "conditioning"
    assert names[1:8] == names[8:15] == [
        "presliding_sines", "sine", "triangles", "scans", "dwells", "multisine", "point_to_point"
    ]  # fmt: skip
    assert names[15:] == ["veto", "veto", "test"]
    plans = [
        [x.plan.reference for x in programme if isinstance(x, PlannedExperiment)]
        for programme in (one, same, other)
    ]
    assert all(np.array_equal(a, b) for a, b in zip(plans[0], plans[1], strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(plans[0], plans[2], strict=True))
    assert all(np.array_equal(plans[0][k], plans[0][k + 7]) for k in range(1, 8))
    assert np.array_equal(plans[0][15], plans[0][16])


def test_an_unknown_programme_gets_the_nearest_right_name() -> None:
    with pytest.raises(ConfigurationError, match="did you mean 'diagnosis'"):
        build("diagnosys", axis())
