"""Progress: lines where there is no terminal, a bar where there is one, nothing on standard output."""

from __future__ import annotations

import io

import pytest

from autotune.view.console import ConsoleProgress, Stage

STAGES = (Stage("check", 10.0), Stage("identify", 60.0), Stage("prove", 30.0))


class Clock:
    """A clock that a test moves."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def play(progress: ConsoleProgress, clock: Clock, name: str, seconds: float) -> None:
    progress.start(name)
    for step in range(101):
        progress.advance(step / 100)
        clock.now += seconds / 101
    progress.finish("done")


def test_a_log_gets_a_line_a_stage_and_one_a_tenth(capsys: pytest.CaptureFixture[str]) -> None:
    stream, clock = io.StringIO(), Clock()
    with ConsoleProgress(STAGES, stream, clock) as progress:
        play(progress, clock, "check", 5.0)
        play(progress, clock, "identify", 60.0)
        progress.message("[bold]not mark-up[/bold] " + "x" * 200)
    lines = stream.getvalue().splitlines()
    assert lines[0] == "[1/3] check … (about 1:40 in total)"
    identify = [line for line in lines if line.startswith("[2/3] identify")]
    assert [line.split()[2] for line in identify] == ["…", *(str(10 * k) for k in range(1, 10))]
    assert lines[-2] == "✓ identify: done (1:00)"
    assert lines[-1] == "[bold]not mark-up[/bold] " + "x" * 200
    assert capsys.readouterr() == ("", "")


def test_a_fast_run_does_not_fill_the_log() -> None:
    stream, clock = io.StringIO(), Clock()
    with ConsoleProgress(STAGES, stream, clock) as progress:
        play(progress, clock, "check", 0.1)
    assert len(stream.getvalue().splitlines()) == 2


def test_a_stage_that_begins_twice_is_one_stage() -> None:
    stream, clock = io.StringIO(), Clock()
    with ConsoleProgress(STAGES, stream, clock) as progress:
        progress.start("prove")
        clock.now += 20.0
        progress.start("prove")
        clock.now += 10.0
        progress.finish()
    assert progress.stage is None
    assert stream.getvalue().splitlines() == ["[3/3] prove … (about 30 s in total)", "✓ prove (30 s)"]


def test_remaining_time_follows_the_pace_seen() -> None:
    clock = Clock()
    progress = ConsoleProgress(STAGES, io.StringIO(), clock)
    progress.start("check")
    assert progress.remaining_s() == pytest.approx(10.0)
    assert progress.remaining_total_s() == pytest.approx(100.0)
    clock.now += 10.0
    progress.advance(0.5)
    assert progress.remaining_s() == pytest.approx(10.0)
    clock.now += 10.0
    progress.finish()
    assert progress.remaining_s() == 0.0
    # the first stage took twice its time, so do the others
    assert progress.remaining_total_s() == pytest.approx(180.0)


def test_nothing_remains_after_the_last_stage() -> None:
    clock = Clock()
    progress = ConsoleProgress(STAGES, io.StringIO(), clock)
    for stage in STAGES:
        progress.start(stage.name)
        clock.now += 1.0
        progress.finish()
    assert progress.remaining_total_s() == 0.0
    progress.finish()
    assert progress.label == "[3/3] prove"


def test_progress_never_goes_back_nor_beyond() -> None:
    clock = Clock()
    progress = ConsoleProgress(STAGES, io.StringIO(), clock)
    progress.advance(0.5)
    progress.start("check")
    for fraction in (0.6, 0.2, 7.0):
        progress.advance(fraction)
    assert progress.remaining_s() == 0.0


def test_a_stage_nobody_announced_is_shown_too() -> None:
    stream = io.StringIO()
    progress = ConsoleProgress(STAGES, stream, Clock())
    progress.start("check")
    progress.start("restore")
    assert "[2/4] restore" in stream.getvalue()


def test_a_terminal_gets_a_bar() -> None:
    stream, clock = Terminal(), Clock()
    with ConsoleProgress(STAGES, stream, clock) as progress:
        play(progress, clock, "check", 5.0)
        progress.message("note")
    text = stream.getvalue()
    assert "✓ check: done (5 s)" in text
    assert "\x1b[" in text
    assert "note" in text


def test_quiet_says_nothing() -> None:
    stream = io.StringIO()
    with ConsoleProgress(STAGES, stream, Clock(), quiet=True) as progress:
        play(progress, Clock(), "check", 5.0)
    assert stream.getvalue() == ""


def test_more_steps_than_foreseen_are_no_end_in_sight() -> None:
    """Of a search whose length nobody knows, what it took so far is told, once a minute, with what begins."""
    now = [0.0]
    stream = io.StringIO()
    progress = ConsoleProgress([Stage("diagnose", 10.0)], stream, lambda: now[0])
    progress.start("diagnose")
    for second, what in ((9.0, "candidate spring"), (71.0, "candidate backlash"), (80.0, "refinement")):
        now[0] = second
        progress.advance(0.8)
        progress.beyond(what)
    now[0] = 150.0
    progress.finish()
    assert stream.getvalue().splitlines() == [
        "[1/1] diagnose … (about 10 s in total)",
        "[1/1] diagnose 80 % (about 2 s left)",
        "[1/1] diagnose (1:11 so far, longer than usual): candidate backlash",
        "✓ diagnose (2:30)",
    ]
