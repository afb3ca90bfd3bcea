"""Gains into a drive: proved in turn, kept, rolled back; killed anywhere, never mixed."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import pytest

from autotune.control.gains.loop import Gains, Notch
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import ConfigurationError, DriveError
from autotune.core.loop import LocalLoop
from autotune.core.paths import config_directory
from autotune.tuning.backup import backup_ids, load_backup
from autotune.tuning.commit import commit
from autotune.tuning.gains_apply import GainsRequest, apply_gains, written_as
from autotune.tuning.journal import Journal, unfinished
from autotune.tuning.links import open_link
from autotune.tuning.progress import Silent
from autotune.tuning.recovery import recover
from autotune.tuning.rollback import roll_back
from tests.drivers.moteus_rig import moteus_axis, moteus_opener
from tests.drivers.simulator import simulator
from tests.tuning.gains_cut_rig import Ending, canopen_cuts, moteus_cuts
from tests.tuning.test_commit import CuttingLoop, Dead, MemoryDrive

NOW = datetime(2026, 11, 20, 4, 0, 0)
OLD = {"controller.kp": 60.0, "controller.kd": 0.15, "controller.ki": 6000.0}
NEW = {"controller.kp": 75.0, "controller.kd": 0.3, "controller.ki": 15000.0}
BETTER, WORSE = Gains(75.0, 0.3, 15000.0), Gains(20.0, 0.05, 300.0)


def axis_in(folder: Path) -> Axis:
    text = (config_directory() / "axes" / "simulated.toml").read_text(encoding="utf-8")
    path = folder / "axis.toml"
    path.write_text(
        text.replace("runs/simulated-drive.json", str(path.with_name("drive.json"))), encoding="utf-8"
    )
    return read_axis(path)


def request(folder: Path, gains: Gains, approve: Callable[[str], bool] = lambda said: True) -> GainsRequest:
    axis = axis_in(folder)
    return GainsRequest(
        axis,
        lambda: open_link(axis, folder, folder / "runs"),
        folder / "runs",
        Silent(),
        lambda: NOW,
        gains=gains,
        approve=approve,
    )


def held(folder: Path) -> dict[str, float]:
    loop = open_link(axis_in(folder), folder)
    try:
        return loop.read_parameters(sorted(OLD))
    finally:
        loop.close()


def test_better_gains_are_kept_and_rolled_back(tmp_path: Path) -> None:
    applied = apply_gains(request(tmp_path, BETTER))
    assert applied.kept, applied.sentence
    assert held(tmp_path) == pytest.approx(NEW, rel=1e-6)
    axis = axis_in(tmp_path)
    roll_back(axis, lambda: open_link(axis, tmp_path), tmp_path / "runs", NOW)
    assert held(tmp_path) == pytest.approx(OLD, rel=1e-6)


def test_worse_gains_are_not_written(tmp_path: Path) -> None:
    applied = apply_gains(request(tmp_path, WORSE))
    assert not applied.kept
    assert "not better beyond doubt" in applied.sentence
    assert held(tmp_path) == pytest.approx(OLD, rel=1e-6)
    assert not unfinished(tmp_path / "runs", axis_in(tmp_path).name)


def test_what_a_drive_cannot_hold_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="does not map controller"):
        written_as(BETTER, {"feedforward.enabled": 0.0})
    with pytest.raises(ConfigurationError, match="set the others at the drive by hand"):
        written_as(Gains(1.0, 1.0, notch=Notch(100.0)), OLD)


def test_gains_beyond_the_drives_range_are_refused_before_any_is_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"controller\.kp .*cannot be 20000.*allowed is 0 to 10000"):
        apply_gains(request(tmp_path, Gains(20_000.0, 0.15, 6000.0)))
    assert held(tmp_path) == pytest.approx(OLD, rel=1e-6)
    assert not unfinished(tmp_path / "runs", axis_in(tmp_path).name)


class GainsDrive(MemoryDrive):
    """Holds gains and a feedforward that is switched off for the run."""

    def __init__(self) -> None:
        self.volatile = {**OLD, "feedforward.enabled": 0.0}
        self.stored = {**OLD, "feedforward.enabled": 1.0}


def begin(runs: Path, name: str = "20261120-040000-axis") -> Journal:
    directory = runs / name
    directory.mkdir(parents=True)
    return Journal.begin(directory, "axis", "f00", NOW)


def attempted(drive: GainsDrive, runs: Path, cut: int, good: bool = True) -> bool:
    journal = begin(runs)
    journal.note(changed={"feedforward.enabled": 1.0}, during={"feedforward.enabled": 0.0})
    return commit(CuttingLoop(drive, cut, Dead), NEW, journal, runs, NOW, lambda: good)


def test_what_was_switched_off_for_the_run_is_not_stored_as_off(tmp_path: Path) -> None:
    drive = GainsDrive()
    assert attempted(drive, tmp_path, -1)
    assert drive.stored == {**NEW, "feedforward.enabled": 1.0}


@pytest.mark.parametrize("power_cycle", [False, True])
@pytest.mark.parametrize("good", [False, True])
def test_killed_at_any_operation_never_mixed(tmp_path: Path, good: bool, power_cycle: bool) -> None:
    for cut in range(60):
        drive, runs = GainsDrive(), tmp_path / str(cut)
        try:
            attempted(drive, runs, cut, good)
        except (Dead, DriveError):
            pass
        else:
            break
        if power_cycle:
            drive.power_cycle()
        recover(CuttingLoop(drive), runs, begin(runs, "20261120-050000-axis"))
        gains = {name: drive.volatile[name] for name in OLD}
        assert gains in (OLD, NEW), cut
        assert gains == {name: drive.stored[name] for name in OLD}, cut
    else:
        pytest.fail("the commit never came to its end")


def test_committed_and_rolled_back_on_a_moteus_line(tmp_path: Path) -> None:
    """Whole, over its serial line, and stored: a power loss leaves what was stored."""
    memory = ("--link", "moteus", "--node", "1", "--state", str(tmp_path / "memory"))
    axis, runs = moteus_axis(), tmp_path / "runs"
    with simulator(tmp_path, *memory) as process:
        before = moteus_opener(tmp_path)()
        held = before.read_parameters(sorted(NEW))
        loop = LocalLoop(before)
        assert commit(loop, NEW, begin(runs / "one"), runs, NOW, lambda: True)
        assert not commit(loop, OLD, begin(runs / "two"), runs, NOW, lambda: False)
        mark = process.mark
        process.order("power-loss")
        process.wait_for("boot-up", mark)
        assert loop.read_parameters(sorted(NEW)) == pytest.approx(NEW, rel=1e-3)
        first = backup_ids(runs, "axis")[0]
        assert load_backup(runs, "axis", first).parameters.items() >= held.items()
        loop.write_parameters(held)
        loop.store()
        assert loop.read_parameters(sorted(NEW)) == pytest.approx(held, rel=1e-3)
        loop.close()
    assert axis.profile.startswith("autotune-sim-moteus")


@pytest.mark.parametrize("cuts", [canopen_cuts, moteus_cuts])
def test_killed_over_the_wire_never_mixed(
    tmp_path: Path, cuts: Callable[[Path, int, int], list[Ending]]
) -> None:
    """`bench/commit_cut.py --what gains` makes a hundred of them."""
    endings = cuts(tmp_path, 4, 1)
    assert not [one.wrong for one in endings if one.wrong]
