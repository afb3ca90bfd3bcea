"""Torque and encoder against each other: a dead encoder is caught, ordinary axes are left alone.

The axis here is independent of the simulator; its controller is deceived as the guard is, and what counts
is the truth.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from autotune.core.axis import Axis
from autotune.core.drive import Command, Mode
from autotune.core.errors import GuardStop
from autotune.experiments.experiment import Experiment
from autotune.experiments.fine_inertia import FineInertia
from autotune.experiments.guard import Guard
from autotune.experiments.inverse_estimate import Inverse, InverseEstimate
from autotune.experiments.motion_watch import FIRST_MAY, LIGHT, Learnt, MotionWatch
from autotune.experiments.path import Motion
from autotune.experiments.presliding import Presliding
from autotune.experiments.programmes import build
from autotune.experiments.runner import Programme
from autotune.experiments.sines import BenchmarkSine
from autotune.experiments.virtual_axes import VirtualAxes
from tests.experiments.hurt_axis import Hurt, HurtDrive, Mass
from tests.experiments.support import axis, sample

AXIS = axis()
MOTION = Motion.of(AXIS)
H, COUNT = AXIS.cycle, AXIS.position_resolution
SINE = BenchmarkSine(MOTION, repeats=1, periods=3)
SETS = Presliding(MOTION, sets=2)


def played(drive: HurtDrive, *experiments: Experiment) -> HurtDrive:
    Programme(experiments, drive.axis.limits, 900.0)(drive, lambda sample, label, repeat: None)
    return drive


def stopped(drive: HurtDrive, *experiments: Experiment) -> str:
    """Why the guard stopped it."""
    with pytest.raises(GuardStop) as stop:
        played(drive, *experiments)
    assert not drive.powered
    return str(stop.value)


@pytest.mark.parametrize("kind", ["frozen", "dithering"])
@pytest.mark.parametrize("at", [0.0, 0.2, 0.9, 1.0, 1.23])
def test_a_dead_encoder_in_position_mode_is_caught_below_the_speed_limit(kind: str, at: float) -> None:
    """219 rad/s and 70 rad before this was watched; the following error alone is no watch."""
    drive = HurtDrive(AXIS, hurt=Hurt(kind, at, COUNT))
    said = stopped(drive, SINE)
    assert "encoder" in said
    assert drive.fastest < AXIS.limits.speed
    assert drive.farthest < 1.0
    assert drive.time - at < 0.12


@pytest.mark.parametrize("at", [0.5, 1.7, 3.0, 5.0])
def test_a_dead_encoder_while_presliding_is_prepared_is_caught(at: float) -> None:
    """722 rad before. At 5 s the torque creeps between what slides and what may stick: see docs/safety.md."""
    drive = HurtDrive(AXIS, hurt=Hurt("frozen", at))
    stopped(drive, SETS)
    assert drive.fastest < 1.25 * AXIS.limits.speed
    assert drive.farthest < 1.0
    assert drive.time - at < 0.15


@pytest.mark.parametrize("at", [8.0, 11.0, 13.9])
def test_sets_of_an_encoder_that_died_in_torque_mode_are_not_kept(at: float) -> None:
    """Nothing moves and nothing is dangerous meanwhile; afterwards the axis has to move, and cannot show it."""
    drive = HurtDrive(AXIS, hurt=Hurt("frozen", at))
    assert "encoder" in stopped(drive, SETS)
    assert drive.fastest < 0.5 * AXIS.limits.speed


@pytest.mark.parametrize("at", [8.5, 11.5])
def test_sets_of_an_encoder_that_tells_a_tenth_of_them_are_not_kept(at: float) -> None:
    """A tenth of a bent junction is no silence; but the sets before gave way ten times as far."""
    drive = HurtDrive(AXIS, hurt=Hurt("scaled", at, 0.1))
    assert "encoder" in stopped(drive, SETS)
    assert drive.fastest < AXIS.limits.speed


@pytest.mark.parametrize("rate", [0.4, 0.8, 8.0])
def test_an_encoder_that_dies_while_the_axis_holds_is_caught_below_the_speed_limit(rate: float) -> None:
    """50.7 rad/s before: a reference that rests asks for no motion, but the controller's integrator does."""
    programme = Programme((*build("high-speed", AXIS), SINE), AXIS.limits, 900.0)
    learnt = programme(HurtDrive(AXIS), lambda sample, label, repeat: None).learnt
    mass, guard = Mass(), Guard(AXIS.limits, H, COUNT, learnt=learnt)
    guard.begin(Mode.POSITION, sample(torque_command=0.1))

    def hold() -> None:
        for k in range(3000):
            torque = min(0.1 + rate * k * H, AXIS.limits.torque)
            guard.check(sample(time=k * H, torque_command=torque), Command())
            mass.advance(torque, k * H, H)

    with pytest.raises(GuardStop, match="encoder") as stop:
        hold()
    assert stop.value.blind
    assert abs(mass.velocity) < AXIS.limits.speed


