"""What a diagnosis leaves open, read from its file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from autotune.core.errors import ConfigurationError
from autotune.tuning.question import question_in


def file_with(folder: Path, content: Any) -> Path:
    path = folder / "diagnosis.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def verdict(name: str, **more: Any) -> dict[str, Any]:
    return {"verdict": name, "effects": [], "confidence": None, "confusable": [], "candidates": []} | more


def candidate(effect: str, gain: float) -> dict[str, Any]:
    return {"effect": effect, "gain": gain}


@pytest.mark.parametrize(
    ("content", "rivals"),
    [
        (
            verdict("ambiguous", effects=["spring"], confusable=[["spring", "torque_ripple"]]),
            ("spring", "torque_ripple"),
        ),
        (verdict("named", effects=["stribeck"], confidence="suspected"), ("stribeck",)),
        (verdict("unknown"), ()),
        (
            verdict("unknown", candidates=[candidate("spring", 0.2), candidate("backlash", 0.9),
                                           candidate("stribeck", 0.5)]),
            ("backlash", "stribeck"),
        ),
        ({"outcome": "kept", "diagnosis": verdict("named", effects=["spring"], confidence="suspected")}, ("spring",)),
    ],
)  # fmt: skip
def test_what_is_in_doubt_is_asked(tmp_path: Path, content: dict[str, Any], rivals: tuple[str, ...]) -> None:
    assert question_in(file_with(tmp_path, content)) == rivals


@pytest.mark.parametrize(
    "content", [verdict("none"), verdict("named", effects=["spring"], confidence="confirmed")]
)
def test_where_nothing_is_in_doubt_nothing_moves(tmp_path: Path, content: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match="nothing is in doubt"):
        question_in(file_with(tmp_path, content))


@pytest.mark.parametrize(
    "content",
    [
        "", "{", "[]", "3", {"verdict": "perhaps"}, {"verdict": "ambiguous", "effects": 3},
        {"verdict": "ambiguous", "effects": ["magic"]}, {"verdict": "unknown", "candidates": [{"gain": 1.0}]},
        {"verdict": "unknown", "candidates": [3]}, {"verdict": "ambiguous", "confusable": 7}, {"diagnosis": []},
        {"verdict": "unknown", "candidates": [{"effect": "spring", "gain": "much"}]},
    ],
)  # fmt: skip
def test_what_is_no_diagnosis_is_named_with_the_file(tmp_path: Path, content: Any) -> None:
    path = file_with(tmp_path, content)
    with pytest.raises(ConfigurationError, match=r"--from .*diagnosis\.json"):
        question_in(path)


def test_a_verdict_that_is_none_is_named_beside_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="its verdict is 'perhaps', not one of named, none, unknown"):
        question_in(file_with(tmp_path, {"verdict": "perhaps"}))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="No such file"):
        question_in(tmp_path / "missing.json")
