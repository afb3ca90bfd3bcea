"""An encoder that tells a part of the motion, and what one programme of a session learns for the next."""

from __future__ import annotations

import pickle
from dataclasses import replace

import pytest

from autotune.core.drive import Command, Mode
from autotune.core.errors import GuardStop
from autotune.experiments import momentum_watch
from autotune.experiments.guard import Guard
from autotune.experiments.inverse_estimate import Inverse
from autotune.experiments.momentum_watch import EXCESS_SECONDS, ExcessWatch, MomentumWatch, early_levels
from autotune.experiments.motion_watch import Learnt
from autotune.experiments.path import Motion
from autotune.experiments.programmes import build
from autotune.experiments.runner import Played, Programme
from autotune.experiments.sines import BenchmarkSine
from tests.experiments.hurt_axis import Hurt, HurtDrive
from tests.experiments.support import axis, sample

AXIS = axis()
LIMITS = AXIS.limits
COUNT, H = AXIS.position_resolution, AXIS.cycle
SINE = BenchmarkSine(Motion.of(AXIS), repeats=1, periods=6)
INERTIA, FRICTION = 6.66e-4, 0.33
KNOWN = Inverse(FRICTION, -FRICTION, 20, INERTIA, 0.8 * INERTIA, 1.2 * INERTIA, 5.0, 5.0)


def play(drive: HurtDrive, *experiments: BenchmarkSine, learnt: Learnt | None = None) -> Played:
    return Programme(experiments, drive.axis.limits, 900.0, learnt)(drive, lambda row, label, repeat: None)


@pytest.mark.parametrize("at", [4.27, 5.0, 5.4])
def test_an_encoder_that_begins_to_tell_a_tenth_is_caught_below_the_speed_limit(at: float) -> None:
    """A sine hardly shows the inertia; what gives the encoder away is torque that was never needed before."""
    drive = HurtDrive(AXIS, hurt=Hurt("scaled", at, 0.1))
    with pytest.raises(GuardStop, match="encoder"):
        play(drive, SINE)
    assert drive.fastest < LIMITS.speed
    assert drive.time - at < 0.2


@pytest.mark.parametrize("at", [0.05, 0.2, 0.27])
def test_what_was_learnt_catches_a_dead_encoder_before_the_first_reversal(at: float) -> None:
    learnt = play(HurtDrive(AXIS), *build("high-speed", AXIS), SINE).learnt
    assert learnt is not None
    knowing, new = (HurtDrive(AXIS, hurt=Hurt("frozen", at)) for _ in range(2))
    for drive, known in ((knowing, learnt), (new, None)):
        with pytest.raises(GuardStop, match="encoder"):
            play(drive, SINE, learnt=known)
    assert knowing.fastest <= new.fastest
    assert knowing.fastest < 0.5 * LIMITS.speed


def test_what_was_learnt_travels_to_the_cyclic_process_and_is_not_changed_by_its_use() -> None:
    learnt = play(HurtDrive(AXIS), SINE).learnt
    assert learnt is not None
    before = learnt.estimate.inverse
    programme = pickle.loads(pickle.dumps(Programme((SINE,), LIMITS, 900.0, learnt)))
    played = programme(HurtDrive(AXIS), lambda row, label, repeat: None)
    assert learnt.estimate.inverse == before
    assert played.learnt.estimate.inverse.strokes > before.strokes


def test_what_was_learnt_with_other_limits_means_nothing() -> None:
    learnt = play(HurtDrive(AXIS), SINE).learnt
    other = Guard(axis(deceleration=0.5 * LIMITS.deceleration).limits, H, COUNT, learnt=learnt)
    assert other.learnt.estimate.inverse == Inverse()
    assert Guard(LIMITS, H, COUNT, learnt=learnt).learnt.estimate.inverse.strokes > 0


def missing(watch: MomentumWatch, torque: float, shown: float, cycles: int = 60) -> tuple[float, float]:
    """Pushes a mass for some cycles; what is said to be missing [rad/s], and how fast the mass is by then.

    Args:
        shown: share of the motion that the encoder tells.
    """
    position = speed = 0.0
    watch.begin(0.0)
    for _ in range(cycles):
        speed += (torque - FRICTION) / INERTIA * H
        position += speed * H
        told = round(shown * position / COUNT) * COUNT
        if short := watch.check(told, torque, H, missed=False):
            return short, speed
    return 0.0, speed


