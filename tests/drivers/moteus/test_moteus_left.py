"""What an earlier session has left in a controller is known again, in the digits that its console prints."""

from __future__ import annotations

from typing import Any, cast

import pytest

from autotune_drivers.kept import Keeper
from autotune_drivers.moteus.console import Console
from autotune_drivers.moteus.settings import put_right

NAME = "servo.default_accel_limit"


class Printed:
    """A console that holds whole counts and prints six digits."""

    def __init__(self, value: float) -> None:
        self.value = value

    def get(self, _: str) -> str:
        return f"{round(self.value * 50_000) / 50_000:g}"

    def set(self, _: str, text: str) -> None:
        self.value = float(text)


class Noted:
    """A session's file."""

    def __init__(self, before: str, written: str) -> None:
        self.content: dict[str, Any] | None = {
            "settings": [{"name": NAME, "before": before, "written": [written]}]
        }

    def read(self) -> dict[str, Any] | None:
        return self.content

    def clear(self) -> None:
        self.content = None

    def others(self) -> tuple[str, ...]:
        return ()


def restart(holds: float, written: str) -> tuple[str, float]:
    """What the next start says, and what the controller holds then."""
    console, keeper = Printed(holds), Noted("63.662", written)
    (told,) = put_right(cast("Console", console), cast("Keeper", keeper))
    return told, console.value


@pytest.mark.parametrize("written", ["26.8812699", "23.8732415", "28.6478898", "1.00000049", "9.99999949"])
def test_a_value_that_the_console_rounds_is_put_back(written: str) -> None:
    """Regression: 26.8813 was taken for somebody else's 26.8812699, and stayed (campaign, seed 3330269)."""
    told, value = restart(float(written), written)
    assert "put back" in told
    assert value == pytest.approx(63.662)


def test_what_somebody_has_set_since_stays() -> None:
    told, value = restart(26.89, "26.8812699")
    assert "left as they are" in told
    assert value == 26.89
