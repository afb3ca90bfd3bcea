"""What the next start makes of a journal: another drive, a drive changed since, damaged files, clocks that jump."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError, DriveError, IdentityMismatch, LinkError
from autotune.tuning import journal as journal_module
from autotune.tuning.backup import Backup, backup_ids, load_backup, take_backup
from autotune.tuning.commit import commit
from autotune.tuning.committed import in_force
from autotune.tuning.journal import COPY_NAME, FILE_NAME, CommitPhase, Journal, unfinished
from autotune.tuning.recovery import misfits, recover
from autotune.tuning.rollback import roll_back
from autotune.tuning.run_directory import make_run_directory
from tests.drivers.simulator import axis_of
from tests.tuning.test_commit import NEW, NOW, OLD, CuttingLoop, Dead, MemoryDrive

FOREIGN = {"feedforward.enabled": 1.0, "feedforward.coulomb": 0.7, "feedforward.stiffness": 70.0}


def loop_of(drive: MemoryDrive, serial: int = 1000) -> CuttingLoop:
    loop = CuttingLoop(drive)
    loop.identity = {"vendor": 1, "product": 2, "serial": serial}
    return loop


def begin(runs: Path, now: datetime = NOW, axis: str = "axis") -> Journal:
    return Journal.begin(make_run_directory(runs, axis, now), axis, "f00", now)


def killed_while_proving(runs: Path, drive: MemoryDrive, serial: int = 1000, axis: str = "axis") -> Journal:
    journal = begin(runs, axis=axis)
    loop = loop_of(drive, serial)

    def gone(values: Mapping[str, float]) -> None:
        raise Dead

    def proves() -> bool:
        loop.write_parameters = gone  # type: ignore[method-assign]
        raise Dead

    with pytest.raises(Dead):
        commit(loop, NEW, journal, runs, NOW, proves)
    assert drive.stored == NEW
    return journal


# Another drive


def test_another_drive_is_not_written_to_and_the_journal_waits_for_its_own(tmp_path: Path) -> None:
    first, second = MemoryDrive(), MemoryDrive()
    killed_while_proving(tmp_path, first)
    second.volatile = second.stored = dict(FOREIGN)
    (told,) = recover(loop_of(second, 1007), tmp_path, begin(tmp_path))
    assert second.stored == second.volatile == FOREIGN
    for part in ("serial is 1007 instead of 1000", "nothing of that was written", "connected again"):
        assert part in told
    assert "20261120-040000-axis" in [journal.directory.name for journal in unfinished(tmp_path, "axis")]
    (told,) = [one for one in recover(loop_of(first), tmp_path, begin(tmp_path)) if "commit" in one]
    assert told.endswith("put back")
    assert first.stored == first.volatile == OLD


def test_limits_of_another_drive_are_left_alone(tmp_path: Path) -> None:
    journal, drive = begin(tmp_path), MemoryDrive()
    journal.note(
        identity={"vendor": 1, "product": 2, "serial": 1000},
        changed={"limit.torque": 1.34},
        during={"limit.torque": 0.2},
    )
    drive.volatile["limit.torque"] = 0.2
    (told,) = recover(loop_of(drive, 1007), tmp_path, begin(tmp_path))
    assert "another one" in told
    assert drive.volatile["limit.torque"] == 0.2


def test_new_firmware_does_not_make_another_drive_of_it(tmp_path: Path) -> None:
    drive = MemoryDrive()
    killed_while_proving(tmp_path, drive)
    loop = loop_of(drive)
    loop.identity = {**loop.identity, "revision": 9, "firmware": "2.0"}
    recover(loop, tmp_path, begin(tmp_path))
    assert drive.stored == OLD


# The same drive, changed since


def test_a_drive_that_somebody_has_changed_since_is_not_written_to(tmp_path: Path) -> None:
    drive = MemoryDrive()
    killed_while_proving(tmp_path, drive)
    drive.volatile = dict(drive.volatile) | {"feedforward.coulomb": 0.7}
    before = dict(drive.volatile)
    with pytest.raises(DriveError) as caught:
        recover(loop_of(drive), tmp_path, begin(tmp_path))
    for part in (
        "feedforward.coulomb is 0.7 instead of 0.1 or 0.3",
        "--to 20261120-040000-1",
        "journal*.json",
    ):
        assert part in str(caught.value)
    assert drive.volatile == before
    assert drive.stored == NEW


def test_a_rollback_is_a_persons_word_and_settles_it(tmp_path: Path) -> None:
    axis, drive = axis_of(), MemoryDrive()
    killed_while_proving(tmp_path, drive, axis=axis.name)
    drive.volatile = dict(drive.volatile) | {"feedforward.coulomb": 0.7}
    told: list[str] = []
    roll_back(axis, lambda: loop_of(drive), tmp_path, NOW, backup_ids(tmp_path, axis.name)[0], told.append)
    assert drive.stored == drive.volatile == OLD
    assert unfinished(tmp_path, axis.name) == []
    assert any("0.7" in sentence for sentence in told)


@pytest.mark.parametrize(("serial", "waits"), [(1000, False), (1007, True)])
def test_a_rollback_to_another_backup_settles_a_run_whose_own_is_damaged(
    tmp_path: Path, serial: int, waits: bool
) -> None:
    """But for a run on another drive, which waits for that."""
    axis, drive = axis_of(), MemoryDrive()
    journal = killed_while_proving(tmp_path, drive, axis=axis.name)
    journal.note(identity=loop_of(drive).identity)
    damage(tmp_path / "backups" / axis.name, f"{journal.state.backup}.json")
    other = take_backup(tmp_path, axis.name, loop_of(drive, serial).identity, FOREIGN, NOW)
    told: list[str] = []
    roll_back(axis, lambda: loop_of(drive, serial), tmp_path, NOW, other.id, told.append)
    assert drive.stored == drive.volatile == FOREIGN
    assert any("damaged and is not used" in sentence for sentence in told)
    assert [one.directory for one in unfinished(tmp_path, axis.name)] == [journal.directory] * waits


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from([0, 1]), min_size=3, max_size=3), st.integers(0, 2), st.floats(0.0, 100.0))
def test_any_mix_of_old_and_new_is_put_back_and_nothing_else_is(
    mix: list[int], place: int, foreign: float
) -> None:
    """As a run cut off while it wrote can have left it; one foreign value, and nothing is written."""
    journal = Journal(Path("x"), journal_module.JournalState("axis", "f", "t", 1, written=NEW))
    backup = Backup("b", "axis", "t", {}, OLD)
    held = {name: (OLD, NEW)[choice][name] for choice, name in zip(mix, OLD, strict=True)}
    assert misfits(journal, backup, held) == []
    name = list(OLD)[place]
    held[name] = foreign
    near = any(abs(foreign - value) <= 0.03 * abs(value) + 1e-6 for value in (OLD[name], NEW[name], 0.0))
    if not near:
        assert len(misfits(journal, backup, held)) == 1


# Rollback


def test_a_rollback_takes_the_newest_backup_of_this_drive(tmp_path: Path) -> None:
    axis = axis_of()
    mine, other = MemoryDrive(), MemoryDrive()
    for drive, serial in ((mine, 1000), (other, 1007)):
        identity = loop_of(drive, serial).identity
        take_backup(tmp_path, axis.name, identity, OLD | {"feedforward.coulomb": serial * 1e-3}, NOW)
    mine.volatile = mine.stored = dict(NEW)
    chosen = roll_back(axis, lambda: loop_of(mine), tmp_path, NOW)
    assert chosen.parameters["feedforward.coulomb"] == 1.0
    assert mine.stored["feedforward.coulomb"] == 1.0


def test_a_rollback_to_another_drives_backup_writes_nothing(tmp_path: Path) -> None:
    axis, drive = axis_of(), MemoryDrive()
    take_backup(tmp_path, axis.name, loop_of(drive, 1007).identity, NEW, NOW)
    with pytest.raises(IdentityMismatch, match="serial is 1000 instead of 1007"):
        roll_back(axis, lambda: loop_of(drive), tmp_path, NOW)
    assert drive.stored == OLD
    assert unfinished(tmp_path, axis.name) == []


@pytest.mark.parametrize("cut", range(14))
def test_a_rollback_cut_anywhere_is_finished_by_the_next_start(tmp_path: Path, cut: int) -> None:
    axis, drive = axis_of(), MemoryDrive()
    take_backup(tmp_path, axis.name, loop_of(drive).identity, OLD, NOW)
    drive.volatile = drive.stored = dict(NEW)
    loop = CuttingLoop(drive, cut, Dead)
    loop.identity = loop_of(drive).identity
    try:
        roll_back(axis, lambda: loop, tmp_path, NOW)
    except (Dead, DriveError):
        drive.power_cycle()
        recover(loop_of(drive), tmp_path, begin(tmp_path, axis=axis.name))
    assert drive.stored == drive.volatile
    assert drive.stored in (OLD, NEW)  # wholly the one or wholly the other
    assert [one for one in unfinished(tmp_path, axis.name) if one.state.left_something] == []


class FailingAtItsEnd(CuttingLoop):
    """The link is lost as it is closed."""

    def close(self) -> None:
        raise LinkError("the wire was cut")


@pytest.mark.parametrize("loop", [CuttingLoop(MemoryDrive(), 7, Dead), FailingAtItsEnd(MemoryDrive())])
def test_a_run_is_not_in_force_any_more_after_a_rollback_that_was_cut(
    tmp_path: Path, loop: CuttingLoop
) -> None:
    axis, drive = axis_of(), MemoryDrive()
    journal = begin(tmp_path, axis=axis.name)
    journal.note(fingerprint=axis.fingerprint)
    assert commit(loop_of(drive), NEW, journal, tmp_path, NOW, lambda: True)
    recover(loop_of(drive), tmp_path, begin(tmp_path, axis=axis.name))
    loop.drive, loop.identity = drive, loop_of(drive).identity
    with pytest.raises((Dead, LinkError)):
        roll_back(axis, lambda: loop, tmp_path, NOW)
    if drive.stored != OLD:
        recover(loop_of(drive), tmp_path, begin(tmp_path, axis=axis.name))
    assert drive.stored == drive.volatile == OLD
    assert in_force(tmp_path, axis, drive.volatile).committed is None


# Damage


def damage(directory: Path, *names: str) -> None:
    for name in names:
        path = directory / name
        path.write_bytes(path.read_bytes()[:-40])


@pytest.mark.parametrize("name", [FILE_NAME, COPY_NAME])
def test_one_damaged_copy_of_a_journal_is_no_loss(tmp_path: Path, name: str) -> None:
    drive = MemoryDrive()
    damage(killed_while_proving(tmp_path, drive).directory, name)
    recover(loop_of(drive), tmp_path, begin(tmp_path))
    assert drive.stored == drive.volatile == OLD


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"schema": 2}', '{"schema": 7}', '{"schema": 1}', "[" * 100_000]
)
def test_a_damaged_journal_stops_everything_until_a_person_has_looked(tmp_path: Path, text: str) -> None:
    axis, drive = axis_of(), MemoryDrive()
    directory = killed_while_proving(tmp_path, drive, axis=axis.name).directory
    for name in (FILE_NAME, COPY_NAME):
        (directory / name).write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        recover(loop_of(drive), tmp_path, begin(tmp_path, axis=axis.name))
    for part in (
        str(directory / FILE_NAME),
        "nothing moves",
        "'autotune rollback'",
        "20261120-040000-1.json",
    ):
        assert part in str(caught.value)
    assert drive.stored == NEW
    roll_back(axis, lambda: loop_of(drive), tmp_path, NOW)
    assert drive.stored == drive.volatile == OLD
    recover(loop_of(drive), tmp_path, begin(tmp_path, axis=axis.name))  # nothing stops the next one


def test_a_journal_damaged_long_after_its_drive_was_found_in_order_stops_nothing(tmp_path: Path) -> None:
    drive = MemoryDrive()
    old = begin(tmp_path)
    old.close("not_applied")
    later = begin(tmp_path)
    later.note(identity=loop_of(drive).identity)
    recover(loop_of(drive), tmp_path, later)
    later.close("not_applied")
    damage(old.directory, FILE_NAME, COPY_NAME)
    assert recover(loop_of(drive), tmp_path, begin(tmp_path)) == []
    with pytest.raises(ConfigurationError, match="damaged"):
        recover(loop_of(drive, 1007), tmp_path, begin(tmp_path))


def test_every_flipped_bit_of_a_journal_is_found(tmp_path: Path) -> None:
    journal = begin(tmp_path)
    journal.note(phase=CommitPhase.PROVING, written=NEW, backup="b")
    path, sound = journal.directory / FILE_NAME, (journal.directory / FILE_NAME).read_bytes()
    (journal.directory / COPY_NAME).unlink()
    for place in range(0, len(sound), 7):
        flipped = bytearray(sound)
        flipped[place] ^= 1 << place % 8
        path.write_bytes(flipped)
        try:
            state = Journal.load(journal.directory).state
        except ConfigurationError:
            continue
        assert state == journal.state, f"bit {place % 8} of byte {place}"


@pytest.mark.parametrize("value", ["NaN", "Infinity", '"0.1"', "null"])
def test_a_backup_with_what_is_no_number_is_refused_in_words(tmp_path: Path, value: str) -> None:
    backup = take_backup(tmp_path, "axis", {}, OLD, NOW)
    path = tmp_path / "backups" / "axis" / f"{backup.id}.json"
    path.write_text(path.read_text().replace("0.1", value))
    with pytest.raises(ConfigurationError, match="damaged and is not used"):
        load_backup(tmp_path, "axis", backup.id)


def test_a_drive_that_holds_no_number_cannot_be_backed_up_and_is_not_changed(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be written"):
        take_backup(tmp_path, "axis", {}, OLD | {"feedforward.offset": float("nan")}, NOW)


# Clocks


@pytest.mark.parametrize(
    "then", [datetime(1970, 1, 1, 0, 0, 7), datetime(1999, 12, 31), datetime(2099, 1, 1)]
)
def test_a_clock_that_is_wrong_hides_no_journal(tmp_path: Path, then: datetime) -> None:
    drive = MemoryDrive()
    journal = begin(tmp_path, then)
    journal.note(changed={"limit.torque": 1.34}, during={"limit.torque": 0.2})
    drive.volatile["limit.torque"] = 0.2
    recover(loop_of(drive), tmp_path, begin(tmp_path))
    assert drive.volatile["limit.torque"] == 1.34


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(-60 * 365 * 86400, 60 * 365 * 86400), min_size=2, max_size=6))
def test_runs_are_in_the_order_in_which_they_were_made_however_the_clock_jumps(
    tmp_path_factory: pytest.TempPathFactory, jumps: list[int]
) -> None:
    runs = tmp_path_factory.mktemp("runs")
    made = [begin(runs, NOW + timedelta(seconds=jump)).directory.name for jump in jumps]
    assert [journal.directory.name for journal in unfinished(runs, "axis")] == made[::-1]


# A full disk


def test_a_note_that_the_disk_does_not_take_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A commit whose last word is not on disk is put back: the next start would do the same."""
    drive, journal = MemoryDrive(), begin(tmp_path)

    def full(path: Path, content: object) -> None:
        raise OSError(28, "No space left on device", os.fspath(path))

    def proves() -> bool:
        monkeypatch.setattr(journal_module, "write_checked", full)
        return True

    with pytest.raises(DriveError, match="No space left on device"):
        commit(loop_of(drive), NEW, journal, tmp_path, NOW, proves)
    assert drive.stored == drive.volatile == OLD
    assert journal.state.phase is CommitPhase.PROVING
    assert json.loads((journal.directory / FILE_NAME).read_text())["phase"] == "proving"


def test_a_run_that_was_kept_and_cut_off_is_completed_and_known_as_kept(tmp_path: Path) -> None:
    drive, journal, axis = MemoryDrive(), begin(tmp_path, axis=axis_of().name), axis_of()
    journal.note(fingerprint=axis.fingerprint)
    assert commit(loop_of(drive), NEW, journal, tmp_path, NOW, lambda: True)
    (told,) = recover(loop_of(drive), tmp_path, begin(tmp_path, axis=axis.name))
    assert "a commit that was kept" in told
    assert drive.stored == NEW
    present = in_force(tmp_path, axis, drive.volatile)
    assert present.committed is not None
    assert (present.committed.run, present.held) == (journal.directory.name, True)
