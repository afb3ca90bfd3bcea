"""What the report of a run says first: a run that nobody approved is not one that found nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from autotune.core.axis import read_axis
from autotune.tuning.documents import Material, build_report
from autotune.tuning.findings import Findings, PlannedValues
from autotune.tuning.outcome import Outcome, RunResult
from tests.end_to_end.support import EXAMPLE

PLANNED = PlannedValues({"feedforward.coulomb": 0.3})


@pytest.mark.parametrize(
    ("findings", "refused", "shown", "step"),
    [
        (Findings(better=True, planned=PLANNED), False, "proved", "once it is approved"),
        (Findings(better=False), False, "not_applied", "Read the reason above"),
        (Findings(better=True, planned=PLANNED), True, "not_applied", "Read the reason above"),
    ],
)
def test_proved_and_not_approved_has_its_own_badge_and_next_step(
    findings: Findings, refused: bool, shown: str, step: str, tmp_path: Path
) -> None:
    axis = read_axis(EXAMPLE)
    result = RunResult(
        Outcome.NOT_APPLIED, "As it is.", axis.name, axis.fingerprint, "2026-01-01T00:00:00", 1.0, tmp_path,
        refused=refused,
    )  # fmt: skip
    report = build_report(Material(axis, result, findings))
    assert report.outcome == shown
    assert step in " ".join(report.next_steps)
