"""The same axis in other sizes and as a linear one in m and N: the same results, relative to its size."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from autotune.identify.dahl import identify_dahl
from autotune.identify.high_speed import identify_high_speed
from autotune.recordings.recording import Recording
from autotune_sim.presets import preset
from tests.support.identification_programme import play

MOTION = ("position", "reference", "velocity")
SIZES = [(100.0, 0.01), (0.01, 100.0), (1e-3, 1e3), (1.0, 1e-4)]


@cache
def recorded(programme: str) -> Recording:
    return play(preset("edm-vertical", 2), 2, (programme,))


def resized(recording: Recording, travel: float, torque: float) -> Recording:
    """All motion `travel`-fold and all torque `torque`-fold; linear where it shrinks a thousandfold."""
    columns = {
        name: column * (travel if name in MOTION else torque if name.startswith("torque") else 1.0)
        for name, column in recording.floats.items()
    }
    old = recording.metadata
    metadata = replace(
        old,
        motion_unit="m" if travel < 1e-2 else "rad",
        position_resolution=(old.position_resolution or 0.0) * travel,
        torque_limit=(old.torque_limit or 0.0) * torque,
        controller=None,
    )
    return Recording.from_columns(columns, metadata, recording.experiment, recording.repeat, recording.missed)


@pytest.mark.parametrize(("travel", "torque"), SIZES)
def test_dahl_s_curve_scales(travel: float, torque: float) -> None:
    """To 0.2 %: the steps of travel end on samples, and rounding decides which step gets them."""
    part = recorded("dahl").select("dahl")
    one, other = identify_dahl(part), identify_dahl(resized(part, travel, torque))
    assert one.reversal is not None
    assert other.reversal is not None
    assert other.reversal.value == pytest.approx(travel * one.reversal.value, rel=2e-3)
    for name, unit in (("stiffness", torque / travel), ("break_away", torque), ("offset", torque)):
        assert other.estimate[name].value == pytest.approx(unit * one.estimate[name].value, rel=2e-3), name


@pytest.mark.parametrize(("travel", "torque"), SIZES)
def test_high_speed_scales(travel: float, torque: float) -> None:
    part = recorded("high-speed").select("high_speed")
    one, other = identify_high_speed(part), identify_high_speed(resized(part, travel, torque))
    ratio = other.estimate["inertia"].value / one.estimate["inertia"].value
    assert ratio == pytest.approx(torque / travel, rel=1e-6)
    assert other.lag.value == pytest.approx(one.lag.value, rel=1e-4, abs=1e-9)
