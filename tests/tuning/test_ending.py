"""Whatever fails after a commit was kept: what is in the drive is told, and what went wrong."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from autotune.core.errors import AutotuneError, DriveFault, Interrupted, NotEnoughExcitation
from autotune.tuning import run as tuning
from autotune.tuning.commit import commit
from autotune.tuning.ending import ending
from autotune.tuning.outcome import Outcome
from autotune.tuning.run import Request, tune
from autotune.tuning.session import Session
from tests.drivers.simulator import axis_of
from tests.tuning.test_commit import NEW, NOW, OLD, CuttingLoop, MemoryDrive

Ending = Callable[[], None]


class Listener:
    """Hears what a person would."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def stage(self, name: str, seconds: float) -> None:
        return

    def progress(self, fraction: float) -> None:
        return

    def say(self, sentence: str) -> None:
        self.said.append(sentence)


def full() -> None:
    raise OSError(28, "No space left on device", "findings.json")


def fault() -> None:
    raise DriveFault("node 5 reports a fault when power was taken off: overcurrent (2310h)")


def interrupted() -> None:
    raise KeyboardInterrupt


def nothing() -> None:
    return


class LimitedLoop(CuttingLoop):
    """With what a run asks of a drive; `closing` is what happens at its end."""

    power = False
    closing: Ending = staticmethod(nothing)

    def close(self) -> None:
        type(self).closing()


def request(
    monkeypatch: pytest.MonkeyPatch, runs: Path, after: Ending, *, kept: bool = True
) -> tuple[Request, MemoryDrive]:
    """A run whose only stage commits `NEW` and then comes to an end of its own."""
    drive = MemoryDrive()

    def stages(asked: Request, session: Session, state: Any) -> None:
        if kept:
            assert commit(session.loop, NEW, session.journal, runs, NOW, lambda: True)
            state.outcome = Outcome.KEPT
            state.verdict = "Kept: the drive runs with the committed parameters."
        after()

    monkeypatch.setattr(tuning, "perform", stages)
    return Request(axis_of(), lambda: LimitedLoop(drive), runs, Listener(), lambda: NOW), drive


def run_json(runs: Path) -> Mapping[str, Any]:
    (path,) = runs.glob("*/run.json")
    return dict(json.loads(path.read_text()))


def test_a_full_disk_after_a_kept_commit_is_told_beside_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked, drive = request(monkeypatch, tmp_path, full)
    result = tune(asked)
    assert (result.outcome, result.exit_code) == (Outcome.KEPT, 0)
    assert "Kept" in result.verdict
    assert "No space left on device" in result.verdict
    assert drive.stored == NEW
    assert run_json(tmp_path)["verdict"] == result.verdict


def test_a_record_that_cannot_be_written_does_not_change_what_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked, _ = request(monkeypatch, tmp_path, nothing)
    monkeypatch.setattr(tuning, "write_json", lambda path, content: full())
    result = tune(asked)
    assert (result.outcome, result.exit_code) == (Outcome.KEPT, 0)
    assert "is not complete" in result.verdict


def test_a_defect_of_the_report_is_a_sentence_in_the_verdict(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def defect(material: object) -> None:
        raise TypeError("unsupported operand")

    asked, _ = request(monkeypatch, tmp_path, nothing)
    monkeypatch.setattr("autotune.tuning.documents.write_documents", defect)
    result = tune(asked)
    assert (result.outcome, result.exit_code) == (Outcome.KEPT, 0)
    assert "Kept" in result.verdict
    assert "a defect of autotune (TypeError: unsupported operand)" in result.verdict
    assert any("a defect of autotune" in sentence for sentence in asked.reporter.said)  # type: ignore[attr-defined]
    assert "Traceback" in (result.run_directory / "report-defect.txt").read_text()


@pytest.mark.parametrize("where", ["stage", "closing"])
def test_a_fault_after_a_kept_commit_is_told_with_it_and_ends_with_its_code(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, where: str
) -> None:
    asked, drive = request(monkeypatch, tmp_path, fault if where == "stage" else nothing)
    monkeypatch.setattr(LimitedLoop, "closing", staticmethod(fault if where == "closing" else nothing))
    with pytest.raises(AutotuneError) as caught:
        tune(asked)
    assert caught.value.exit_code == 5
    assert "Kept: the drive holds the proved parameters" in str(caught.value)
    assert "overcurrent" in str(caught.value)
    assert run_json(tmp_path)["outcome"] == "kept"
    assert drive.stored == NEW


def test_a_fault_while_the_commit_is_proved_puts_everything_back(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The last power-off belongs to the proof: a drive that reports a fault there has proved nothing."""
    asked, drive = request(monkeypatch, tmp_path, nothing, kept=False)

    def stages(asked: Request, session: Session, state: Any) -> None:
        def proves() -> bool:
            fault()
            return True

        commit(session.loop, NEW, session.journal, tmp_path, NOW, proves)

    monkeypatch.setattr(tuning, "perform", stages)
    with pytest.raises(DriveFault, match="overcurrent"):
        tune(asked)
    assert drive.stored == drive.volatile == OLD
    assert run_json(tmp_path)["outcome"] == "aborted"


@pytest.mark.parametrize(
    ("kept", "power", "words"),
    [
        (False, False, "interrupted; the axis is without power, as the drive confirms"),
        (False, None, "NOT confirmed"),
        (True, False, "Kept: the drive holds the proved parameters"),
    ],
)
def test_an_interruption_says_what_is_known_and_no_more(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kept: bool, power: bool | None, words: str
) -> None:
    asked, drive = request(monkeypatch, tmp_path, interrupted, kept=kept)
    monkeypatch.setattr(LimitedLoop, "power", power)
    with pytest.raises(AutotuneError) as caught:
        tune(asked)
    assert caught.value.exit_code == Interrupted.exit_code
    assert words in str(caught.value)
    assert drive.stored == (NEW if kept else OLD)


def test_a_refusal_says_nothing_was_applied_only_where_nothing_is_left() -> None:
    refusal = NotEnoughExcitation("the position loop oscillates by itself")
    assert ending(refusal, kept=False) == (Outcome.NOT_APPLIED, f"Nothing was applied: {refusal}")
    refusal.add_note("the drive's own limits could not be put back (limit.position_min = -25)")
    outcome, words = ending(refusal, kept=False)
    assert outcome is Outcome.NOT_APPLIED
    assert words.startswith(f"No parameters were applied: {refusal}. But")
    assert "limit.position_min = -25" in words
    assert "othing was applied" not in words
