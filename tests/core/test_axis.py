"""An axis file is read strictly; what is wrong is said with the nearest right key."""

from __future__ import annotations

from pathlib import Path

import pytest

from autotune.core.axis import read_axis
from autotune.core.errors import ConfigurationError

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"


def changed(tmp_path: Path, old: str, new: str) -> Path:
    text = EXAMPLE.read_text()
    assert old in text
    path = tmp_path / "axis.toml"
    path.write_text(text.replace(old, new))
    return path


def test_the_example_is_valid() -> None:
    axis = read_axis(EXAMPLE)
    assert axis.position_resolution == pytest.approx(1.2566e-4, rel=1e-4)
    assert axis.limits.torque == 1.34


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("following_error", "folowing_error", "did you mean 'following_error'"),
        ("[benchmark]", "[bench_mark]", "did you mean 'benchmark'"),
        ("torque = 1.34", "torque = -1.34", "limits.torque is -1.34"),
        ("torque = 1.34", 'torque = "high"', "limits.torque is 'high'"),
        ("position_max = 20.0", "position_max = -30.0", "must be below position_max"),
        ("speed = 20.0 # rad/s", "", "'limits.speed' is missing"),
        ("counts_per_revolution = 50000", "", "counts_per_revolution must be set"),
        ("amplitude = 0.2", "amplitude = nan", "benchmark.amplitude"),
        ("schema = 1", "schema = 7", "schema"),
        ("schema = 1", "schema_version = 1", "unknown key 'schema_version'; did you mean 'schema'"),
        ("[benchmark]", "[drive]", "unknown key 'drive'; known are .*link, .*profile"),  # like none of them
        # near in words, but another thing on a linear axis: all keys are told
        ("counts_per_revolution = 50000", "position_resolution = 1e-6", "known are .*counts_per_metre"),
        ("machine_seconds = 300.0", "", "'limits.machine_seconds' is missing; it must be set"),
        ("[limits]", "[limits", "not valid TOML"),
    ],
)
def test_a_wrong_key_or_value_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        read_axis(changed(tmp_path, old, new))


def test_a_mistyped_file_name_gets_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "vertical.toml").write_text("")
    with pytest.raises(ConfigurationError, match=r"there is .*vertical\.toml"):
        read_axis(tmp_path / "vertcal.toml")


def test_the_fingerprint_follows_what_gives_numbers_their_meaning(tmp_path: Path) -> None:
    original = read_axis(EXAMPLE).fingerprint
    assert read_axis(changed(tmp_path, "50000", "40000")).fingerprint != original
    assert read_axis(changed(tmp_path, "torque = 1.34", "torque = 1.0")).fingerprint == original