def test_an_axis_is_called_too_heavy_only_where_large_and_small_motion_say_so() -> None:
    """Friction that builds up over every stroke looks like inertia, as often as it is played."""
    limits, order = AXIS.limits, AXIS.limits.torque / AXIS.limits.deceleration

    class Large(InverseEstimate):
        """Says the same whatever it sees."""

        def add(self, position: float, torque: float, cycle: float) -> bool:
            self.inverse = Inverse(0.3, -0.3, 20, 4.0 * order, 3.0 * order, 5.0 * order, 1.0, 1.0)
            return True

    def heavy(fine: float) -> str:
        small = FineInertia(limits.torque, H, COUNT)
        small.inertia = fine
        learnt = Learnt((limits, H, COUNT), Large(limits, H, COUNT), 0.0, small)
        watch = MotionWatch(limits, H, COUNT, learnt)
        return next((why for k in range(20) if (why := watch.check(1e-3 * k, 1e-3 * k, 0.3, H))), "")

    assert "brakes with" in heavy(3.5 * order)
    assert heavy(0.8 * order) == ""


@pytest.mark.parametrize("at", [None, 0.38, 0.42])
def test_what_an_axis_broke_loose_at_holds_it_before_anything_slid_it_there(at: float | None) -> None:
    """Regression: a sound axis with friction of 0.37 of the limit and coarse counts, stopped in its first reversal."""
    coarse = AXIS.mechanics.model_copy(update={"counts_per_revolution": 3842})
    file = axis(deceleration=1000.0).model_copy(update={"mechanics": coarse})
    drive = HurtDrive(
        file,
        Mass(inertia=2e-4, friction=0.5, gravity=-0.08, bends=4e-3),
        Hurt("frozen", at) if at is not None else None,
        gains=(18.0, 0.03, 1080.0),
    )
    if at is None:
        played(drive, SINE)
    else:
        assert "encoder" in stopped(drive, SINE)
    assert drive.fastest < AXIS.limits.speed


def test_a_lazy_axis_that_is_no_longer_pushed_begins_anew() -> None:
    """Regression: the push of a loop that swung was held against where an earlier push had begun."""
    way = VirtualAxes()
    way.may, way.must, way.lightest, way.heaviest = 0.5, 1.0, 1e-3, 1e-2
    assert not way.lazy(1.2, 0.0, 0.0, COUNT, H)
    assert way.lazy(1.2, -0.1, 0.0, COUNT, H)  # one push: it has gone the other way meanwhile
    way.idle()
    assert not way.lazy(1.2, -0.1, 0.0, COUNT, H)


def test_a_torque_that_wound_up_unseen_does_not_run_away_in_torque_mode() -> None:
    """u₀ of three times the friction and an encoder that tells nothing: the 831 rad of the attack."""
    guard = Guard(AXIS.limits, AXIS.cycle, COUNT)
    guard.begin(Mode.TORQUE, sample(torque_command=0.05))
    unseen = 0

    def push() -> None:
        nonlocal unseen
        for unseen in range(1000):
            torque = 0.05 + (0.9 if unseen else 0.0)
            guard.check(sample(time=unseen * 1e-3, torque_command=torque), Command(torque=torque))

    with pytest.raises(GuardStop, match="encoder"):
        push()
    assert 0.5 * (0.95 - 0.33) / 6.66e-4 * (unseen * 1e-3) ** 2 < 0.2  # rad, of ±20


