"""The report's tables: intervals in the value's unit, old and new values with object numbers, and why they differ."""

from __future__ import annotations

from pathlib import Path

from autotune.tuning.findings import Findings
from autotune.tuning.outcome import Outcome, RunResult
from autotune.tuning.parameter_tables import feedforward_table, identified_table

IDENTIFIED = {
    "coulomb": {"value": 0.333, "standard_error": 0.002, "unit": "N m", "interval": [0.329, 0.337]},
    "inertia": {"value": 6.66e-4, "standard_error": 5e-6, "unit": "kg m²", "interval": [6.56e-4, 6.76e-4]},
}


def result(outcome: Outcome) -> RunResult:
    written = {"feedforward.coulomb": 0.268, "feedforward.inertia": 6.66e-4}
    return RunResult(
        outcome,
        "",
        "axis",
        "",
        "",
        0.0,
        Path(),
        parameters=IDENTIFIED,
        feedforward=written,
        motion_unit="rad",
    )


def test_an_interval_is_in_the_unit_of_its_value() -> None:
    rows = {row[0]: row[1:] for row in identified_table(result(Outcome.KEPT)).rows}
    assert rows["coulomb"] == ["333 mN m", "329 … 337 mN m"]
    assert rows["inertia"] == ["6.66 × 10⁻⁴ kg m²", "6.56 × 10⁻⁴ … 6.76 × 10⁻⁴ kg m²"]


def test_old_and_new_value_stand_with_the_object_and_the_reason() -> None:
    """333 identified and 268 written wants a word; what was written as identified wants none."""
    findings = Findings(held_before={"feedforward.coulomb": 0.25, "feedforward.inertia": 0.0})
    table = feedforward_table(result(Outcome.KEPT), findings, {"feedforward.coulomb": "2022h:03"})
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["coulomb"][:4] == ["2022h:03", "333 mN m", "250 mN m", "268 mN m"]
    assert "identified over all speeds" in rows["coulomb"][4]
    assert rows["inertia"][4] == ""
    assert table.columns[4] == "in the drive now"
    assert feedforward_table(result(Outcome.HOST_ONLY), findings, {}).columns[4] == "proposed"