def test_a_tenth_of_the_motion_is_missed_soon_and_all_of_it_never() -> None:
    watch = MomentumWatch(LIMITS, H, COUNT)
    assert missing(watch, 1.0, 0.1)[0] == 0.0  # nothing is known yet
    watch.know(KNOWN, 0.0)
    short, speed = missing(watch, 1.0, 0.1)
    assert short > 0.0
    assert speed < 0.6 * LIMITS.speed
    assert missing(watch, 1.0, 1.0, cycles=15)[0] == 0.0


def test_friction_that_grows_beyond_the_speeds_that_were_seen_is_no_loss() -> None:
    """Regression: an axis with a nonlinear viscous friction was stopped at its first fast stroke (seed 1503)."""
    watch = MomentumWatch(LIMITS, H, COUNT)
    watch.know(KNOWN, 0.0)
    assert glides(watch, 8.0) == 0.0
    assert glides(watch, 3.0) != 0.0


def glides(watch: MomentumWatch, speed: float) -> float:
    """What is missing of an axis that needs three times its friction to go on at `speed`."""
    watch.begin(0.0)
    watch.check(0.0, 0.0, H, missed=True)
    for k in range(1, 60):
        if short := watch.check(speed * k * H, 3.0 * FRICTION, H, missed=k == 1):
            return short
    return 0.0


def test_a_velocity_that_leaps_needs_nothing_to_be_known() -> None:
    watch = MomentumWatch(LIMITS, H, COUNT)
    speed = 25.0 * LIMITS.deceleration * H
    for k in range(10):
        assert watch.check(speed * k * H, 0.3, H, missed=k < 2) == 0.0
    assert watch.check(speed * 9 * H, 0.3, H, missed=False) != 0.0
    assert watch.doubtful


@pytest.mark.parametrize("known", [True, False])
def test_what_gains_against_the_torque_counts_the_wrong_way(known: bool) -> None:
    """Its controller drives it with all it has; 22 rad/s of 14.4 before."""
    watch = MomentumWatch(LIMITS, H, COUNT)
    if known:
        watch.know(KNOWN, 0.0)
    else:
        watch.suppose(1.1, 1.1)
    short, speed = missing(watch, 1.3, -1.0)
    assert short > 0.0
    assert speed < 0.5 * LIMITS.speed
    assert watch.doubtful


def test_an_axis_that_is_braked_hard_has_gained_nothing() -> None:
    watch = MomentumWatch(LIMITS, H, COUNT)
    watch.suppose(1.1, 1.1)
    watch.begin(0.0)
    position, speed = 0.0, 12.0
    while speed > 0.0:
        position += speed * H
        assert watch.check(round(position / COUNT) * COUNT, -1.3, H, missed=False) == 0.0
        speed -= (1.3 + FRICTION) / INERTIA * H
    assert not watch.doubtful


def test_torque_is_excess_only_where_the_reference_does_not_ask_for_it() -> None:
    watch = ExcessWatch(2.0 * INERTIA)
    watch.know(0.7, 0.7)
    for _ in range(600):
        assert not watch.check(0.0, 0.1, H)
    asked = 0.0
    for k in range(30):  # 1000 rad/s² are asked for
        asked += 1000.0 * k * H * H
        assert not watch.check(asked, 1.2, H)
    watch.begin(0.0)
    short = round(EXCESS_SECONDS / H)
    said = [watch.check(0.0, -1.2, H) for _ in range(short + 2)]
    assert not any(said[:short])
    assert said[-1]


def test_a_torque_limit_met_in_the_cycle_in_which_the_encoder_died_is_a_blind_stop() -> None:
    """Regression: 48.9 rad/s of 18.1, as the axis was then braked by its dead encoder (seed 1567)."""
    guard = Guard(LIMITS, H, COUNT)
    guard.begin(Mode.POSITION, sample())
    place = 0.0
    for k in range(1, 200):
        speed = min(0.2 * k, 10.0)
        place += speed * H
        guard.check(
            sample(time=k * H, position=place, reference=place, velocity=speed, torque_command=0.3),
            Command(position=place),
        )
    dead = sample(
        time=0.2, position=place, reference=place + speed * H, velocity=0.8 * speed, torque_command=9.0
    )
    with pytest.raises(GuardStop, match="torque demand") as stop:
        guard.check(dead, Command(position=place))
    assert stop.value.blind


