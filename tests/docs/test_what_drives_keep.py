"""README's table of what each drive keeps is that of the profiles, and says the same as a run."""

from __future__ import annotations

from pathlib import Path

from autotune.tuning.holdings import holding_of, nothing_kept, readme_table, shipped

README = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
FIRST_SCREEN = 40  # lines


def test_the_readme_says_on_its_first_screen_what_each_profile_keeps() -> None:
    table = readme_table()
    assert table in README
    assert README[: README.index(table)].count("\n") + table.count("\n") < FIRST_SCREEN


def test_what_each_kind_of_drive_keeps() -> None:
    found = {one.profile: one for one in shipped()}
    assert found["cia402"].nothing
    assert found["ingenia-eve"].nothing
    assert found["moteus"].keeps == ("torque ripple (1024-point table)",)
    assert "torque ripple (10 harmonics up to order 200)" in found["beckhoff-ax8000"].keeps
    assert "torque ripple" in found["maxon-epos4"].needs_host
    assert holding_of("no-such-profile") is None


def test_a_drive_that_keeps_nothing_is_told_so_with_the_way_out() -> None:
    sentence = nothing_kept("cia402")
    assert "keeps nothing" in sentence
    assert "export" in sentence
