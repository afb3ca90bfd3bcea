"""Commits over the real byte stream: cut anywhere, into a memory that keeps nothing, refused half-way.

`bench/commit_cut.py` plays many more cuts than these.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from autotune.core.errors import ConfigurationError, DriveError, TransferAborted
from autotune.core.loop import LocalLoop
from autotune.tuning.backup import backup_ids
from autotune.tuning.commit import commit
from autotune.tuning.journal import CommitPhase, Journal
from autotune_drivers.canopen.opening import open_drive
from autotune_drivers.profile import read_profile
from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.object_dictionary import Value
from tests.drivers.simulator import axis_of
from tests.tuning.cut_rig import (
    NEVER,
    NEW,
    NODE,
    NOW,
    OLD,
    Case,
    Rig,
    attempt,
    factory,
    length,
    parameters,
    play,
    virtual_time,
)

Stored = dict[tuple[int, int], bytes]
CUTS = 36


@pytest.fixture(scope="module")
def stored() -> Stored:
    return factory()


def test_a_commit_cut_at_any_byte_is_detected_and_repaired_by_the_next_start(
    stored: Stored, tmp_path: Path
) -> None:
    whole = length(stored, tmp_path / "whole")
    random = Random(20261120)
    endings = {}
    for number in range(CUTS):
        case = Case.draw(random, whole)
        endings[case] = play(case, stored, tmp_path / str(number))
    assert {case: ending.wrong for case, ending in endings.items() if ending.wrong} == {}
    mixed = sum(ending.mixed for ending in endings.values())
    assert CUTS / 10 < mixed < CUTS  # the cuts do leave mixed parameters: the test can fail
    assert sum(ending.changed for ending in endings.values()) > CUTS / 4  # and settings of the session


def test_a_commit_that_is_not_cut_is_kept(stored: Stored, tmp_path: Path) -> None:
    ending = play(Case(NEVER, "host", power_cycle=True, second_cut=NEVER), stored, tmp_path)
    assert not ending.wrong
    assert ending.kept


def test_a_memory_that_keeps_nothing_is_detected_and_nothing_is_kept(stored: Stored, tmp_path: Path) -> None:
    rig = Rig(stored)
    rig.memory.lossy = True
    with virtual_time(rig), pytest.raises(DriveError, match="does not keep what is stored"):
        attempt(rig, tmp_path, "20261120-040000-axis")
    assert rig.volatile() == pytest.approx(OLD)
    assert Journal.load(tmp_path / "20261120-040000-axis").state.phase is CommitPhase.RESTORED


def test_a_refused_parameter_is_named_with_its_object_and_the_reason_and_all_is_put_back(
    stored: Stored, tmp_path: Path
) -> None:
    rig = Rig(stored)
    entry = rig.device.objects[0x2100, 7]
    taken = entry.write

    def picky(value: Value) -> None:
        if value == NEW["stiffness"]:
            raise Abort(AbortCode.TOO_HIGH)
        assert taken is not None
        taken(value)

    entry.write = picky
    with virtual_time(rig), pytest.raises(TransferAborted) as caught:
        attempt(rig, tmp_path, "20261120-040000-axis")
    for part in ("feedforward.stiffness", "2100h:07", "06090031h", "choose a smaller value"):
        assert part in str(caught.value)
    assert Journal.load(tmp_path / "20261120-040000-axis").state.phase is CommitPhase.RESTORED
    assert rig.stored() == pytest.approx(OLD)
    assert rig.volatile() == pytest.approx(OLD)


def test_a_value_outside_the_drives_range_is_refused_before_anything_is_written(
    stored: Stored, tmp_path: Path
) -> None:
    rig = Rig(stored)
    rig.device.objects[0x2100, 1].put(0)  # as during a run: the drive's own feedforward is off
    directory = tmp_path / "20261120-040000-axis"
    directory.mkdir()
    journal = Journal.begin(directory, "axis", "f00", NOW)
    writes: list[int] = []
    rig.device.on_write = lambda entry: writes.append(entry.index)
    with virtual_time(rig):
        loop = LocalLoop(open_drive(rig, NODE, axis_of(), read_profile("autotune-sim")))
        with pytest.raises(
            ConfigurationError, match=r"feedforward\.coulomb is 1000; this drive allows 0 to 100"
        ):
            commit(loop, parameters(NEW | {"coulomb": 1e3}), journal, tmp_path, NOW, lambda: True)
        loop.close()
    assert not [index for index in writes if index == 0x2100]


def test_limits_that_a_run_has_narrowed_are_not_stored(stored: Stored, tmp_path: Path) -> None:
    """A drive that stores everything at once (1010h:01) would keep them for good."""
    rig = Rig(stored)
    profile = read_profile("autotune-sim")
    everything = profile.model_copy(update={"store": profile.store and profile.store.model_copy(
        update={"at": profile.store.at.__class__.parse("1010:01 u32")})})  # fmt: skip
    directory = tmp_path / "20261120-040000-axis"
    directory.mkdir()
    journal = Journal.begin(directory, "axis", "f00", NOW)
    with virtual_time(rig):
        loop = LocalLoop(open_drive(rig, NODE, axis_of(), everything))
        before = loop.read_parameters(["limit.torque"])
        journal.note(changed=before)
        loop.write_parameters({"limit.torque": 0.5 * before["limit.torque"]})
        assert commit(loop, parameters(NEW), journal, tmp_path, NOW, lambda: True)
        assert loop.read_parameters(["limit.torque"])["limit.torque"] == 0.5 * before["limit.torque"]
        loop.close()
        rig.device.power_loss()
        rig.rest(1.0)
        again = LocalLoop(open_drive(rig, NODE, axis_of(), everything))
        assert again.read_parameters(["limit.torque"]) == before
        again.close()
    assert len(backup_ids(tmp_path, "axis")) == 1
