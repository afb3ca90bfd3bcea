"""A table of speeds with the mean torque at each is no course of time, and is a speed curve where a person says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError, RecordingError
from autotune.diagnosis.fit_recordings import fit_recordings
from autotune.diagnosis.verdict import diagnose
from autotune.recordings.recording import Recording
from tests.importing.conftest import bring_in, write_table

COULOMB, VISCOUS, DIP, FALLS_OVER = 5e-3, 1.5e-4, 1.5e-3, 1.5


def _table(path: Path, speeds: Floats, dip: float = 0.0) -> Path:
    """Speeds [rpm] and torques [mN m] of a worm drive, forwards and backwards."""
    speed = speeds * 2.0 * np.pi / 60.0
    torque = COULOMB + VISCOUS * speed + dip * np.exp(-((speed / FALLS_OVER) ** 2))
    both = np.concatenate([-speeds[::-1], speeds]), np.concatenate([-torque[::-1], torque])
    noise = np.random.default_rng(1).normal(0.0, 0.02, 2 * len(speeds))
    return write_table(path, {"speed [rpm]": both[0], "torque [mNm]": 1e3 * both[1] + noise})


def _imported(path: Path) -> Recording:
    return bring_in(path, speed_curve=True).recording


@pytest.mark.parametrize("count", [12, 30])
@pytest.mark.parametrize("dip", [0.0, DIP])
def test_a_table_of_speeds_is_fitted_and_diagnosed(tmp_path: Path, count: int, dip: float) -> None:
    """Thirty speeds are nearer together than a fifth, and were taken for one."""
    recording = _imported(_table(tmp_path / "worm.csv", np.geomspace(3.0, 300.0, count), dip))
    assert len(list(recording.segments())) == 2 * count
    fitted = fit_recordings([recording])
    assert fitted.model is not None
    assert fitted.model["coulomb"] == pytest.approx(COULOMB + 0.5 * dip, rel=0.02 if not dip else 0.2)
    found = diagnose([recording], fitted.model)
    assert found.effects == (("stribeck",) if dip else ())


def test_it_is_asked_for_and_offered(tmp_path: Path) -> None:
    path = _table(tmp_path / "worm.csv", np.geomspace(3.0, 300.0, 12))
    with pytest.raises(ConfigurationError, match="--speed-curve where each row is a constant speed"):
        bring_in(path)


def test_rest_is_no_point_of_a_curve(tmp_path: Path) -> None:
    path = write_table(tmp_path / "t.csv", {"speed [rpm]": np.arange(12.0), "torque [Nm]": np.ones(12)})
    with pytest.raises(RecordingError, match="row 1 has no speed"):
        bring_in(path, speed_curve=True)


def test_a_curve_needs_a_speed(tmp_path: Path) -> None:
    path = write_table(tmp_path / "t.csv", {"position [rad]": np.arange(12.0), "torque [Nm]": np.ones(12)})
    with pytest.raises(ConfigurationError, match="velocity"):
        bring_in(path, speed_curve=True)