@pytest.mark.parametrize(
    ("kind", "size"), [("reversed", 0.0), ("jumped", 0.05), ("jumped", -0.5), ("scaled", 10.0)]
)
def test_what_an_encoder_makes_up_is_a_speed_and_stops(kind: str, size: float) -> None:
    drive = HurtDrive(AXIS, hurt=Hurt(kind, 1.0, size))
    stopped(drive, SINE)
    assert drive.fastest < AXIS.limits.speed


def test_an_encoder_that_tells_a_tenth_makes_the_axis_too_heavy_for_its_deceleration() -> None:
    drive = HurtDrive(AXIS, hurt=Hurt("scaled", 0.0, 0.1))
    stopped(drive, SINE)
    assert drive.time < 0.6  # five seconds at 36 rad/s before, and nothing was said
    heavy = axis(deceleration=8000.0)
    assert "brakes with" in stopped(HurtDrive(heavy), *build("high-speed", heavy), SINE)


@pytest.mark.parametrize("part", [0.45, 0.6, 0.9])
def test_a_load_that_pushes_in_torque_mode_does_not_break_the_speed_limit(part: float) -> None:
    """24.5 rad/s before, and the torque was repeated for 100 ms after the axis had drifted away."""
    push = part * AXIS.limits.torque
    drive = HurtDrive(AXIS, mass=Mass(load=lambda time: -push if time > 9.6 else 0.0))
    with suppress(GuardStop):
        played(drive, SETS)
    assert drive.fastest < AXIS.limits.speed


@pytest.mark.parametrize("factor", [10.0, 0.1, -1.0, 0.0])
def test_a_velocity_in_another_unit_is_refused_in_words(factor: float) -> None:
    drive = HurtDrive(AXIS, velocity_factor=factor)
    assert "unit of velocity" in stopped(drive, SINE)
    assert drive.fastest < AXIS.limits.speed


@given(
    pushes=st.lists(st.tuples(st.floats(-1.0, 1.0), st.integers(1, 300)), min_size=1, max_size=10),
    near=st.floats(-0.9, 0.9),
)
@example(pushes=[(-0.5470828039702588, 143)], near=0.8984375)  # nearly full speed at the end of the travel
@settings(max_examples=150, deadline=None)
def test_what_runs_unseen_keeps_speed_and_travel(pushes: list[tuple[float, int]], near: float) -> None:
    """Nothing is known yet, the encoder is dead, the torque does what it likes: the argument of docs/safety.md.

    The mass is the lightest and the friction the least that the guard assumes before it knows more.
    """
    limits = axis(position_min=-1.0, position_max=1.0).limits
    inertia, friction = LIGHT * limits.torque / limits.deceleration, FIRST_MAY * limits.torque
    guard = Guard(limits, AXIS.cycle, COUNT)
    guard.begin(Mode.TORQUE, sample(position=near, reference=near))
    q, v, h, torque = near, 0.0, AXIS.cycle, 0.0
    for torque in (part * limits.torque for part, cycles in pushes for _ in range(cycles)):
        try:
            guard.check(sample(position=near, torque_command=torque), Command(torque=torque))
        except GuardStop:
            break
        q, v = slid(q, v, torque / inertia, friction / inertia, h)
    q, v = slid(q, v, torque / inertia, friction / inertia, h)  # the stop acts a cycle later
    assert abs(v) <= limits.speed + 2.0 * limits.torque / inertia * h
    assert abs(q + math.copysign(v * v / (2.0 * limits.deceleration), v)) <= 1.0 + 2.0 * limits.speed * h


def slid(q: float, v: float, push: float, holds: float, h: float) -> tuple[float, float]:
    """One cycle of a mass under dry friction."""
    if v == 0.0 and abs(push) <= holds:
        return q, v
    direction = math.copysign(1.0, v if v else push)
    faster = v + (push - direction * holds) * h
    if v and faster * v <= 0.0:
        faster = 0.0
    return q + 0.5 * (v + faster) * h, faster


