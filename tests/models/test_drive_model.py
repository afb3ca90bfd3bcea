"""The drive model: values, packing, file."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import BASE, HistoryEntry, base_model, surface_parameter
from autotune.models.model_file import model_text, read_model, write_model
from autotune.models.table import EFFECTS

NUMBERS = {
    "inertia": 6.66e-4,
    "viscous": 4.13e-3,
    "coulomb": 0.33,
    "stiffness": 100.0,
    "micro_damping": 0.1,
    "offset": 0.048,
}
positive = st.floats(1e-9, 1e6, allow_nan=False)


@given(st.fixed_dictionaries(dict.fromkeys(NUMBERS, positive)), st.booleans())
def test_a_written_model_reads_back_equal(tmp_path_factory, numbers, linear) -> None:
    model = base_model(
        {**numbers, "break_away": 2.0 * numbers["coulomb"] % 1e6, "stribeck_velocity": 0.2},
        {"inertia": 1e-6},
        "m" if linear else "rad",
        "z",
        "abc",
    )
    model = model.with_effect(EFFECTS["torque_ripple"].make({"order_1": 12, "sin_1": 0.1, "cos_1": -0.2}))
    model = model.with_history(HistoryEntry("2024-05-01", "fitted", "a.csv", 0.1, 0.05))
    path = tmp_path_factory.mktemp("model") / "model.toml"
    write_model(model, path)
    assert read_model(path) == model


def test_writing_keeps_the_file_before(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    write_model(base_model(NUMBERS), path)
    write_model(base_model({**NUMBERS, "coulomb": 0.5}), path)
    assert read_model(path)["coulomb"] == 0.5
    assert read_model(path.with_name("model.toml.bak"))["coulomb"] == 0.33
    assert sorted(p.name for p in tmp_path.iterdir()) == ["model.toml", "model.toml.bak"]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[inertia]", "[inertai]", "inertia"),
        ("value = 0.33", "value = -0.33", "coulomb is -0.33; it must be between 0"),
        ("schema = 1", "schema = 99", "schema 99"),
        ('unit = "kg m²"', 'unit = "kg"', "must be in 'kg m²'"),
        ("value = 0.33", "valeu = 0.33", "did you mean 'value'"),
        ("value = 0.33", "value = nan", "coulomb"),
    ],
)
def test_a_wrong_model_file_says_what_is_wrong(tmp_path: Path, old: str, new: str, says: str) -> None:
    text = model_text(base_model(NUMBERS))
    assert old in text
    path = tmp_path / "model.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"model\.toml") as caught:
        read_model(path)
    assert says in str(caught.value)


def test_unknown_effects_and_parameters_name_the_nearest() -> None:
    with pytest.raises(ConfigurationError, match="'direction_asymmetry'"):
        surface_parameter("direction_asymetry.coulomb")
    with pytest.raises(ConfigurationError, match="'order_1'"):
        EFFECTS["torque_ripple"].make({"ordr_1": 12.0})
    with pytest.raises(ConfigurationError, match="lacks sin_1, cos_1"):
        EFFECTS["torque_ripple"].make({"order_1": 12.0})


def test_units_follow_the_kind_of_motion() -> None:
    linear = base_model(NUMBERS, motion_unit="m")
    assert [linear.unit(p.name) for p in BASE] == ["kg", "N s/m", "N", "N/m", "N s/m", "N"]
    assert linear.unit("torque_ripple.order_1") == "cycles/m"


def test_steady_motion_needs_the_steady_state_torque() -> None:
    """At constant speed (3.41) holds once the bristle has settled, here after 10 x_s."""
    model = base_model({**NUMBERS, "break_away": 0.4, "stribeck_velocity": 0.3})
    time = np.arange(2000) * 1e-3
    for speed in (0.05, -0.3, 5.0):
        torque = model.torque(speed * time, np.full(2000, speed), np.zeros(2000), 1e-3)
        level = 0.33 + 0.07 * math.exp(-((speed / 0.3) ** 2))
        expected = 0.048 + 4.13e-3 * speed + math.copysign(level, speed)
        assert torque[-1] == pytest.approx(expected, rel=1e-6)


def test_ripple_repeats_once_per_period_on_both_kinds_of_axes() -> None:
    ripple = EFFECTS["torque_ripple"].make({"order_1": 4, "sin_1": 0.1, "cos_1": 0.05})
    for unit, turn in (("rad", 2 * math.pi), ("m", 1.0)):
        model = base_model({**NUMBERS, "coulomb": 0.0}, motion_unit=unit).with_effect(ripple)
        position = np.linspace(0, turn, 401)
        torque = model.torque(position, np.zeros(401), np.zeros(401), 1e-3) - 0.048
        np.testing.assert_allclose(torque[:301], torque[100:], atol=1e-9)
        assert np.ptp(torque) == pytest.approx(2 * math.hypot(0.1, 0.05), rel=1e-3)
