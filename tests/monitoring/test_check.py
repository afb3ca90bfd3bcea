"""A check plays what the drive does by itself, however its feedforward is switched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from autotune.core.axis import read_axis
from autotune.core.loop import LocalLoop
from autotune.core.ripple_parameters import GAIN
from autotune.monitoring.check import CheckRequest, check_axis
from autotune.tuning.progress import Silent
from autotune.tuning.stage_prove import ENABLED
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset
from tests.end_to_end.support import EXAMPLE


class Holding(LocalLoop):
    """Holds a feedforward of its own kind, which does nothing; knows what it held in each programme."""

    def __init__(self, held: Mapping[str, float]) -> None:
        super().__init__(SimDrive(preset("edm-vertical")))
        self.held = dict(held)
        self.played: list[dict[str, float]] = []

    def play(self, routine: Any, watch: Any = None) -> Any:
        self.played.append(dict(self.held))
        return super().play(routine, watch)

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        found = super().read_parameters()
        here = {
            name: value for name, value in found.items() if not name.startswith("feedforward.")
        } | self.held
        return here if names is None else {name: here[name] for name in names}

    def write_parameters(self, values: Mapping[str, float]) -> None:
        super().write_parameters({name: value for name, value in values.items() if name not in self.held})
        self.held |= {name: value for name, value in values.items() if name in self.held}


@pytest.mark.parametrize(
    "held",
    [
        {ENABLED: 1.0, "feedforward.coulomb": 0.3},
        {ENABLED: 1.0, "feedforward.coulomb": 0.3, GAIN: 1.0},
        {"feedforward.coulomb": 0.3, "feedforward.inertia": 1e-3},
        {GAIN: 0.5},
        {ENABLED: 0.0, "feedforward.coulomb": 0.3},
    ],
    ids=["switch", "switch and ripple", "gains", "ripple", "off"],
)
def test_the_compensated_window_is_played_as_the_drive_was_found(
    tmp_path: Path, held: dict[str, float]
) -> None:
    """Regression: without a switch nothing compensated it, so that an axis in order was tuned anew every night."""
    axis = read_axis(EXAMPLE).model_copy(update={"link": "sim://edm-vertical"})
    loop = Holding(held)
    check_axis(CheckRequest(axis, lambda: loop, tmp_path, Silent(), lambda: datetime.now(UTC)))
    *others, compensated = loop.played
    assert compensated == loop.held == held
    assert len(others) == 2
    for one in others:
        assert not any(one.get(name, 0.0) for name in (ENABLED, GAIN))
        assert ENABLED in one or not any(one.values())
