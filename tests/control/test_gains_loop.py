"""Gains named on the command line are those that a drive of their structure would show; all else is refused."""

from __future__ import annotations

import pytest

from autotune.control.gains.loop import parse_gains
from autotune.core.errors import ConfigurationError


@pytest.mark.parametrize(
    "text",
    [
        "pid kp=16.4 kd=0.02 ki=2000 derivative_filter=0.5",
        "p_pi position_gain=40 velocity_gain=0.15 integral_gain=3",
        "pi_velocity velocity_gain=0.15 integral_gain=60",
    ],
)
def test_what_is_named_is_what_the_structure_shows(text: str) -> None:
    kind, *pairs = text.split()
    gains = parse_gains(text)
    assert gains.structure == kind
    wanted = {"derivative_filter": 1.0} | {
        name: float(value) for name, value in (one.split("=") for one in pairs)
    }
    assert gains.named() == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not understood"),
        ("pi kp=3", "'pi_velocity velocity_gain=… integral_gain=…'"),
        ("pid kp=1 kd=2", "not understood"),
        ("pid kp=1 kd=2 ki=3 kv=4", "not understood"),
        ("pid kp=a kd=2 ki=3", "must be a number"),
        ("pid kp=-1 kd=2 ki=3", "not below 0"),
        ("pid kp=nan kd=2 ki=3", "finite"),
        ("pid kp=1 kd=2 ki=3 derivative_filter=2", "at most 1"),
    ],
)
def test_what_is_no_controller_is_refused_in_words(text: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        parse_gains(text)
