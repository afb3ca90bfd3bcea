"""The player beside a master: what it waits for, what it plays, and what makes it leave; no wire, no clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from shutil import rmtree

import pytest

from autotune.control.torque_offset import STEP, Phase
from autotune.core.drive import Sample
from autotune.core.errors import ConfigurationError, IdentityMismatch, Interrupted
from autotune.tuning import play_session
from autotune.tuning.play import SILENCE, Laws, Player
from autotune.tuning.play_metrics import PlayMetrics
from autotune.tuning.play_model import host_model, must_be_tuned_drive
from autotune_drivers.canopen.sidecar import Event, Foreign, Synchronised, Target, Told
from tests.drivers.simulator import axis_of
from tests.tuning.play_rig import axis_file

AXIS = axis_of()
PERIOD = AXIS.cycle


class Coulomb:
    """A law of 0.3 N m with the sign of the velocity."""

    settled = False

    def prepare(self) -> None:
        pass

    def step(self, reference: float, velocity: float, acceleration: float, previous: Sample | None) -> float:
        return 0.3 * math.tanh(50.0 * velocity)


class World:
    """A bus with one master and a drive whose friction is `friction` times that of the model."""

    def __init__(self, *, lock_step: bool = False, friction: float = 1.0) -> None:
        self.lock_step = lock_step
        self.gone_within = 0.12
        self.backlog = 0
        self.at: list[int] = []
        self.friction = friction
        self.now = 0.0
        self.spacing = PERIOD
        self.sent: list[float] = []
        self.cycles = 0
        self.leap = 0.0
        self.masters = 1
        self.following = True
        self.silent = False
        self.extra: list[Event] = []
        laws = Laws(Coulomb(), None, 6.7e-4)
        self.player = Player(self, AXIS, laws, lambda: self.now)

    def listen(self, timeout: float) -> list[Event]:
        if self.silent:
            self.now += timeout
            return []
        events = [event for _ in range(self.backlog) for event in self.cycle()]
        self.backlog = 0
        return events + self.cycle()

    def cycle(self) -> list[Event]:
        self.now += self.spacing
        self.cycles += 1
        phase = 2.0 * math.pi * self.cycles * PERIOD
        targets: list[Event] = [Target(0.2 * math.sin(phase) + self.leap)] * self.masters
        torque = self.friction * 0.3 * math.tanh(50.0 * 0.4 * math.pi * math.cos(phase))
        return [*targets, Synchronised(self.now), Told(self.following, torque), *self.extra]

    def send(self, torque: float) -> None:
        self.sent.append(torque)
        self.at.append(self.cycles)

    def largest_step(self, start: int) -> float:
        """Of what acts in a drive that drops an offset in 20 ms and a ramp of 100 ms, from this frame on [N m]."""
        steps = []
        for k in range(start, len(self.sent)):
            silent = (self.at[k] - self.at[k - 1]) * PERIOD
            left = min(max(1.0 - (silent - 0.02) / 0.1, 0.0), 1.0)
            steps.append(abs(self.sent[k] - left * self.sent[k - 1]))
        return max(steps)

    def run(self, cycles: int) -> Player:
        for _ in range(cycles):
            if self.player.ended:
                break
            self.player.turn()
        return self.player


def test_nothing_is_sent_before_the_model_fits_and_then_all_of_it() -> None:
    world = World()
    world.run(500)
    assert world.sent == []
    player = world.run(2000)
    assert player.offset.phase is Phase.PLAYING
    assert max(world.sent) == pytest.approx(0.3, rel=1e-3)
    assert max(abs(b - a) for a, b in pairwise(world.sent)) < 0.05 * AXIS.limits.torque


def test_asked_to_stop_it_fades_out_and_ends_with_a_zero() -> None:
    world = World()
    world.run(2000)
    world.player.leave()
    world.run(500)
    assert world.player.ended
    assert world.player.dropped
    assert world.player.reason == ""
    assert world.sent[-1] == 0.0


class Beside(World):
    """A whole session in the same world."""

    def prepare(self) -> None:
        assert self.sent == []

    def close(self, dropped: bool) -> list[str]:
        assert dropped
        return []


def beside(world: Beside, metrics: PlayMetrics, stop: Callable[[], bool], say: Callable[[str], None]) -> None:
    play_session._beside(world, world.player, metrics, stop, say)  # type: ignore[arg-type]


def test_metrics_that_cannot_be_written_any_more_do_not_drop_the_offset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: a full disk ended the program, and the offset with it, without fading out."""
    world, said, folder = Beside(), list[str](), tmp_path / "metrics"
    folder.mkdir()
    monkeypatch.setattr(play_session, "EVERY", 0.0)

    def stop() -> bool:
        if world.cycles == 2000:
            rmtree(folder)
        return world.cycles > 2500

    with pytest.raises(Interrupted):
        beside(world, PlayMetrics(folder / "play.prom", "axis"), stop, said.append)
    assert world.cycles > 2500
    assert world.sent[-1] == 0.0
    assert max(abs(b - a) for a, b in pairwise(world.sent)) < 0.05 * AXIS.limits.torque
    assert len([sentence for sentence in said if "cannot be written" in sentence]) == 1


