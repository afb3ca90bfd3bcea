"""The function block: read by somebody else's parser, and its arithmetic run by a small interpreter."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

from autotune.export.request import FADE, Request
from autotune.export.structured_text import export_st
from autotune.models.drive_model import DriveModel

from .support import (
    H,
    creeping,
    everything,
    proved,
    python_torque,
    random_motion,
    shaped,
    sharing,
    with_effects,
)

SAME = 1e-9
CYCLE = 1_000_000
FUNCTIONS: dict[str, Any] = {
    "EXP": math.exp, "SIN": math.sin, "COS": math.cos, "EXPT": math.pow, "ABS": abs, "MIN": min, "MAX": max,
    "TRUE": True, "FALSE": False,
}  # fmt: skip


def text_of(model: DriveModel, **options: float) -> str:
    return export_st(Request(model, "a model", H, **options)).files["autotune_ff.st"].decode("ascii")


class Block:
    """Runs a function block, call by call: its statements turned into Python's, line by line."""

    def __init__(self, text: str) -> None:
        bare = re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)
        self.values: dict[str, Any] = {}
        for name, kind, start in re.findall(r"^\s*(\w+) : (\w+)(?: := ([^;]+))?;", bare, re.MULTILINE):
            zero: Any = False if kind == "BOOL" else 0 if kind == "UDINT" else 0.0
            self.values[name] = float(start) if start and kind == "LREAL" else int(start) if start else zero
        body = bare.rpartition("END_VAR")[2].partition("END_FUNCTION_BLOCK")[0]
        self._code = compile("\n".join(self._lines(body)), "block", "exec")

    @staticmethod
    def _lines(body: str) -> list[str]:
        lines, depth = [], 0
        for line in filter(None, (line.strip() for line in body.splitlines())):
            python = re.sub(r"\b(AND|OR|NOT)\b", lambda word: word.group().lower(), line)
            python = python.replace("<>", "!=").replace(":=", "=").rstrip(";")
            if line.startswith("IF "):
                lines.append("    " * depth + f"if {python[3:].removesuffix(' THEN')}:")
                depth += 1
            elif line == "ELSE":
                lines.append("    " * (depth - 1) + "else:")
            elif line == "END_IF;":
                depth -= 1
            else:
                lines.append("    " * depth + python)
        assert depth == 0
        return lines

    def call(self, position: float, velocity: float, acceleration: float, **inputs: Any) -> float:
        told = {"enable": True, "reset": False, "cycle_ns": CYCLE, **inputs}
        self.values |= told | {"position": position, "velocity": velocity, "acceleration": acceleration}
        exec(self._code, FUNCTIONS, self.values)
        return float(self.values["torque"])


@pytest.mark.parametrize(
    "model",
    [
        with_effects("direction_asymmetry"),
        pytest.param(everything(), marks=pytest.mark.long),  # the parser takes 10 s for it
        pytest.param(proved(3), marks=pytest.mark.long),
    ],
)
def test_blark_reads_it(model: DriveModel) -> None:
    parse = pytest.importorskip("blark.parse").parse_source_code
    found = parse(text_of(model))
    assert found.exception is None
    block = found.transform().items[0]
    assert type(block).__name__ == "FunctionBlock"
    assert str(block.name) == "autotune_ff"


@pytest.mark.parametrize("which", ["everything", "proved", "shaped", "creeping", "sharing"])
def test_its_arithmetic_is_that_of_the_python_feedforward(which: str) -> None:
    own = {"proved": lambda: proved(3), "shaped": shaped, "creeping": creeping, "sharing": sharing}
    model = (own | {"everything": everything})[which]()
    motion, block = random_motion(8_000, 9), Block(text_of(model))
    rows = zip(*(column.tolist() for column in motion), strict=True)
    torque = np.array([block.call(*row) for row in rows])
    gain = np.minimum(1.0, (np.arange(len(torque)) + 1) * H / FADE)
    assert np.max(np.abs(torque - gain * python_torque(model, motion))) < SAME


def test_it_fades_refuses_another_cycle_and_a_reference_that_is_no_number() -> None:
    block = Block(text_of(with_effects(), torque_limit=0.03))
    inward = [block.call(0.0, 0.0, 0.0) for _ in range(600)]
    assert inward[0] == pytest.approx(0.03 * H / FADE)
    assert inward[-1] == pytest.approx(0.03)  # of 0.048 that the offset asks for
    outward = [block.call(0.0, 0.0, 0.0, enable=False) for _ in range(600)]
    assert np.all(np.diff(outward) <= 0.0)
    assert outward[-1] == 0.0
    assert [block.call(0.0, 0.0, 0.0) for _ in range(600)][-1] == pytest.approx(0.03)
    refused = [block.call(0.0, 0.0, 0.0, cycle_ns=2 * CYCLE) for _ in range(600)]
    assert block.values["wrong_cycle"]
    assert refused[-1] == 0.0
    assert [block.call(0.0, 0.0, 0.0) for _ in range(600)][-1] == pytest.approx(0.03)
    after = [block.call(math.nan, 0.0, 0.0)] + [block.call(0.0, 0.0, 0.0) for _ in range(600)]
    assert block.values["fault"]
    assert np.all(np.diff(after) <= 0.0)
    assert after[-1] == 0.0
    assert [block.call(0.0, 0.0, 0.0, reset=i == 0) for i in range(1100)][-1] == pytest.approx(0.03)


def test_every_literal_is_one_of_the_standard() -> None:
    text = re.sub(r"\(\*.*?\*\)", "", text_of(everything()), flags=re.DOTALL)
    literals = re.findall(r":= (-?[\d.]+(?:[eE][-+]?\d+)?);", text)
    assert len(literals) > 20
    assert all(re.fullmatch(r"-?\d+(\.\d+(E-?\d+)?)?", one) for one in literals), literals
