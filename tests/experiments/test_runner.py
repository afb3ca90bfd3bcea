"""Programmes on drives that obey and on drives that fail: the axis ends without power in every case."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.control.feedforward import FixedFeedforward, LugreParameters
from autotune.core.drive import HOLD, Command, Mode, Sample
from autotune.core.errors import (
    AutotuneError,
    ConfigurationError,
    DriveFault,
    GuardStop,
    LinkTimeout,
    NotEnoughExcitation,
)
from autotune.core.loop import LocalLoop
from autotune.experiments.experiment import Experiment, Needs
from autotune.experiments.path import Mark, Motion, Steps, Switch
from autotune.experiments.presliding import Presliding, PreslidingResult
from autotune.experiments.programmes import build
from autotune.experiments.record import Progress, Recorder, metadata_for, play
from autotune.experiments.runner import Budget, Programme
from autotune.experiments.sines import AdaptiveSine, BenchmarkSine
from autotune.recordings.recording import Controller
from tests.experiments.support import FollowingDrive, axis

AXIS = axis()
MOTION = Motion.of(AXIS)
SINE = BenchmarkSine(MOTION, repeats=2, periods=2)


def programme(*experiments: Experiment, seconds: float = 300.0) -> Programme:
    return Programme(experiments or (SINE,), AXIS.limits, seconds)


def recorder(of: Programme) -> Recorder:
    return Recorder(metadata_for(AXIS, Controller(60.0, 0.15, 6000.0)), of.labels)


def test_a_programme_is_played_recorded_and_power_is_off_afterwards() -> None:
    drive, what = FollowingDrive(position=1.0), programme()
    rows = recorder(what)
    played = play(LocalLoop(drive), what, rows)
    recording = rows.recording()
    assert drive.calls[0] == "enable position"
    assert drive.calls[-1] == "disable"
    assert not drive.powered
    assert drive.commands[0] == HOLD or math.isnan(drive.commands[0].position)
    assert [part.name for part in played.experiments] == ["benchmark"]
    assert len(recording) == drive.cycles == played.experiments[0].samples
    assert played.machine_seconds == pytest.approx(len(recording) * 1e-3, abs=2e-3)
    assert rows.machine_seconds == pytest.approx(len(recording) * 1e-3)
    labels = [(s.experiment, s.repeat) for s in recording.segments()]
    assert labels == [("conditioning", 0), ("benchmark", 0), ("benchmark", 1), ("conditioning", 0)]
    assert recording.metadata.controller == Controller(60.0, 0.15, 6000.0)
    assert recording.metadata.fingerprint == AXIS.fingerprint
    assert np.all(np.diff(recording["time"]) > 0)


def test_a_programme_travels_to_another_process() -> None:
    law = FixedFeedforward(LugreParameters(6.66e-4, 4.13e-3, 0.33, 40.0, 0.1, 0.05, 0.33), 1e-3)
    what = programme(*build("identification", AXIS), BenchmarkSine(MOTION, 1, 2, law))
    what.check(1e-3)
    there = pickle.loads(pickle.dumps(what))
    assert there.labels == what.labels
    assert there.duration == pytest.approx(what.duration)


def test_consecutive_experiments_stay_powered_and_continuous() -> None:
    drive, what = FollowingDrive(), programme(SINE, *build("dahl", AXIS))
    play(LocalLoop(drive), what, recorder(what))
    assert [call for call in drive.calls if call.startswith("enable")] == ["enable position"]
    positions = np.array([command.position for command in drive.commands[1:]])
    assert np.abs(np.diff(positions)).max() < 2e-3


@dataclass(frozen=True)
class Modes(Experiment):
    """Position, torque, position; a few cycles each."""

    first: Mode = Mode.POSITION

    @property
    def name(self) -> str:
        return "modes"

    @property
    def mode(self) -> Mode:
        return self.first

    @property
    def labels(self) -> tuple[str, ...]:
        return ("modes",)

    @property
    def duration(self) -> float:
        return 0.3

    def needs(self, limits: object) -> Needs:
        return Needs(0.0, 0.0, 0.0, 0.0, 0.0)

    def run(self, start: Sample) -> Steps:
        sample = yield Mark("modes", 0)
        assert sample is start
        sample = yield Command(start.reference)
        sample = yield Switch(Mode.TORQUE, 0.1)
        for _ in range(3):
            sample = yield Command(torque=0.1)
        sample = yield Switch(Mode.POSITION)
        assert (yield Switch(Mode.POSITION)) is sample
        yield Command(sample.reference)
        return "done"


def test_modes_are_switched_at_rest_without_power_and_torque_starts_at_once() -> None:
    drive, what = FollowingDrive(), programme(Modes(MOTION))
    rows = recorder(what)
    played = play(LocalLoop(drive), what, rows)
    assert drive.calls[:5] == [
        "enable position", "disable", "enable torque", "disable", "enable position"
    ]  # fmt: skip
    first_in_torque = next(c for c in drive.commands if c.torque)
    assert math.isnan(first_in_torque.position)
    assert first_in_torque.torque == 0.1
    # at rest before power goes: the last command, a tenth of a second long
    assert [c.torque for c in drive.commands].count(0.1) == 1 + 3  # never repeated afterwards
    assert played.result("modes") == "done"
    assert len(rows.recording()) == drive.cycles


def test_an_experiment_in_another_mode_is_switched_to() -> None:
    drive, what = FollowingDrive(), programme(SINE, Modes(MOTION, Mode.TORQUE), SINE)
    play(LocalLoop(drive), what, recorder(what))
    enables = [call for call in drive.calls if call.startswith("enable")]
    assert enables == ["enable position", "enable torque", "enable position"]


FAULTS: list[tuple[AutotuneError, type[AutotuneError]]] = [
    (DriveFault("following error too large", 0x8611), DriveFault),
    (LinkTimeout("no answer within 20 ms"), LinkTimeout),
]


@pytest.mark.parametrize(("fault", "kind"), FAULTS)
@given(cycle=st.integers(1, 5000))
@settings(max_examples=8, deadline=None)
def test_a_fault_at_any_cycle_takes_power_off_and_keeps_the_rows(
    fault: AutotuneError, kind: type[AutotuneError], cycle: int
) -> None:
    drive, what = FollowingDrive(), programme()
    drive.faulty_at[cycle] = fault
    rows = recorder(what)
    with pytest.raises(kind):
        play(LocalLoop(drive), what, rows)
    assert not drive.powered
    assert "disable" in drive.calls
    assert len(rows.recording()) == cycle - 1


def test_ctrl_c_takes_power_off_too() -> None:
    drive, what = FollowingDrive(), programme()
    drive.faulty_at[2000] = KeyboardInterrupt()  # type: ignore[assignment]
    rows = recorder(what)
    with pytest.raises(KeyboardInterrupt):
        play(LocalLoop(drive), what, rows)
    assert not drive.powered
    assert len(rows.recording()) == 1999


@pytest.mark.parametrize(
    ("bent", "says"),
    [
        ({"position": 19.9995, "velocity": 1.0}, "could stop only at"),
        ({"reference": 0.5}, "following error"),
        ({"torque_command": 2.0}, "torque demand"),
        ({"temperature": 90.0}, "temperature"),
        ({"position": math.nan}, "not a finite number"),
    ],
)
def test_the_guard_stops_before_the_next_command_is_sent(bent: dict[str, float], says: str) -> None:
    drive, what = FollowingDrive(), programme()
    drive.bent[3000] = bent
    rows = recorder(what)
    with pytest.raises(GuardStop, match=says) as stop:
        play(LocalLoop(drive), what, rows)
    assert "experiment 'benchmark' at" in str(stop.value)
    assert drive.cycles == 3000
    assert not drive.powered
    assert len(rows.recording()) == 3000


def test_if_power_cannot_be_taken_off_both_errors_are_told() -> None:
    drive = FollowingDrive()
    drive.faulty_at[100] = DriveFault("over-current")
    drive.disable_fails = True
    with pytest.raises(DriveFault, match="over-current") as fault:
        programme()(drive, lambda sample, label, repeat: None)
    assert any("emergency stop" in note for note in fault.value.__notes__)


def test_nothing_moves_when_limits_are_too_small() -> None:
    small = axis(position_min=-0.1, position_max=0.1)
    drive = FollowingDrive()
    with pytest.raises(ConfigurationError, match=r"limits\.position_min"):
        Programme((SINE,), small.limits, 300.0)(drive, lambda sample, label, repeat: None)
    assert "enable position" not in drive.calls


def test_nothing_moves_without_enough_machine_time_or_at_another_cycle() -> None:
    drive = FollowingDrive()
    with pytest.raises(ConfigurationError, match=r"would take 6 s of machine time, but only 3 s are left"):
        programme(seconds=3.0)(drive, lambda sample, label, repeat: None)
    with pytest.raises(ConfigurationError, match=r"cycle of 0\.001 s, but the drive's is 0\.002 s"):
        programme()(FollowingDrive(period=2e-3), lambda sample, label, repeat: None)
    assert drive.calls == []


def test_an_axis_outside_of_its_travel_is_not_moved() -> None:
    drive = FollowingDrive(position=25.0)
    with pytest.raises(GuardStop, match="stands at 25"):
        programme()(drive, lambda sample, label, repeat: None)
    assert drive.cycles == 0
    assert not drive.powered


def test_a_budget_is_spent() -> None:
    budget = Budget(300.0).spend(110.5).spend(100.0)
    assert budget.left == pytest.approx(89.5)
    assert budget.spend(1000.0).left == 0.0


def test_progress_rises_to_one_and_names_what_is_played() -> None:
    told: list[Progress] = []
    what = programme(SINE, *build("dahl", AXIS))
    play(LocalLoop(FollowingDrive()), what, recorder(what), tell=told.append)
    fractions = [progress.fraction for progress in told]
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(1.0, abs=0.01)
    assert told[0].remaining == pytest.approx(what.duration, rel=0.01)
    assert told[-1].remaining < 0.3
    assert {"benchmark", "dahl", "dahl_nested"} <= {progress.label for progress in told}


def test_presliding_stays_small_and_finds_its_offset() -> None:
    drive, what = FollowingDrive(stiffness=100.0, offset=0.048), programme(Presliding(MOTION))
    rows = recorder(what)
    result = play(LocalLoop(drive), what, rows).result("presliding")
    assert isinstance(result, PreslidingResult)
    assert result.kept == tuple(range(10))
    assert result.friction == pytest.approx(0.33, rel=0.01)
    assert result.offset == pytest.approx(0.048, abs=0.1 * 0.33 * 0.1)
    sets = rows.recording().select("presliding")
    assert len(sets) == 10 * 3000
    excitation = sets["torque_command"] - result.offset
    assert 0.05 * 0.33 < np.abs(excitation).max() < 0.1 * 0.33
    assert drive.calls.count("enable torque") == 1
    assert drive.calls[-1] == "disable"


def test_presliding_that_slides_is_abandoned_relaxed_and_kept_out_of_the_recording() -> None:
    # friction is far weaker than was estimated: the first excitations slide
    drive, what = FollowingDrive(friction=0.018), programme(Presliding(MOTION, friction=0.33))
    rows = recorder(what)
    result = play(LocalLoop(drive), what, rows).result("presliding")
    assert isinstance(result, PreslidingResult)
    assert result.abandoned
    assert result.amplitude < 0.07 * 0.33
    recording = rows.recording()
    assert set(recording.select("presliding").repeat.tolist()) == set(result.kept)
    assert "abandoned" not in recording.experiment
    assert np.ptp(recording.select("presliding")["position"]) < 0.01


def test_presliding_that_never_holds_says_so() -> None:
    drive, what = FollowingDrive(friction=0.002), programme(Presliding(MOTION, friction=0.33))
    with pytest.raises(NotEnoughExcitation, match="left the region"):
        play(LocalLoop(drive), what, recorder(what))
    assert not drive.powered


def test_presliding_in_closed_loop_needs_no_torque_mode() -> None:
    drive, what = FollowingDrive(), programme(Presliding(MOTION, torque_mode=False))
    rows = recorder(what)
    play(LocalLoop(drive), what, rows)
    assert "enable torque" not in drive.calls
    sets = rows.recording().select("presliding")
    assert np.ptp(sets["reference"]) == 0.0
    # section 3.4.3: |u_s| < 0.1·min(F_c, F_s), whoever else acts on the axis
    assert 0.05 * 0.33 < np.abs(sets["torque_feedforward"]).max() < 0.1 * 0.33


def test_a_frictionless_axis_has_no_presliding() -> None:
    drive, what = FollowingDrive(friction=0.0), programme(Presliding(MOTION))
    with pytest.raises(NotEnoughExcitation, match="no friction to excite"):
        play(LocalLoop(drive), what, recorder(what))


def test_an_adapted_law_comes_back_and_the_original_is_untouched() -> None:
    parameters = LugreParameters(6.66e-4, 4.13e-3, 0.33, 40.0, 0.1, 0.05, 0.33)
    law = FixedFeedforward(parameters, 1e-3)
    experiment = AdaptiveSine(MOTION, law, longest=5.0)
    result = play(LocalLoop(FollowingDrive()), programme(experiment), recorder(programme(experiment)))
    back = result.result("adaptation")
    assert isinstance(back, FixedFeedforward)
    assert back is not law
    with pytest.raises(ConfigurationError, match="only adaptation"):
        result.result("benchmark")


def test_what_is_asked_of_the_guard_is_that_every_command_passes_it() -> None:
    """A rogue experiment: the command that breaks a limit never reaches the drive."""

    @dataclass(frozen=True)
    class Rogue(Modes):
        def run(self, start: Sample) -> Steps:
            yield Mark("modes", 0)
            sample = yield Command(start.reference)
            yield Command(sample.reference + 1.0)
            return None

    drive = FollowingDrive()
    with pytest.raises(GuardStop, match="jump"):
        programme(Rogue(MOTION))(drive, lambda sample, label, repeat: None)
    assert max(abs(c.position) for c in drive.commands[1:]) == 0.0
    assert not drive.powered