def test_a_metrics_file_in_no_folder_is_refused_before_the_drive_is_touched(tmp_path: Path) -> None:
    world = Beside()
    with pytest.raises(ConfigurationError, match="choose another place"):
        beside(world, PlayMetrics(tmp_path / "no" / "play.prom", "axis"), lambda: True, print)
    assert world.cycles == 0


def leap(world: World) -> None:
    world.leap = 0.1


def second_master(world: World) -> None:
    world.masters = 2


def no_set_points(world: World) -> None:
    world.masters = 0


def disabled(world: World) -> None:
    world.following = False


def other_producer(world: World) -> None:
    world.extra = [Foreign(0x505)]


@pytest.mark.parametrize(
    ("trouble", "word"),
    [
        (leap, "jump"),
        (second_master, "two masters"),
        (no_set_points, "fell silent"),
        (disabled, "follows no set points"),
        (other_producer, "505h"),
    ],
)
def test_a_doubt_fades_out(trouble: Callable[[World], None], word: str) -> None:
    world = World()
    world.run(2000)
    assert world.player.offset.phase is Phase.PLAYING
    before = len(world.sent)
    trouble(world)
    player = world.run(1000)
    assert player.ended
    assert word in player.reason
    assert world.sent[-1] == 0.0
    assert world.largest_step(before) <= 1.01 * STEP * AXIS.limits.torque


def test_silence_ends_it_and_the_drive_is_left_to_drop_the_offset() -> None:
    world = World()
    world.run(2100)
    world.silent = True
    player = world.run(round(SILENCE / 0.05) + 5)
    assert player.ended
    assert not player.dropped
    assert "no SYNC" in player.reason


@pytest.mark.parametrize("lock_step", [False, True])
@pytest.mark.parametrize("late", [20, 60, 119])
def test_a_host_that_was_held_up_waits_for_the_drop_and_fades_in_anew(late: int, lock_step: bool) -> None:
    world = World(lock_step=lock_step)
    world.run(2500)
    assert world.player.offset.gain == 1.0
    before = len(world.sent)
    assert abs(world.sent[-1]) > 0.1
    world.backlog = late
    world.run(1000)
    assert world.player.held_up == 1
    gone = round(world.gone_within / PERIOD)
    assert world.at[before] - world.at[before - 1] > gone, "no frame until the drive has dropped the last one"
    assert world.largest_step(before) <= 1.01 * STEP * AXIS.limits.torque
    assert abs(world.sent[before]) < 0.01 * AXIS.limits.torque, "from nothing"
    assert world.player.offset.gain == 1.0


def test_a_host_that_was_a_little_late_goes_on_with_one_frame() -> None:
    world = World()
    world.run(2500)
    before = len(world.sent)
    world.backlog = 10
    world.run(1)
    assert len(world.sent) == before + 1
    assert abs(world.sent[-1] - world.sent[-2]) <= STEP * AXIS.limits.torque


def test_frames_that_have_gathered_are_not_sent_in_one_cycle_of_the_drive() -> None:
    world = World()
    world.run(2500)
    before = len(world.sent)
    world.spacing = 0.25 * PERIOD  # as a host hears them that was late
    world.run(8)
    assert len(world.sent) - before <= 3


def test_asked_to_stop_while_it_is_held_up_it_ends_with_a_zero() -> None:
    world = World()
    world.run(2500)
    world.backlog = 50
    world.run(1)
    world.player.leave()
    player = world.run(1000)
    assert player.ended
    assert player.dropped
    assert world.sent[-1] == 0.0


@pytest.mark.parametrize("friction", [0.5, 1.6])
def test_a_model_that_does_not_fit_is_never_played(friction: float) -> None:
    world = World(friction=friction)
    player = world.run(2000)
    assert "does not fit" in player.reason
    assert world.sent == []


def test_another_period_than_the_models_is_never_played() -> None:
    world = World()
    world.spacing = 2.0 * PERIOD
    player = world.run(2000)
    assert "SYNC comes every 2.000 ms" in player.reason
    assert world.sent == []


def test_the_newest_run_with_a_model_for_the_host_is_played(tmp_path: Path) -> None:
    axis_file(tmp_path)
    tuned = host_model(tmp_path / "runs", AXIS)
    assert tuned.model.axis == AXIS.name
    must_be_tuned_drive(tuned, {"vendor": 2147460865, "product": 1026, "serial": 1000})
    with pytest.raises(IdentityMismatch, match="serial is 7"):
        must_be_tuned_drive(tuned, {"vendor": 2147460865, "product": 1026, "serial": 7})


def test_a_model_of_the_axis_as_it_was_before_is_refused(tmp_path: Path) -> None:
    axis_file(tmp_path)
    turned = AXIS.model_copy(update={"mechanics": AXIS.mechanics.model_copy(update={"direction": -1})})
    with pytest.raises(ConfigurationError, match="fingerprint"):
        host_model(tmp_path / "runs", turned)


def test_an_axis_without_such_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"feedforward\.toml"):
        host_model(tmp_path, AXIS)
