"""The drive's limits: tightened, never widened, and put back whatever happens."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError, DriveError, DriveFault, LinkError
from autotune.core.loop import LocalLoop
from autotune.experiments.limits_guarded import limits_guarded, tighter
from tests.experiments.support import FollowingDrive, axis

WIDE = {
    "limit.position_min": -100.0,
    "limit.position_max": 100.0,
    "limit.speed": 50.0,
    "limit.torque": 2.0,
    "limit.following_error": 1.0,
    "controller.kp": 60.0,
}


def drive(**parameters: float) -> FollowingDrive:
    made = FollowingDrive()
    made.parameters = WIDE | {f"limit.{name}": value for name, value in parameters.items()}
    return made


def test_limits_are_set_inside_and_restored_outside() -> None:
    one, noted = drive(), []
    with limits_guarded(LocalLoop(one), axis(), noted.append) as held:
        assert one.parameters["limit.position_max"] == 20.0
        assert one.parameters["limit.torque"] == 1.34
        assert held.limits == axis().limits
    assert one.parameters == WIDE
    assert noted == [{name: value for name, value in WIDE.items() if name.startswith("limit.")}]


def test_the_journal_is_written_before_the_drive() -> None:
    one = drive()
    with limits_guarded(LocalLoop(one), axis(), lambda before: one.calls.append("journal")):
        pass
    assert [call.split()[0] for call in one.calls] == ["journal", "write", "write"]


@given(st.floats(0.1, 100.0), st.floats(0.1, 100.0), st.floats(0.01, 10.0), st.floats(0.001, 10.0))
def test_nothing_is_ever_widened(travel: float, speed: float, torque: float, error: float) -> None:
    one = drive(position_min=-travel, position_max=travel, speed=speed, torque=torque, following_error=error)
    own, wanted = dict(one.parameters), axis().limits
    with limits_guarded(LocalLoop(one), axis()) as held:
        for name in ("position_max", "speed", "torque", "following_error"):
            inside = one.parameters[f"limit.{name}"]
            assert inside <= min(own[f"limit.{name}"], getattr(wanted, name)) * (1 + 1e-6)
            assert getattr(held.limits, name) == pytest.approx(inside, rel=1e-6)
        assert one.parameters["limit.position_min"] >= max(-travel, -20.0) - 1e-4
    assert one.parameters == own


def test_a_drive_that_is_tighter_is_left_alone() -> None:
    one = drive(position_min=-1.0, position_max=1.0, speed=5.0, torque=0.5, following_error=0.01)
    with limits_guarded(LocalLoop(one), axis()) as held:
        assert held.limits.speed == 5.0
        assert held.limits.deceleration == axis().limits.deceleration
    assert one.calls == []


@pytest.mark.parametrize("error", [DriveFault("stopped"), KeyboardInterrupt(), ZeroDivisionError()])
def test_limits_are_restored_when_the_block_fails(error: BaseException) -> None:
    one = drive()

    def run() -> None:
        with limits_guarded(LocalLoop(one), axis()):
            raise error

    with pytest.raises(type(error)):
        run()
    assert one.parameters == WIDE


def test_a_failed_restore_is_reported_and_the_rest_is_restored() -> None:
    one = drive()

    def run() -> None:
        with limits_guarded(LocalLoop(one), axis()):
            one.refuse_writes.add("limit.speed")

    with pytest.raises(DriveError, match=r"could not be put back.*limit\.speed = 50"):
        run()
    assert one.parameters == WIDE | {"limit.speed": 20.0}


def test_a_failed_restore_does_not_hide_why_the_block_failed() -> None:
    one = drive()

    def run() -> None:
        with limits_guarded(LocalLoop(one), axis()):
            one.refuse_writes.update(WIDE)
            raise DriveFault("over-current")

    with pytest.raises(DriveFault, match="over-current") as fault:
        run()
    assert any("could not be put back" in note for note in fault.value.__notes__)


def test_limits_half_written_are_put_back() -> None:
    one = drive()
    one.refuse_writes.add("limit.torque")
    entered = False
    with pytest.raises(LinkError, match=r"limit\.torque is refused"), limits_guarded(LocalLoop(one), axis()):
        entered = True
    assert not entered
    assert one.parameters == WIDE


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        ({"limit.position_min": 30.0, "limit.position_max": 40.0}, "nothing in common"),
        ({"limit.speed": 0.0}, r"limit\.speed is 0; set it above 0"),
    ],
)
def test_a_drive_that_allows_no_motion_is_refused(parameters: Mapping[str, float], says: str) -> None:
    with pytest.raises(ConfigurationError, match=says):
        tighter(axis().limits, WIDE | parameters)


def test_a_drive_without_travel_limits_gets_those_of_the_axis_file() -> None:
    off = tighter(axis().limits, {"limit.position_min": 0.0, "limit.position_max": 0.0})
    assert (off.position_min, off.position_max) == (-20.0, 20.0)
    assert tighter(axis().limits, {}) == axis().limits
