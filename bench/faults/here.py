"""Cases on a drive in the program's own process."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from autotune_sim.truth import ROW, TruthFile, read_truth
from bench.faults.axis_file import command, simulated_link, write_axis
from bench.faults.cases import PREPARED, Case
from bench.faults.child import program, start
from bench.faults.evidence import Ending, Evidence, different
from bench.faults.host import TORN, prepare

PATIENCE = 60.0  # s without any work, of the rig for a case
TEMPLATE_PLANT = 7


def warm() -> None:
    """Loads what every case needs, so that forked processes have it."""
    import autotune.cli.check
    import autotune.cli.record
    import autotune.cli.run
    import autotune.monitoring.check
    import autotune.tuning.recording_run
    import autotune.tuning.run  # noqa: F401
    from autotune.core.drive import HOLD, Mode
    from autotune_sim.inprocess import open_sim

    drive = open_sim("sim://edm-vertical")
    for mode in Mode:
        drive.enable(mode)
        drive.step(HOLD)
        drive.disable()


def make_template(folder: Path) -> None:
    """One sound tuning run; its folder is what `run --only prove` and `--only commit` begin with."""
    case = Case(0, "template", "run", TEMPLATE_PLANT, ())
    ending, _ = _play(case, folder, "truth")
    if ending.code not in (0, 3):
        raise RuntimeError(f"the sound run that everything begins with failed: {ending.words[-400:]}")
    for recordings in folder.glob("runs/*/recordings"):
        shutil.rmtree(recordings)
    (folder / "mem").unlink(missing_ok=True)


def run_here(case: Case, folder: Path, template: Path | None) -> Evidence:
    """Plays the case; a second start follows where something was left."""
    if case.programme in PREPARED and template is not None:
        shutil.copytree(template / "runs", folder / "runs")
        case = replace(case, plant=TEMPLATE_PLANT)
    ending, truth = _play(case, folder, "truth")
    evidence = Evidence(case, ending, truth)
    left = _left(evidence)
    if not left:
        return evidence
    again, after = _play(replace(case, orders=(), host=None, programme="run --only check"), folder, "truth-2")
    now = Evidence(case, again, after)
    spent = replace(ending, cpu=ending.cpu + again.cpu)
    return replace(evidence, ending=spent, put_right=now.settings("closed"), next_words=again.words)


def _play(case: Case, folder: Path, log: str) -> tuple[Ending, TruthFile]:
    write_axis(case, folder, simulated_link(case, folder, log))

    def work() -> None:
        os.chdir(folder)
        prepare(case, folder)
        program(command(case, folder))

    killed = case.host is not None and case.host[1] == "torn"
    ending = start(work, folder / f"out-{log}.txt").wait(PATIENCE, killed)
    return ending, read_log(folder / log)


def read_log(path: Path) -> TruthFile:
    """The plant's log; an empty one where the program never got as far as the drive."""
    try:
        return read_truth(path)
    except (OSError, ValueError):
        return TruthFile(np.zeros(0, ROW), ())


def _left(evidence: Evidence) -> bool:
    """Whether the next start has something to put right."""
    if evidence.ending.code == TORN or (evidence.ending.code or 0) < 0:
        return True
    before, after = evidence.settings("open"), evidence.settings("closed")
    return (
        before is not None
        and after is not None
        and bool(different(before, after))
        and evidence.ending.code != 0
    )
