"""Whole runs on drives that cannot hold the LuGre model: in process, with part of the drive's block hidden."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from autotune.core.axis import Axis, read_axis
from autotune.core.loop import LocalLoop
from autotune.tuning.commit import feedforward_parameters
from autotune.tuning.outcome import Outcome
from autotune.tuning.progress import Silent
from autotune.tuning.rollback import roll_back
from autotune.tuning.run import Request, tune
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset
from tests.end_to_end.support import EXAMPLE
from tests.tuning.ripple_cut_rig import VelocityRig

KINETIC = ("enabled", "inertia", "viscous", "coulomb", "offset")
WITHOUT_COULOMB = ("enabled", "inertia", "viscous")


class Partly(LocalLoop):
    """A loop whose drive is known by a part of its feedforward parameters only."""

    def __init__(self, drive: SimDrive, held: Sequence[str]) -> None:
        super().__init__(drive)
        self._held = {f"feedforward.{name}" for name in held}

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        found = super().read_parameters(names)
        return {n: v for n, v in found.items() if not n.startswith("feedforward.") or n in self._held}


def axis_with(improvement: float) -> Axis:
    axis = read_axis(EXAMPLE)
    acceptance = axis.acceptance.model_copy(update={"improvement": improvement})
    return axis.model_copy(update={"acceptance": acceptance, "link": "sim://edm-vertical"})


def run(runs: Path, held: Sequence[str], improvement: float) -> tuple[SimDrive, dict[str, Any]]:
    drive = SimDrive(preset("edm-vertical"))
    asked: list[str] = []
    request = Request(
        axis_with(improvement),
        lambda: Partly(drive, held),
        runs,
        Silent(),
        datetime.now,
        approve=lambda sentence: not asked.append(sentence),
    )
    result = tune(request)
    content = json.loads((result.run_directory / "run.json").read_text())
    content["asked"] = asked
    content["report"] = (result.run_directory / "report.html").read_text()
    return drive, content


@pytest.mark.slow
@pytest.mark.long
def test_a_kinetic_drive_gets_what_it_can_hold_and_the_loss_is_as_predicted(tmp_path: Path) -> None:
    drive, said = run(tmp_path, KINETIC, 0.02)
    assert said["outcome"] == Outcome.KEPT.value
    reduction = said["reduction"]
    assert reduction["agreement"] == pytest.approx(1.0, abs=0.25)
    assert reduction["measured_loss"] > 0.5e-3
    assert reduction["host"] == []
    assert drive.read_parameters(["feedforward.coulomb"])["feedforward.coulomb"] == pytest.approx(
        reduction["drive"]["coulomb"]
    )
    assert drive.read_parameters(["feedforward.stiffness"])["feedforward.stiffness"] == 0.0
    assert said["feedforward"].keys() == {f"feedforward.{name}" for name in KINETIC if name != "enabled"}
    assert "is predicted to be" in said["asked"][0]
    assert "Reduction to what the drive holds" in said["report"]
    assert said["committed"]["peak_error"] < said["before"]["peak_error"]


@pytest.mark.slow
@pytest.mark.long
def test_what_a_kinetic_drive_can_hold_waits_for_approval_and_is_then_written(tmp_path: Path) -> None:
    drive = SimDrive(preset("edm-vertical"))
    request = Request(
        axis_with(0.02),
        lambda: Partly(drive, KINETIC),
        tmp_path,
        Silent(),
        datetime.now,
        approve=lambda _: False,
    )
    asked = tune(request)
    assert asked.outcome is Outcome.NOT_APPLIED
    assert drive.read_parameters(["feedforward.enabled"])["feedforward.enabled"] == 0.0
    written = tune(replace(request, only="commit", approve=lambda _: True))
    assert written.outcome is Outcome.KEPT
    held = drive.read_parameters(list(asked.feedforward))
    assert held == pytest.approx(dict(asked.feedforward), rel=1e-6)
    assert held["feedforward.coulomb"] < 0.2, "reduced, not the full Coulomb torque"


@pytest.mark.slow
@pytest.mark.long
def test_a_drive_with_a_table_over_velocity_gets_it_keeps_it_and_gives_it_back(tmp_path: Path) -> None:
    """Over the drive's byte stream, in virtual time."""
    rig = VelocityRig({})
    axis = axis_with(0.1).model_copy(update={"profile": rig.profile})
    with rig.time():
        asked: list[str] = []
        said = tune(
            Request(axis, lambda: rig.open(tmp_path / "sessions"), tmp_path, Silent(), datetime.now,
                    approve=lambda sentence: not asked.append(sentence))
        )  # fmt: skip
        assert said.outcome is Outcome.KEPT
        assert said.in_drive["keeps"] == ["friction_table", "inertia", "offset"]
        assert "this drive holds friction_table, inertia, offset only" in asked[0].lower()
        assert said.reduction["agreement"] == pytest.approx(1.0, abs=0.25)
        assert said.committed is not None
        assert said.committed.peak_error < 0.8 * said.before.peak_error
        assert "Friction over velocity" in (said.run_directory / "report.html").read_text()
        rig.plug()
        rig.device.power_loss()
        rig.rest(1.0)
        rig.plug()
        assert _held(rig, tmp_path).items() >= said.feedforward.items()
        rig.plug()
        roll_back(axis, lambda: rig.open(tmp_path / "sessions"), tmp_path, datetime.now())
        rig.plug()
        assert set(_held(rig, tmp_path).values()) == {0.0}


def _held(rig: VelocityRig, folder: Path) -> dict[str, float]:
    loop = rig.open(folder / "sessions")
    try:
        return feedforward_parameters(loop)
    finally:
        loop.close()


@pytest.mark.long
def test_a_drive_without_coulomb_friction_is_kept_with_the_rest_from_the_host(tmp_path: Path) -> None:
    drive, said = run(tmp_path, WITHOUT_COULOMB, 0.1)
    assert said["outcome"] == Outcome.KEPT.value
    assert said["reduction"]["host"] == ["coulomb"]
    # the peak of six averaged periods has more noise in it than that of the proof's eighteen
    assert said["with_host"]["peak_error"] < 1.3 * said["after"]["peak_error"] + 0.05e-3
    # by itself the drive has no friction to feed forward, and is not worse for the rest
    assert said["after"]["peak_error"] < said["committed"]["peak_error"] < 1.1 * said["before"]["peak_error"]
    assert said["after"]["peak_error"] < 0.25e-3
    assert said["reduction"]["lost"] == []
    assert "coulomb from the host" in said["verdict"]
    assert drive.read_parameters(["feedforward.coulomb"])["feedforward.coulomb"] == 0.0


@pytest.mark.slow
@pytest.mark.long
def test_what_would_not_help_is_not_written(tmp_path: Path) -> None:
    drive, said = run(tmp_path, KINETIC, 0.5)
    assert said["outcome"] == Outcome.HOST_ONLY.value
    assert "The host has to play" in said["verdict"]
    assert said["asked"] == []
    assert drive.read_parameters(["feedforward.enabled"])["feedforward.enabled"] == 0.0


@pytest.mark.slow
@pytest.mark.long
def test_a_drive_that_holds_nothing_is_told_so(tmp_path: Path) -> None:
    _, said = run(tmp_path, (), 0.1)
    assert said["outcome"] == Outcome.HOST_ONLY.value
    assert said["verdict"].startswith("Nothing is in the drive: this drive cannot hold a feedforward")
    assert said["committed"] is None
    assert said["after"]["peak_error"] < 0.25e-3
    assert "Not in the drive" in said["report"]
    assert "Signature" not in said["report"]