CASES = {
    "light friction": (Mass(friction=0.01, viscous=0.01), {}),
    "much friction": (Mass(friction=0.7), {}),
    "sticks": (Mass(sticks=1.5, bends=5e-4), {}),
    "hangs": (Mass(gravity=0.5, friction=0.2), {}),
    "light": (Mass(inertia=1e-4, friction=0.05), {"gains": (10.0, 0.03, 600.0)}),
    "heavy": (Mass(inertia=2.5e-3), {}),
    "coarse": (Mass(), {"counts": 2000, "gains": (40.0, 0.05, 2000.0)}),
    "no integral": (Mass(), {"gains": (60.0, 0.15, 0.0)}),
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_ordinary_axes_are_never_stopped(name: str) -> None:
    mass, change = CASES[name]
    where = AXIS
    if "counts" in change:
        mechanics = AXIS.mechanics.model_copy(update={"counts_per_revolution": change["counts"]})
        where = AXIS.model_copy(update={"mechanics": mechanics})
    motion = Motion.of(where)
    drive = HurtDrive(where, mass=mass, gains=change.get("gains", (60.0, 0.15, 6000.0)))
    what = (BenchmarkSine(motion, 1, 3), *build("high-speed", where))
    assert played(drive, *what).time >= 0.99 * sum(one.duration for one in what)  # to the end, not stopped


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(CASES))
def test_ordinary_axes_are_never_stopped_in_a_whole_identification(name: str) -> None:
    mass, change = CASES[name]
    drive = HurtDrive(AXIS, mass=mass, gains=change.get("gains", (60.0, 0.15, 6000.0)))
    what = (BenchmarkSine(MOTION, 1, 3), *build("identification", AXIS))
    assert played(drive, *what).time >= 0.99 * sum(one.duration for one in what)  # to the end, not stopped


def test_a_linear_axis_is_never_stopped() -> None:
    where = linear()
    drive = HurtDrive(where, mass=Mass(20.0, 30.0, 1.2, 40.0, 0.0, 2e-5, vs=2e-3), gains=(4e5, 4e3, 8e6))
    played(drive, BenchmarkSine(Motion.of(where), 1, 3), *build("high-speed", where))
    assert 0.009 < drive.farthest < 0.25


def linear() -> Axis:
    """20 kg on a screw, 0.5 µm."""
    return Axis.model_validate(
        {
            "schema": 1, "name": "table", "link": "sim://x", "profile": "x", "motion_unit": "m",
            "mechanics": {"counts_per_metre": 2e6},
            "limits": {
                "position_min": -0.25, "position_max": 0.25, "speed": 0.5, "torque": 400.0, "temperature": 80.0,
                "following_error": 2e-3, "deceleration": 8.0, "machine_seconds": 900.0,
            },
            "benchmark": {"amplitude": 0.01, "frequency": 1.0},
            "reference": {"filter": 0.8},
        }
    )  # fmt: skip


def test_missed_cycles_and_seeds_of_noise_do_no_harm() -> None:
    rng = np.random.default_rng(1)
    guard = Guard(AXIS.limits, AXIS.cycle, COUNT)
    guard.begin(Mode.POSITION, sample())
    time = 0.0
    for _ in range(3000):
        missed = int(rng.integers(0, 3)) if rng.random() < 0.05 else 0
        time += (1 + missed) * AXIS.cycle
        q, v = 0.2 * math.sin(6.28 * time), 1.256 * math.cos(6.28 * time)
        q = round((q + rng.normal(0.0, COUNT)) / COUNT) * COUNT
        torque = 0.05 + math.copysign(0.33, v) + rng.normal(0.0, 0.02)
        guard.check(sample(time=time, position=q, reference=q, velocity=v, torque_command=torque, missed=missed),
                    Command(q))  # fmt: skip
    assert guard.elapsed == pytest.approx(time, abs=2.0 * AXIS.cycle)
