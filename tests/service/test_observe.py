"""What follows from the history of an axis: its trend, and when a state is told again."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import timedelta
from types import SimpleNamespace
from typing import Any

import pytest

from autotune.monitoring import check
from autotune.monitoring.drift import Drift, Verdict
from autotune.service.observe import trend_of
from autotune.service.store import text
from tests.service.conftest import START, a_check

World = Any


def warm(days: int) -> list[dict[str, Any]]:
    """Checks whose friction goes with the temperature and with nothing else."""
    return [
        a_check("one", START + timedelta(days=day), 0.33 * (1.0 + 0.04 * (day % 7))) for day in range(days)
    ]


def rough(day: int) -> dict[str, Any]:
    """A check on a signal that tells no friction."""
    return a_check("one", START + timedelta(days=day), 0.7, "signal")


def test_a_check_that_cannot_be_read_and_one_with_a_rough_signal_are_out_of_the_trend() -> None:
    sound = warm(40)
    assert trend_of([{}, *sound[:20], rough(19), rough(20), *sound[20:]]) == trend_of(sound)


def test_a_check_takes_temperature_out_as_the_checks_with_a_sound_signal_tell_it(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    sound = warm(40)
    seen: list[float | None] = []

    def judge(evidence: Any, settings: object) -> Verdict:
        seen.append(evidence.temperature_coefficient)
        return Verdict(Drift.NONE, "No drift.")

    monkeypatch.setattr(check, "judge", judge)
    axis = SimpleNamespace(name="one", fingerprint="f", motion_unit="rad", position_resolution=1e-6)
    session = SimpleNamespace(budget=SimpleNamespace(used=0.0), directory=tmp_path)
    measured, present = (
        SimpleNamespace(scale=None, temperature=25.0),
        SimpleNamespace(committed=None, held=None),
    )
    for history in (sound, [*sound[:20], rough(19), rough(20), *sound[20:]]):
        request: Any = SimpleNamespace(axis=axis, runs=tmp_path, history=history, settings=None)
        check._result(request, START, session, measured, present, ())  # type: ignore[arg-type]
    assert seen[0] is not None
    assert seen[1] == seen[0]


def test_a_state_that_lasts_is_told_every_week_for_as_long_as_it_lasts(world: Callable[..., World]) -> None:
    here = world()
    for day in range(100):
        left = here.configuration.runs / f"check-{day:03d}"
        left.mkdir(parents=True)
        content = a_check("one", here.now, 0.33, "drifted")
        (left / "check.json").write_text(json.dumps(content))
        here.manager.submit("one", "check", "http")
        here.manager.tick()
        here.finish("done", 0, left.name)
        here.pass_time(days=1)
    told = [notice["at"] for notice in here.notices if notice["kind"] == "drift:drifted"]
    assert told == [text(START + timedelta(days=day)) for day in range(0, 100, 7)]
