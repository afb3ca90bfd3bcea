"""A run of its own: its folder and its journal, however it ends."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

import pytest

from autotune.core.axis import read_axis
from autotune.core.errors import LinkTimeout
from autotune.core.loop import LocalLoop, Loop
from autotune.tuning.journal import Journal
from autotune.tuning.preparation import SessionRequest, connected, own_run
from autotune.tuning.progress import Silent
from autotune.tuning.recovery import recover
from autotune.tuning.run_directory import make_run_directory
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset
from tests.end_to_end.support import EXAMPLE


def opened() -> Loop:
    return LocalLoop(SimDrive(preset("edm-vertical")))


def silent(loop: Loop | None = None) -> None:
    """The link breaks, before or after it was open."""
    if loop is not None:
        loop.close()
    raise LinkTimeout("silent")


def said(journal: Journal, whole: bool) -> dict[str, str]:
    return {"outcome": "not_applied" if whole else "aborted"}


@pytest.fixture
def request_of_a_run(tmp_path: Path) -> SessionRequest:
    return SessionRequest(read_axis(EXAMPLE), opened, tmp_path, Silent(), datetime.now)


def test_a_run_that_comes_to_its_end_says_so(request_of_a_run: SessionRequest) -> None:
    with own_run(request_of_a_run, said) as run:
        run.opening().close()
    assert Journal.load(run.directory).state.outcome == "not_applied"


def test_a_run_that_is_cut_off_says_so(request_of_a_run: SessionRequest) -> None:
    with pytest.raises(LinkTimeout), own_run(request_of_a_run, said) as run:
        silent(run.opening())
    assert Journal.load(run.directory).state.outcome == "aborted"


def test_what_is_left_in_the_drive_keeps_the_journal_open(request_of_a_run: SessionRequest) -> None:
    with own_run(request_of_a_run, said) as run:
        run.journal.note(changed={"limit.torque": 1.0})
    state = Journal.load(run.directory).state
    assert (state.outcome, state.left_something) == ("", True)


class GarblingLoop(LocalLoop):
    """A line without checksum: the next so many writes arrive as another value, and nobody is told."""

    spoilt = 0

    def write_parameters(self, values: Mapping[str, float]) -> None:
        garbled = {name: 0.4 * value for name, value in values.items()}
        super().write_parameters(garbled if self.spoilt > 0 else values)
        self.spoilt -= 1


@pytest.mark.parametrize(("spoilt", "left"), [(1, False), (9, True)])
def test_what_a_line_has_garbled_is_put_back_at_once_or_by_the_next_start(
    request_of_a_run: SessionRequest, spoilt: int, left: bool
) -> None:
    """Regression: a person had to decide, since the drive held neither the old value nor the run's (seed 8308026)."""
    drive = SimDrive(preset("edm-vertical"))
    before = LocalLoop(drive).read_parameters(["limit.speed"])
    loop = GarblingLoop(drive)
    with own_run(request_of_a_run) as run, connected(lambda: loop, run.journal, Silent()):
        run.journal.note(changed=before, during={"limit.speed": 20.0})
        loop.spoilt = spoilt
        loop.write_parameters(before)
    assert run.journal.state.left_something is left
    runs, now = request_of_a_run.runs, datetime.now()
    later = Journal.begin(
        make_run_directory(runs, request_of_a_run.axis.name, now), request_of_a_run.axis.name, "f", now
    )
    recover(LocalLoop(drive), runs, later)
    assert LocalLoop(drive).read_parameters(["limit.speed"]) == before


def test_an_axis_that_was_never_reached_leaves_no_folder(request_of_a_run: SessionRequest) -> None:
    with pytest.raises(LinkTimeout), own_run(request_of_a_run, said) as run:
        silent()
    assert not run.directory.exists()
