"""Kernels written down as statements: loops unrolled, branches decided, the rest said or refused."""

from __future__ import annotations

import math
from typing import Any

import pytest

from autotune.core.errors import ConfigurationError
from autotune.export.kernels import Term, Writer, named

LINES = 3
_AT = 4


def waves(p: Any, position: float) -> float:
    """A sum of terms that ends at the first without an order."""
    total = 0.0
    for line in range(LINES):
        order = p[_AT + 2 * line]
        if order == 0.0:
            break
        angle = order * position
        total += p[_AT + 2 * line + 1] * math.sin(angle)
    return total


def stepped(p: Any, state: Any, velocity: float) -> float:
    """A branch on the motion, with a value before it and a state behind it."""
    level = p[0]
    if velocity >= 0.0:
        level += p[1]
    elif p[2] > 0.0:
        level = -level
    state[10] = max(level, 0.1 * velocity**2)
    return float(level) if velocity > -1.0 else state[10]


def early(p: Any, velocity: float) -> float:
    if velocity > 0.0:
        return p[0]
    return 0.0


def outside(p: Any, velocity: float) -> float:
    return math.gamma(velocity)


def endless(p: Any, velocity: float) -> float:
    while velocity > 1.0:
        velocity -= p[0]
    return velocity


def written(kernel: Any, values: list[float], *arguments: Term | None) -> tuple[str, str]:
    return Writer(lambda at: named(f"P{at}", values[at]), lambda at: f"s{at}").call(kernel, *arguments)


def run(text: tuple[str, str], values: list[float], **known: float) -> tuple[float, dict[str, Any]]:
    names: dict[str, Any] = {f"P{i}": value for i, value in enumerate(values)}
    names |= {"sin": math.sin, "pow": math.pow, "max": max, **known}
    exec(text[0], names)
    return float(eval(text[1], names)), names


def test_a_loop_ends_where_the_model_has_no_more() -> None:
    values = [0.0, 0.0, 0.0, 0.0, 2.0, 0.5, 3.0, 0.25, 0.0, 9.0]
    text = written(waves, values, None, named("q"))
    assert "P8" not in text[0]
    assert run(text, values, q=0.7)[0] == 0.5 * math.sin(1.4) + 0.25 * math.sin(3.0 * 0.7)


@pytest.mark.parametrize("third", [0.0, 1.0])
@pytest.mark.parametrize("velocity", [-3.0, -0.5, 0.0, 2.0])
def test_branches_on_the_motion_stay_those_on_parameters_go(third: float, velocity: float) -> None:
    values = [0.4, 0.3, third]
    text = written(stepped, values, None, None, named("v"))
    assert "P2" not in text[0]
    state = {10: 0.0}
    assert run(text, values, v=velocity, s10=0.0)[0] == stepped(values, state, velocity)
    assert run(text, values, v=velocity, s10=0.0)[1]["s10"] == state[10]


@pytest.mark.parametrize("kernel", [early, outside, endless])
def test_what_statements_cannot_say_is_refused(kernel: Any) -> None:
    with pytest.raises(ConfigurationError, match="cannot be written for another controller"):
        written(kernel, [1.0], None, named("v"))
