"""Two workers, forked from one warm process; results come back in the order in which they are ready."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from bench.faults.cases import Case
from bench.faults.evidence import Evidence
from bench.faults.here import run_here
from bench.faults.judge import Verdict, judge
from bench.faults.wire import run_wire

_MEMORY, _ROOM = Path("/dev/shm"), 2_000_000_000  # noqa: S108 - bytes; folders in it are made by mkdtemp


@dataclass(frozen=True)
class Result:
    """One line of the campaign."""

    seed: int
    kind: str
    done: str
    faults: str
    outcome: str
    code: int | None
    seconds: float
    cpu: float
    to_rest: float | None
    to_power_off: float | None
    findings: tuple[str, ...]

    def line(self) -> str:
        """For people."""
        said = "; ".join(self.findings) or "sound"
        code = "killed" if self.code is None else str(self.code)
        return f"{self.seed} {self.kind:6} {self.done} -> {self.outcome}, code {code}: {said}"


def play(case: Case, template: Path | None, keep: Path | None = None, unsound: Path | None = None) -> Result:
    """Plays one case in a folder of its own and judges it.

    `keep` is where the folder stays; `unsound`, where those of cases with findings are put.
    """
    folder = keep or Path(tempfile.mkdtemp(prefix="hurt-", dir=in_memory()))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        run = run_wire if case.kind in ("wire", "line") else run_here
        evidence = run(case, folder, template)
        found = result(evidence, judge(evidence))
        if found.findings and unsound is not None:
            shutil.copytree(folder, unsound / str(case.seed), symlinks=True, dirs_exist_ok=True)
        return found
    finally:
        if keep is None:
            shutil.rmtree(folder, ignore_errors=True)


def in_memory() -> Path | None:
    """Where files are memory alone: a disk that others keep busy must not hold up a simulated drive. None: nowhere."""
    try:
        room = shutil.disk_usage(_MEMORY)
    except OSError:
        return None
    return _MEMORY if room.free > _ROOM and os.access(_MEMORY, os.W_OK) else None


def result(evidence: Evidence, verdict: Verdict) -> Result:
    """What is kept of a case."""
    case, ending = evidence.case, evidence.ending
    names = [str(event.details.get("name")) for event in evidence.put_in]
    return Result(
        case.seed,
        case.kind,
        case.text(),
        " ".join(dict.fromkeys(names)),
        outcome(ending.words),
        ending.code,
        round(ending.ended - ending.began, 2),
        round(ending.cpu, 2),
        _rounded(verdict.to_rest),
        _rounded(verdict.to_power_off),
        verdict.findings,
    )


def outcome(words: str) -> str:
    """What the run called itself."""
    for mark, name in (
        ("Kept: ", "kept"),
        ("Rolled back", "rolled back"),
        ("guard stopped", "guard"),
        ("nterrupted", "interrupted"),
        ("reports a fault", "drive fault"),
        ("othing was applied", "not applied"),
        ("o parameters were applied", "not applied"),
        ("is done", "done"),
        (" samples, ", "done"),
        ("peak error", "done"),
    ):
        if mark in words:
            return name
    return words.partition("autotune: ")[2][:60] or words[-60:]


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)


def play_all(
    cases: Iterable[Case], template: Path | None, workers: int = 2, unsound: Path | None = None
) -> Iterator[Result]:
    """Plays many cases; call `here.warm` before."""
    context = multiprocessing.get_context("fork")
    with context.Pool(workers, initializer=_begin, initargs=(template, unsound)) as pool:
        yield from pool.imap_unordered(_work, cases)


_template: Path | None = None
_unsound: Path | None = None


def _begin(template: Path | None, unsound: Path | None) -> None:
    global _template, _unsound
    _template, _unsound = template, unsound


def _work(case: Case) -> Result:
    return play(case, _template, unsound=_unsound)
