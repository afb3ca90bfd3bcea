"""The guard: nothing leaves the limits, and nothing is stopped that would not have."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.core.axis import Limits
from autotune.core.drive import Command, Mode, Sample
from autotune.core.errors import GuardStop
from autotune.experiments.guard import REACTION_CYCLES, Guard
from tests.experiments.support import axis, sample

H = 1e-3
COUNT = axis().position_resolution
STILL = Command(0.0)


def limits(**values: float) -> Limits:
    return axis(**values).limits


def begun(at: Sample | None = None, mode: Mode = Mode.POSITION, **values: float) -> Guard:
    guard = Guard(limits(**values), H, COUNT)
    guard.where = "experiment 'dahl'"
    guard.begin(mode, at or sample())
    return guard


@pytest.mark.slow
@given(
    start=st.floats(-0.9, 0.9),
    braking=st.floats(1.0, 500.0),
    pushes=st.lists(st.tuples(st.floats(-1.0, 1.0), st.integers(1, 200)), min_size=1, max_size=12),
)
@settings(max_examples=150, deadline=None)
def test_bounded_motion_never_leaves_the_travel(
    start: float, braking: float, pushes: list[tuple[float, int]]
) -> None:
    """Any motion with |a| ≤ deceleration, two cycles of delay until the brakes act, then braking."""
    guard = begun(sample(position=start, reference=start), Mode.TORQUE, position_min=-1.0, position_max=1.0,
                  deceleration=braking, speed=1e4)  # fmt: skip
    q, v, push = start, 0.0, 0.0
    stopped = False
    for acceleration in (a * braking for a, count in pushes for _ in range(count)):
        try:
            guard.check(sample(position=q, velocity=v), STILL)
        except GuardStop:
            stopped = True
            break
        push = acceleration
        q, v = q + v * H + 0.5 * push * H * H, v + push * H
        assert -1.0 <= q <= 1.0
    if stopped:
        assert _farthest(q, v, push, braking) <= 1.0 + 1e-9
        assert _farthest(-q, -v, -push, braking) <= 1.0 + 1e-9
        # and it was not stopped for nothing: the worst it could have done would have broken the limit
        # (the guard's own velocity, a difference of positions, is half a cycle old)
        v_worst = abs(v) + 0.5 * braking * H
        worst = max(_farthest(s * q, v_worst, braking, braking, REACTION_CYCLES) for s in (1.0, -1.0))
        assert worst > 1.0 - 1e-9


@pytest.mark.slow
@given(
    mode=st.sampled_from(list(Mode)),
    start=st.floats(-0.9, 0.9),
    braking=st.floats(20.0, 400.0),
    count=st.sampled_from([1e-6, 1e-4, 3e-3]),
    pushes=st.lists(st.tuples(st.floats(-1.0, 1.0), st.integers(1, 200)), min_size=1, max_size=10),
)
@settings(max_examples=200, deadline=None)
def test_the_stop_is_early_enough_from_every_state_in_every_mode(
    mode: Mode, start: float, braking: float, count: float, pushes: list[tuple[float, int]]
) -> None:
    """One mass, any |a| ≤ deceleration, whole counts; the argument of docs/safety.md.

    Travel is kept to half a count. Speed may be exceeded by what happens in the reaction of one cycle, in
    the half cycle by which a difference of positions is late, and by what one count can hide.
    """
    bound = limits(position_min=-1.0, position_max=1.0, deceleration=braking, speed=3.0)
    guard = Guard(bound, H, count)
    guard.begin(mode, sample(position=start, reference=start))
    q, v, push, seen = start, 0.0, 0.0, start
    for acceleration in (a * braking for a, cycles in pushes for _ in range(cycles)):
        command = Command(position=seen, velocity=min(max(v, -3.0), 3.0))
        try:
            guard.check(sample(position=seen, reference=seen, velocity=v), command)
        except GuardStop:
            break
        push = acceleration
        q, v = q + v * H + 0.5 * push * H * H, v + push * H
        seen = round(q / count) * count
    q, v = q + v * H + 0.5 * push * H * H, v + push * H  # the stop acts a cycle later
    assert abs(v) <= 3.0 + 2.5 * braking * H + count / H
    assert abs(q + math.copysign(v * v / (2.0 * braking), v)) <= 1.0 + 0.5 * count + 1e-9


def _farthest(q: float, v: float, push: float, braking: float, cycles: int = REACTION_CYCLES - 1) -> float:
    """Highest position when `push` goes on for some cycles and the axis brakes then."""
    t = cycles * H
    q, v = q + v * t + 0.5 * push * t * t, v + push * t
    return max(q, q + max(v, 0.0) ** 2 / (2.0 * braking))


@given(st.sampled_from(Sample._fields[1:6]), st.sampled_from([math.nan, math.inf, -math.inf]))
def test_what_is_no_number_stops(field: str, value: float) -> None:
    guard = begun()
    with pytest.raises(GuardStop):
        guard.check(sample(**{field: value}), STILL)


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_commands_that_are_no_number_stop(mode: Mode, value: float) -> None:
    with pytest.raises(GuardStop):
        begun(mode=mode).check(sample(), Command(value, value, value))
    with pytest.raises(GuardStop):
        begun(mode=mode).check(sample(), Command(torque_feedforward=value))


@pytest.mark.parametrize(
    ("measured", "command", "says"),
    [
        (sample(velocity=20.1), STILL, r"limits\.speed allows 20"),
        (sample(torque_command=1.35), STILL, r"torque demand is 1\.35.*limits\.torque allows 1\.34"),
        (sample(torque=-1.6), STILL, r"measured torque is -1\.6"),
        (sample(reference=0.16), STILL, r"limits\.following_error allows 0\.15"),
        (sample(temperature=81.0), STILL, r"temperature is 81.*cool down"),
        (sample(), Command(0.021), r"jump from 0 to 0\.021.*limits\.speed allows 0\.02"),
        (sample(), Command(torque_feedforward=1.4), r"torque offset is 1\.4"),
        (sample(), Command(25.0), r"next reference is 25.*limits\.position_max allows 20"),
        (sample(), Command(-25.0), r"limits\.position_min allows -20"),
    ],
)
def test_each_limit_is_named_with_value_place_and_advice(
    measured: Sample, command: Command, says: str
) -> None:
    with pytest.raises(GuardStop, match=says) as stop:
        begun().check(measured._replace(time=1.25), command)
    assert "experiment 'dahl' at 1.250 s" in str(stop.value)
    assert "; " in str(stop.value)
    assert stop.value.exit_code == 4


def test_just_inside_every_limit_passes() -> None:
    guard = begun()
    guard.check(sample(torque_command=1.34, torque=1.4, temperature=80.0), Command(0.0199))
    guard.check(sample(torque_command=-1.34, temperature=math.nan), Command(0.0398, 0.0, 0.0, 1.34))
    assert guard.elapsed == pytest.approx(2 * H)


def test_commanded_torque_is_held_in_torque_mode_only() -> None:
    begun(mode=Mode.POSITION).check(sample(), Command(torque=99.0))
    with pytest.raises(GuardStop, match=r"commanded torque is 1\.4"):
        begun(mode=Mode.TORQUE).check(sample(), Command(torque=0.7, torque_feedforward=0.7))
    with pytest.raises(GuardStop, match="commanded speed is 21"):
        begun(mode=Mode.VELOCITY).check(sample(), Command(velocity=21.0))


def last_passed(guard: Guard, samples: list[Sample], says: str) -> Sample:
    """The last sample that the guard let pass; it must stop with `says`."""
    passed = sample()

    def watch() -> None:
        nonlocal passed
        for now in samples:
            guard.check(now, STILL)
            passed = now

    with pytest.raises(GuardStop, match=says):
        watch()
    return passed


def test_following_error_is_stopped_before_it_is_reached() -> None:
    seen = [sample(position=-0.002 * k) for k in range(100)]
    assert 0.13 < -last_passed(begun(), seen, "following error").position < 0.15


def test_speed_is_stopped_before_it_is_reached() -> None:
    seen = [sample(position=0.15 * k * k * H, velocity=0.3 * k) for k in range(100)]
    assert 18.5 < last_passed(begun(mode=Mode.TORQUE), seen, "speed, soon too high").velocity < 20.0


def test_a_drive_that_reports_a_wrong_velocity_is_not_believed() -> None:
    speeds = [min(0.4 * k, 10.0) for k in range(200)]  # 400 rad/s², then 10 rad/s
    seen = [sample(position=q) for q in (np.cumsum(speeds) * H).tolist()]
    guard = begun(mode=Mode.TORQUE, position_max=1.0)
    # 10 rad/s needs 0.125 rad to stop, 0.02 to react, and may speed up a little meanwhile
    assert 0.80 < last_passed(guard, seen, "could stop only at").position < 0.855


def test_lost_cycles_lengthen_the_reaction() -> None:
    near = {"position": 0.96, "velocity": 2.0}  # stops in 5 mrad, reacts in 4
    begun(sample(**near), Mode.TORQUE, position_max=1.0).check(sample(**near), STILL)
    with pytest.raises(GuardStop, match="could stop only at"):
        begun(sample(**near), Mode.TORQUE, position_max=1.0).check(sample(**near, missed=20), STILL)


def test_machine_time_counts_lost_cycles_and_ends() -> None:
    guard = Guard(limits(), H, COUNT, seconds=0.0105)
    guard.begin(Mode.POSITION, sample())
    for _ in range(5):
        guard.check(sample(), STILL)
    guard.check(sample(missed=4), STILL)
    with pytest.raises(GuardStop, match="machine time"):
        guard.check(sample(), STILL)
    assert guard.elapsed == pytest.approx(11 * H)


def test_a_temperature_that_falls_silent_stops_and_one_that_never_was_does_not() -> None:
    guard = begun()
    for k in range(5000):
        guard.check(sample(time=k * H), STILL)
    for _ in range(10):
        guard.check(sample(temperature=30.0), STILL)
    for _ in range(1990):
        guard.check(sample(), STILL)
    guard.check(sample(temperature=30.0), STILL)
    for _ in range(2000):
        guard.check(sample(), STILL)
    with pytest.raises(GuardStop, match=r"temperature has been silent for 2\.0 s.*check sensor"):
        guard.check(sample(), STILL)


@pytest.mark.parametrize(
    ("at", "says"),
    [
        (sample(reference=5.0, position=0.0), r"the reference is 5 but the axis is at 0.*another master"),
        (sample(velocity=-6.0), r"as power comes on, the speed is -6"),
        (sample(velocity=math.nan), "speed is nan"),
    ],
)
def test_power_comes_on_at_rest_and_where_the_axis_is(at: Sample, says: str) -> None:
    with pytest.raises(GuardStop, match=says) as stop:
        begun(at)
    assert stop.value.blind  # nothing has to be braked yet, and who knows by which encoder


def test_the_speed_by_positions_counts_and_coarse_counts_do_not() -> None:
    """400 rad/s² while the drive reports nothing; then 19 rad/s on 2000 counts a revolution."""
    seen = [sample(position=0.2e-3 * k * k) for k in range(100)]
    last = last_passed(begun(mode=Mode.TORQUE), seen, "by its positions the speed")
    k = round(math.sqrt(last.position / 0.2e-3))
    assert 18.0 < 0.4 * k < 20.0
    count = 2.0 * math.pi / 2000.0
    guard = Guard(limits(), H, count)
    guard.begin(Mode.TORQUE, sample())
    way = 0.0
    for k in range(900):
        speed = min(0.3 * k, 19.0)
        way += speed * H
        guard.check(sample(position=round(way / count) * count, velocity=speed), STILL)


def test_an_axis_that_stands_outside_does_not_begin() -> None:
    with pytest.raises(GuardStop, match=r"stands at 21.*by hand"):
        begun(sample(position=21.0, reference=21.0))
