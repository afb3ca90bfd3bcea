"""Tables in the drive: aligned, committed, cut anywhere, judged by the plant, and a commutation that moved.

`bench/ripple_stored.py` plays many more axes and cuts than these.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from autotune.core.errors import ConfigurationError
from autotune.core.ripple_parameters import GAIN
from autotune.tuning.backup import Backup, backup_ids, load_backup, take_backup
from autotune.tuning.commit import commit, feedforward_parameters, must_be_aligned
from autotune.tuning.journal import Journal
from autotune_sim.presets import preset
from tests.tuning.cut_rig import NEVER, NOW, Case
from tests.tuning.ripple_cut_rig import RIGS, HarmonicsRig, TableRig, factory, length, play, wanted
from tests.tuning.ripple_rig import judged, model_of, planted

CUTS = {"harmonics": 5, "table": 3, "velocity": 5}
LEAST = 0.9  # of the planted ripple that has to be gone
KINDS = pytest.mark.parametrize("kind", sorted(RIGS))
HOLDS_RIPPLE = pytest.mark.parametrize("kind", ["harmonics", "table"])


@KINDS
def test_a_commit_cut_anywhere_is_put_right_by_the_next_start(kind: str, tmp_path: Path) -> None:
    stored = factory(kind)
    whole = length(kind, stored, tmp_path / "whole")
    random = Random(7)
    for number in range(CUTS[kind]):
        case = Case.draw(random, whole)
        assert play(kind, case, stored, tmp_path / str(number)).wrong == "", case


@KINDS
def test_what_is_committed_is_there_after_a_power_loss(kind: str, tmp_path: Path) -> None:
    ending = play(kind, Case(NEVER, "host", power_cycle=True, second_cut=NEVER), factory(kind), tmp_path)
    assert ending.wrong == ""
    assert ending.kept


@pytest.mark.long
@HOLDS_RIPPLE
def test_what_is_stored_takes_nine_tenths_of_the_planted_ripple_away(kind: str, tmp_path: Path) -> None:
    axis = planted(1)
    found = judged(kind, axis, model_of(axis), tmp_path)
    assert not isinstance(found.plan, str), found.plan
    assert found.same
    assert LEAST <= found.torque <= 1.0  # over one turn of the plant
    assert LEAST <= found.speed <= 1.0  # of the true speed, without a host
    turn = 6.283185307179586 / 12.0  # orders 12 and 24 look alike after it
    zero = -6.283185307179586 * axis.commutation_offset
    apart = (found.plan.alignment.zero - zero + 0.5 * turn) % turn - 0.5 * turn
    assert abs(apart) < 0.015  # the model's phase is 0.05 rad of order 12 beside the truth, 4 mrad of a turn


@pytest.mark.long
def test_a_model_whose_ripple_is_not_the_axis_s_is_not_written(tmp_path: Path) -> None:
    axis, other = planted(1), planted(2)
    found = judged("harmonics", axis, model_of(other, amplitude=4.0), tmp_path)
    assert isinstance(found.plan, str)
    assert "stays with the host" in found.plan
    assert "check the drive's torque constant" in found.plan


@HOLDS_RIPPLE
def test_a_commutation_that_moved_since_is_detected_and_refused(kind: str, tmp_path: Path) -> None:
    rig = RIGS[kind](factory(kind))
    with rig.time():
        directory = tmp_path / "20261120-040000-axis"
        directory.mkdir()
        journal = Journal.begin(directory, "axis", "f00", NOW)
        loop = rig.open(tmp_path / "sessions")
        assert commit(loop, wanted(rig, loop, "new"), journal, tmp_path, NOW, lambda: True)
        loop.close()
        _move(rig)
        loop = rig.open(tmp_path / "sessions")
        backup = _newest(tmp_path)
        before = feedforward_parameters(loop)
        with pytest.raises(ConfigurationError, match=r"aligned with another commutation.*was .* and is"):
            must_be_aligned(loop, backup)
        assert feedforward_parameters(loop) == before
        loop.close()


def _move(rig: HarmonicsRig | TableRig) -> None:
    """Somebody sets the zero of the commutation encoder anew."""
    if isinstance(rig, TableRig):
        rig.device._plain["motor_position.sources.0.offset"].value = 1234.0
    else:
        rig.device.firmware.servo.ripple["offset"] += 0.1


def _newest(runs: Path) -> Backup:
    return load_backup(runs, "axis", backup_ids(runs, "axis")[-1])


def test_a_backup_without_ripple_asks_for_no_commutation(tmp_path: Path) -> None:
    rig = HarmonicsRig({}, preset("edm-vertical"))
    with rig.time():
        loop = rig.open(tmp_path / "sessions")
        zero = {"alignment.32E7h:02": 1.0}
        held = feedforward_parameters(loop)
        must_be_aligned(loop, take_backup(tmp_path, "axis", loop.identity, held, NOW, zero))
        ripple = {**held, "feedforward.ripple.torque.0": 0.01, GAIN: 1.0}
        holds = take_backup(tmp_path, "axis", loop.identity, ripple, NOW, zero)
        with pytest.raises(ConfigurationError, match="32E7h:02 was 1 and is"):
            must_be_aligned(loop, holds)
        loop.close()
