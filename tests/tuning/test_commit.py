"""A commit cut at any operation leaves a drive that the next start recognises and puts right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from autotune.core.errors import ConfigurationError, DriveError, LinkError
from autotune.tuning.backup import backup_ids, load_backup
from autotune.tuning.commit import commit
from autotune.tuning.journal import CommitPhase, Journal, unfinished
from autotune.tuning.recovery import recover

NOW = datetime(2026, 11, 20, 4, 0, 0)
OLD = {"feedforward.enabled": 0.0, "feedforward.coulomb": 0.1, "feedforward.stiffness": 10.0}
NEW = {"feedforward.enabled": 1.0, "feedforward.coulomb": 0.3, "feedforward.stiffness": 30.0}


class Dead(BaseException):
    """The process dies here: nothing of it runs any more."""


class MemoryDrive:
    """Volatile and stored parameters; survives the processes that talk to it."""

    def __init__(self) -> None:
        self.volatile = dict(OLD)
        self.stored = dict(OLD)

    def power_cycle(self) -> None:
        self.volatile = dict(self.stored)


class CuttingLoop:
    """Speaks to a MemoryDrive and fails at the operation numbered `cut`, then on every later one."""

    period = 1e-3
    identity: Mapping[str, int | str] = {"vendor": 1, "serial": 7}

    def __init__(self, drive: MemoryDrive, cut: int = -1, failure: type[BaseException] = LinkError) -> None:
        self.drive, self.cut, self.failure, self.operations = drive, cut, failure, 0

    def _operate(self) -> None:
        self.operations += 1
        if 0 <= self.cut < self.operations:
            raise self.failure("the wire was cut")

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        self._operate()
        return {name: self.drive.volatile[name] for name in (names or self.drive.volatile)}

    def write_parameters(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            self._operate()
            self.drive.volatile[name] = value

    def store(self) -> None:
        self._operate()
        self.drive.stored = dict(self.drive.volatile)

    def faults(self) -> list[str]:
        return []

    def play(self, routine: Any, watch: Any = None) -> Any:
        return routine(None, None)

    def close(self) -> None:
        return


def begin(runs: Path) -> Journal:
    directory = runs / "20261120-040000-axis"
    directory.mkdir(parents=True)
    return Journal.begin(directory, "axis", "f00", NOW)


def next_start(runs: Path) -> Journal:
    number = len(list(runs.glob("*-axis")))
    directory = runs / f"20261120-05000{number}-axis"
    directory.mkdir()
    return Journal.begin(directory, "axis", "f00", NOW)


def attempt(loop: CuttingLoop, journal: Journal, runs: Path, good: bool = True) -> bool:
    return commit(loop, NEW, journal, runs, NOW, lambda: good)


def count_operations(tmp_path: Path) -> int:
    loop = CuttingLoop(MemoryDrive())
    assert attempt(loop, begin(tmp_path / "count"), tmp_path / "count")
    return loop.operations


def test_a_commit_that_proves_itself_is_kept_and_backed_up(tmp_path: Path) -> None:
    drive, journal = MemoryDrive(), begin(tmp_path)
    assert attempt(CuttingLoop(drive), journal, tmp_path)
    assert drive.stored == NEW
    assert journal.state.phase is CommitPhase.KEPT
    assert load_backup(tmp_path, "axis", backup_ids(tmp_path, "axis")[0]).parameters == OLD


def test_a_commit_that_does_not_prove_itself_is_put_back(tmp_path: Path) -> None:
    drive, journal = MemoryDrive(), begin(tmp_path)
    assert not attempt(CuttingLoop(drive), journal, tmp_path, good=False)
    assert drive.stored == drive.volatile == OLD
    assert journal.state.phase is CommitPhase.RESTORED


@pytest.mark.parametrize("failure", [LinkError, Dead])
@pytest.mark.parametrize("power_cut", [False, True])
def test_a_commit_cut_at_any_operation_is_put_right_by_the_next_start(
    tmp_path: Path, failure: type[BaseException], power_cut: bool
) -> None:
    for cut in range(count_operations(tmp_path)):
        runs = tmp_path / f"{failure.__name__}-{power_cut}-{cut}"
        drive, journal = MemoryDrive(), begin(runs)
        with pytest.raises((failure, DriveError)):
            attempt(CuttingLoop(drive, cut, failure), journal, runs)
        if power_cut:
            drive.power_cycle()
        recover(CuttingLoop(drive), runs, next_start(runs))
        assert drive.stored == drive.volatile == OLD, f"cut at operation {cut}"
        assert all("040000" not in journal.directory.name for journal in unfinished(runs, "axis"))


def test_recovery_itself_may_be_cut_at_any_operation(tmp_path: Path) -> None:
    operations = count_operations(tmp_path)
    for cut in range(2 * operations):
        runs = tmp_path / f"again-{cut}"
        drive, journal = MemoryDrive(), begin(runs)
        with pytest.raises(Dead):
            attempt(CuttingLoop(drive, operations - 1, Dead), journal, runs)
        try:
            recover(CuttingLoop(drive, cut, Dead), runs, next_start(runs))
        except (Dead, DriveError):
            drive.power_cycle()
            recover(CuttingLoop(drive), runs, next_start(runs))
        assert drive.stored == drive.volatile == OLD, f"cut at operation {cut}"


def test_changed_limits_are_put_back_by_the_next_start(tmp_path: Path) -> None:
    drive, journal = MemoryDrive(), begin(tmp_path)
    drive.volatile["limit.torque"] = 0.2
    journal.note(stage="experiment", changed={"limit.torque": 1.34}, during={"limit.torque": 0.2})
    done = recover(CuttingLoop(drive), tmp_path, next_start(tmp_path))
    assert drive.volatile["limit.torque"] == 1.34
    assert "experiment" in done[0]
    assert "put back" in done[0]


def test_a_parameter_that_the_drive_does_not_know_stops_the_commit_before_anything_is_written(
    tmp_path: Path,
) -> None:
    drive, journal = MemoryDrive(), begin(tmp_path)
    with pytest.raises(ConfigurationError, match="cannot hold"):
        commit(CuttingLoop(drive), NEW | {"feedforward.magic": 1.0}, journal, tmp_path, NOW, lambda: True)
    assert drive.volatile == OLD
    assert not backup_ids(tmp_path, "axis")


def test_a_damaged_backup_is_refused(tmp_path: Path) -> None:
    attempt(CuttingLoop(MemoryDrive()), begin(tmp_path), tmp_path)
    identifier = backup_ids(tmp_path, "axis")[0]
    path = tmp_path / "backups" / "axis" / f"{identifier}.json"
    path.write_text(path.read_text().replace("0.1", "0.9"))
    with pytest.raises(ConfigurationError, match="checksum"):
        load_backup(tmp_path, "axis", identifier)


class SteppedLoop(CuttingLoop):
    """A drive whose parameters have whole steps of 0.001."""

    def write_parameters(self, values: Mapping[str, float]) -> None:
        super().write_parameters({name: round(value, 3) for name, value in values.items()})


def test_a_drive_with_coarse_steps_holds_the_nearest_and_is_verified_against_that(tmp_path: Path) -> None:
    drive, journal = MemoryDrive(), begin(tmp_path)
    wanted = NEW | {"feedforward.coulomb": 0.30049}
    assert commit(SteppedLoop(drive), wanted, journal, tmp_path, NOW, lambda: True)
    assert drive.stored["feedforward.coulomb"] == 0.3


def test_a_drive_that_cannot_come_near_is_refused_and_put_back(tmp_path: Path) -> None:
    drive, journal = MemoryDrive(), begin(tmp_path)
    with pytest.raises(DriveError, match="does not hold what was written"):
        commit(
            SteppedLoop(drive), NEW | {"feedforward.coulomb": 0.0104}, journal, tmp_path, NOW, lambda: True
        )
    assert drive.stored == drive.volatile == OLD
