"""The policy of thresholds: each says what it is, in which unit, and why; there are not too many."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from autotune.estimation.policy import POLICY, thresholds

ROOT = Path(__file__).resolve().parents[2]
MOST = 60


def test_every_threshold_has_unit_meaning_and_evidence() -> None:
    for one in thresholds():
        assert one.value > 0.0, one.name
        assert one.unit, one.name
        assert len(one.meaning) > 10, one.name
        assert len(one.evidence) > 10, one.name


def test_there_are_few_enough_to_be_known() -> None:
    assert len(thresholds()) <= MOST


def test_every_threshold_is_asked_somewhere() -> None:
    code = "".join(
        path.read_text(encoding="utf-8")
        for part in ("estimation", "diagnosis")
        for path in (ROOT / "autotune" / part).rglob("*.py")
        if path.name != "policy.py"
    )
    asked = set(re.findall(r"policy\.(\w+)", code))
    assert {one.name for one in thresholds()} - asked == set()


def test_the_table_in_the_documents_has_them_all() -> None:
    text = (ROOT / "docs/thresholds.md").read_text(encoding="utf-8")
    rows = set(re.findall(r"^\| `(\w+)` \|", text, flags=re.MULTILINE))
    assert rows == {one.name for one in thresholds()}


def test_a_policy_cannot_be_changed_in_place() -> None:
    with pytest.raises(AttributeError):
        POLICY.named = 0.5  # type: ignore[misc]
