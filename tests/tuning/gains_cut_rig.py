"""Gains committed to both simulated drives over their wires and cut wherever one likes; virtual time.

On the CiA 402 drive a cut is a byte (`cut_rig`), on the moteus a frame (`ripple_cut_rig`). The next start has to put
everything right: all gains old, or all new, in volatile memory and stored.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random

import pytest

from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.core.loop import LocalLoop
from autotune.tuning.commit import commit
from autotune.tuning.journal import Journal
from tests.tuning import cut_rig
from tests.tuning.cut_rig import NEVER, NOW, Case, Dead, afterwards, next_start
from tests.tuning.ripple_cut_rig import TableRig

MOTEUS_NEW = {"controller.kp": 75.0, "controller.kd": 0.25, "controller.ki": 15000.0}
POINTS = 2
"""Of moteus's table of torque ripple, which plays no part here."""
FIRST, SECOND, THIRD = (f"20261120-0{hour}0000-axis" for hour in (4, 5, 6))


@dataclass(frozen=True)
class Ending:
    """`wrong`: "" where all is well; `kept`: complete in spite of the cut; `mixed`: between cut and next start."""

    wrong: str
    kept: bool
    mixed: bool


class GainsRig(cut_rig.Rig):
    """The simulated CiA 402 drive behind its wire, seen by its gains (2000h)."""

    def volatile(self) -> dict[str, float]:
        return {name: float(self.device.objects[0x2000, k].value) for k, name in enumerate(cut_rig.BLOCK, 1)}

    def stored(self) -> dict[str, float]:
        values, entries = self.memory.read(), self.device.objects
        return {
            n: float(entries[0x2000, k].decode(values[0x2000, k])) for k, n in enumerate(cut_rig.BLOCK, 1)
        }


def use_gains(put: Callable[[object, str, object], None]) -> None:
    """The rig commits gains instead of a feedforward."""
    put(cut_rig, "Rig", GainsRig)
    put(cut_rig, "BLOCK", ("kp", "kd", "ki"))
    put(cut_rig, "OLD", {"kp": 60.0, "kd": 0.125, "ki": 6000.0})
    put(cut_rig, "NEW", {"kp": 75.0, "kd": 0.25, "ki": 15000.0})
    put(cut_rig, "parameters", lambda block: {f"controller.{name}": value for name, value in block.items()})


def canopen_cuts(folder: Path, places: int, seed: int) -> list[Ending]:
    """Commits of gains cut at random bytes."""
    with pytest.MonkeyPatch.context() as patched:
        use_gains(patched.setattr)
        random, stored = Random(seed), cut_rig.factory()
        whole = cut_rig.length(stored, folder / "whole")
        endings = [
            cut_rig.play(Case.draw(random, whole), stored, folder / str(number)) for number in range(places)
        ]
    return [Ending(one.wrong, one.kept, one.mixed) for one in endings]


def moteus_cuts(folder: Path, places: int, seed: int) -> list[Ending]:
    """The same on the moteus, at random frames."""
    random, whole = Random(seed), _frames(folder / "whole")
    return [_moteus_cut(Case.draw(random, whole), folder / str(number)) for number in range(places)]


def _frames(runs: Path) -> int:
    """Frames of a whole commit."""
    rig = TableRig({}, points=POINTS)
    with rig.time():
        if not _commits(rig, runs, NEVER):
            raise ConfigurationError("the commit that is to be cut does not work by itself")
    return rig.bytes


def _commits(rig: TableRig, runs: Path, cut: int) -> bool:
    directory = runs / FIRST
    directory.mkdir(parents=True)
    journal = Journal.begin(directory, "axis", "f00", NOW)
    loop = rig.open(runs / "sessions")
    rig.bytes, rig.cut = 0, cut
    try:
        return commit(loop, MOTEUS_NEW, journal, runs, NOW, lambda: True)
    finally:
        # a cut while it is closed comes after the commit's end, and takes nothing of it back
        with suppress(AutotuneError, Dead):
            loop.close()


def _moteus_cut(case: Case, runs: Path) -> Ending:
    rig = TableRig({}, points=POINTS)
    with rig.time():
        old = _held(rig, runs)
        rig.plug()
        rig.kind = case.kind
        try:
            kept = _commits(rig, runs, case.cut)
        except (Dead, AutotuneError):
            kept = False
        afterwards(rig, case)
        mixed = not _one_of(_held(rig, runs), old)
        if case.second_cut != NEVER:
            rig.cut, rig.kind = case.second_cut, "host"
            with suppress(Dead, AutotuneError):
                next_start(rig, runs, SECOND, rig.open(runs / "sessions"))
            afterwards(rig, case)
        next_start(rig, runs, THIRD, rig.open(runs / "sessions"))
        return Ending(_wrong(rig, runs, MOTEUS_NEW if kept else old), kept, mixed)


def _wrong(rig: TableRig, runs: Path, wanted: dict[str, float]) -> str:
    """In volatile memory, and after a loss of power."""
    for place in ("volatile", "stored"):
        found = _held(rig, runs)
        if found != pytest.approx(wanted, rel=1e-3):
            return f"{place} is {found} instead of {wanted}"
        rig.device.power_loss()
        rig.rest(1.0)
        rig.plug()
    return ""


def _one_of(found: dict[str, float], old: dict[str, float]) -> bool:
    return any(found == pytest.approx(whole, rel=1e-3) for whole in (old, MOTEUS_NEW))


def _held(rig: TableRig, runs: Path) -> dict[str, float]:
    loop: LocalLoop = rig.open(runs / "sessions")
    try:
        return loop.read_parameters(sorted(MOTEUS_NEW))
    finally:
        loop.close()
