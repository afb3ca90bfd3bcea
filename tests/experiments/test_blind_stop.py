"""A stop because the encoder may lie takes power off at once; any other stop brakes first."""

from __future__ import annotations

import pytest

from autotune.core.drive import Command, Mode, Sample
from autotune.core.errors import GuardStop
from autotune.experiments.guard import Guard
from autotune.experiments.runner import _power_off
from tests.experiments.support import axis, sample

PERIOD, COUNT = 1e-3, 1e-4


class Told:
    """A drive that remembers how its power went."""

    def __init__(self) -> None:
        self.how = ""

    def cut(self) -> None:
        self.how = "cut"

    def disable(self) -> None:
        self.how = "braked"


@pytest.mark.parametrize(("blind", "how"), [(True, "cut"), (False, "braked")])
def test_the_reason_of_a_stop_decides_how_power_goes(blind: bool, how: str) -> None:
    drive = Told()
    stop = GuardStop("stopped")
    stop.blind = blind
    _power_off(drive, stop)  # type: ignore[arg-type]
    assert drive.how == how


@pytest.mark.parametrize(("blind", "how"), [(True, "cut"), (False, "braked")])
def test_an_interruption_while_the_encoder_is_in_doubt_does_not_brake_by_it(blind: bool, how: str) -> None:
    drive = Told()
    _power_off(drive, KeyboardInterrupt(), blind)  # type: ignore[arg-type]
    assert drive.how == how


def _sliding(guard: Guard, cycles: int, speed: float) -> Sample:
    """An axis that slides at a speed under a torque that keeps it so."""
    guard.begin(Mode.POSITION, sample(position=0.0, reference=0.0))
    here = sample()
    for k in range(1, cycles + 1):
        place = speed * k * PERIOD
        here = sample(time=k * PERIOD, position=place, reference=place, velocity=speed, torque_command=0.3)
        guard.check(here, Command(position=place))
    return here


def test_a_limit_met_while_the_encoder_is_silent_is_a_blind_stop() -> None:
    """The encoder dies at 5 rad/s; the controller's torque meets its limit before anything else is sure."""
    guard = Guard(axis().limits, PERIOD, COUNT)
    here = _sliding(guard, 200, 5.0)
    silent = here._replace(velocity=0.0)
    guard.check(silent._replace(torque_command=0.6), Command(position=here.position))
    with pytest.raises(GuardStop, match="torque") as stop:
        guard.check(silent._replace(torque_command=9.0), Command(position=here.position))
    assert stop.value.blind


def test_a_limit_met_by_an_axis_that_is_seen_is_not() -> None:
    guard = Guard(axis().limits, PERIOD, COUNT)
    here = _sliding(guard, 200, 5.0)
    seen = here._replace(position=here.position + 5.0 * PERIOD, torque_command=9.0)
    with pytest.raises(GuardStop, match="torque") as stop:
        guard.check(seen, Command(position=here.position))
    assert not stop.value.blind