def test_a_torque_that_rises_suddenly_needs_less_missing_than_a_push_that_comes_slowly(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An encoder of a tenth lets its loop swing; who leans on the table gets more torque too, but slowly."""
    must = 1.25 * FRICTION + 0.03 * LIMITS.torque

    def stopped(rise: float) -> int:
        """Cycles until a torque that comes in so many seconds, without the speed that belongs to it, is told."""
        watch = MomentumWatch(LIMITS, H, COUNT)
        watch.know(Inverse(FRICTION, -FRICTION, 20, INERTIA, 0.5 * INERTIA, 2.4 * INERTIA, 5.0, 5.0), 0.0)
        for k in range(600):
            torque = 0.5 * FRICTION + min(max(k * H - 0.1, 0.0) / rise, 1.0) * (must + 0.3 - 0.5 * FRICTION)
            if watch.check(0.3 * k * H, torque, H, False):
                return k
        return 600

    suddenly, slowly = stopped(0.016), stopped(0.3)
    monkeypatch.setattr(momentum_watch, "HINT", momentum_watch.SHORT)
    assert suddenly < 140  # 40 ms after it began
    assert suddenly < stopped(0.016)
    assert slowly == stopped(0.3)


def test_a_swing_does_not_teach_what_it_needs() -> None:
    """Regression: 18.8 rad/s of 12.9, as the first window of a swing raised what slides the axis (seed 9089892)."""
    knows = Inverse(FRICTION, -FRICTION, 20, INERTIA, 0.5 * INERTIA, 2.4 * INERTIA, 5.0, 5.0)
    learns = replace(knows, up=2.0 * FRICTION)

    def stopped(taught: int) -> int:
        """Cycles until a swing is told that begins at 1200, where more was seen to slide the axis in cycle `taught`."""
        watch = MomentumWatch(LIMITS, H, COUNT)
        for k in range(1400):
            watch.know(knows if k < taught else learns, 0.0)
            rise = min(max(k - 1200, 0) / 16.0, 1.0)
            if watch.check(0.3 * k * H, 0.5 * FRICTION + 1.7 * FRICTION * rise, H, False):
                return k
        return 1400

    never, swing, before = stopped(2000), stopped(1212), stopped(10)
    assert never < 1240
    assert swing <= never
    assert before == 1400


def test_a_velocity_that_no_force_can_have_changed_is_not_braked_by() -> None:
    """Regression: 21.6 rad/s of 13.8, as a torque limit was met just after the encoder told a tenth (seed 1224935)."""

    def doubtful(lost: float, torque: float) -> bool:
        """Whether an axis at 4 rad/s is doubted that loses so much velocity in one cycle."""
        watch = MomentumWatch(LIMITS, H, COUNT)
        watch.know(KNOWN, 0.0)
        position = 0.0
        for k in range(50):
            position += (4.0 if k < 40 else 4.0 - lost) * H
            assert watch.check(position, torque if k == 40 else FRICTION, H, False) == 0.0
            if watch.doubtful:
                return True
        return False

    assert doubtful(3.0, FRICTION)
    assert not doubtful(2.0, -LIMITS.torque)  # full torque may have taken that
    assert not doubtful(0.6 / INERTIA * H, FRICTION)  # so may a load that comes at once


def test_what_the_first_strokes_need_is_known_where_the_axis_has_slid_and_not_where_it_crept() -> None:
    limit = LIMITS.torque
    slid = Inverse(up=0.4, fast_up=1.0)
    assert early_levels(slid, 0.0, LIMITS) == pytest.approx((0.4 + 0.4 * limit, 0.4 + 0.4 * limit))
    both = replace(slid, down=-0.2, fast_down=1.0)
    assert early_levels(both, -0.3, LIMITS) == pytest.approx((0.4 + 0.4 * limit, 0.3 + 0.4 * limit))
    assert early_levels(replace(slid, fast_up=0.01), 0.0, LIMITS) == (float("inf"), float("inf"))


def test_in_the_first_strokes_what_is_known_counts_at_once_and_so_does_that_it_is_not() -> None:
    """Regression: an axis that crept at rest was held to have slid, and stopped as its friction built up."""
    watch = ExcessWatch(1e-3)
    watch.know(0.5, 0.5, early=True)
    pushes = [watch.check(0.0, 0.6, H) for _ in range(10)]
    assert pushes.index(True) == round(EXCESS_SECONDS / H)
    watch.begin(0.0)
    watch.know(float("inf"), float("inf"), early=True)
    assert not any(watch.check(0.0, 1.3, H) for _ in range(500))


@pytest.mark.parametrize("at", [0.3, 0.7])
def test_a_tenth_in_the_first_second_of_a_session_is_caught(at: float) -> None:
    """Regression: 19.5 rad/s of 13.1 (seed 1225387)."""
    drive = HurtDrive(AXIS, hurt=Hurt("scaled", at, 0.1))
    with pytest.raises(GuardStop):
        play(drive, SINE)
    assert drive.fastest < LIMITS.speed
    assert drive.time - at < 0.2
