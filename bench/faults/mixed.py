"""`python -m bench.faults.mixed`: whole tuning runs on axes of which some must be refused.

    python -m bench.faults.mixed --seed 1 --runs 500 [--unfit NAME] [--out FILE]
    python -m bench.faults.mixed --table FILE

Nobody may be left with a worse axis. After each run the drive alone, with what is stored in it, plays motions
that the run has never seen, on the plant, before and after; the true position of motor and of load is compared
with the target, without any sensor between. A run that has kept something and made one of these motions worse
is a regression; an unfit axis (`autotune_sim.unfit`) must end with code 3.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from autotune.core.drive import Command, Mode
from autotune_sim.effects import EFFECTS
from autotune_sim.inprocess import SimDrive, open_sim
from autotune_sim.unfit import UNFIT

REFUSED = 3
WORSE = 0.03
"""Relative rise of the rms error that counts: the same noise is drawn before and after, so that less is ripple."""
_UNFIT_SHARE = 0.4
_SECONDS = 6.0
_WARM_UP = 1.0  # s that are not judged
_PLANTED = ("stribeck", "torque_ripple", "direction_asymmetry", "nonlinear_viscous", "reversal_memory",
            "position_dependent_friction", "dwell_time_break_away", "elastic_transmission", "torque_lag",
            "gravity_imbalance", "load_dependent_friction")  # fmt: skip


def _moves(t: float) -> float:
    """Half a turn there and back, quintic."""
    phase = math.fmod(t, 3.0) / 1.5
    s = phase if phase <= 1.0 else 2.0 - phase
    return math.pi * s**3 * (10.0 + s * (6.0 * s - 15.0))


def _waves(t: float) -> float:
    """Two sines without a common period, from rest."""
    fade = min(t / _WARM_UP, 1.0)
    return fade * (0.15 * math.sin(2.0 * math.pi * 0.63 * t) + 0.05 * math.sin(2.0 * math.pi * 1.9 * t))


def _creep(t: float) -> float:
    """Small and slow: reversals in presliding."""
    return 0.03 * math.sin(2.0 * math.pi * 0.2 * t)


MOTIONS: dict[str, Callable[[float], float]] = {"moves": _moves, "waves": _waves, "creep": _creep}
"""Held-out motions: position [rad] over time [s]."""


@dataclass(frozen=True)
class Mixed:
    """One run: which axis, how it ended, and rms errors before and after by motion and side [rad]."""

    seed: int
    link: str
    unfit: str
    code: int | None
    outcome: str
    verdict: str
    cpu: float
    before: dict[str, float]
    after: dict[str, float]

    @property
    def worse(self) -> dict[str, float]:
        """Motions that are worse than before, with their ratio."""
        ratios = {name: _ratio(error, self.after[name]) for name, error in self.before.items()}
        return {name: ratio for name, ratio in ratios.items() if ratio > 1.0 + WORSE}

    @property
    def regression(self) -> bool:
        return bool(self.worse)

    @property
    def wrong(self) -> str:
        """What must not be; empty for a run as it should be."""
        if self.regression:
            name, ratio = max(self.worse.items(), key=lambda item: item[1])
            return f"{name} {ratio:.2f} times as large as before"
        if self.unfit and self.code != REFUSED:
            return f"not refused: code {self.code}"
        return ""

    def line(self) -> str:
        shares = [f"{name} {_ratio(self.before[name], self.after[name]):.2f}" for name in self.before]
        said = self.wrong or "as it should be"
        axis = self.link.partition("?")[2]
        return f"{self.seed} {axis} -> {self.outcome}, code {self.code}; {', '.join(shares)}: {said}"


def _ratio(before: float, after: float) -> float:
    """After over before; a motion that the axis could not do before cannot become worse."""
    return after / before if 0.0 < before < math.inf else 1.0


def draw_link(seed: int, unfit: str | None = None) -> tuple[str, str]:
    """The simulated axis of a seed, and the name of what makes it unfit, empty where it is fit."""
    random = np.random.default_rng([seed, 71])
    parts = [f"seed={int(random.integers(1, 100_000))}"]
    kind = (
        unfit
        if unfit is not None
        else str(random.choice(list(UNFIT)) if random.random() < _UNFIT_SHARE else "")
    )
    if kind:
        parts.append(f"unfit={kind}:{random.uniform():.3f}")
    else:
        for name in random.choice(_PLANTED, int(random.integers(0, 3)), replace=False):
            parts.append(f"effect={name}:{EFFECTS[str(name)].default * random.uniform(0.5, 2.0):.4g}")
    return f"sim://edm-vertical?{'&'.join(parts)}", kind


def held_out(drive: SimDrive) -> dict[str, float]:
    """Rms error of each motion, of the motor and of the load, on the plant [rad]; infinite where it faulted."""
    errors: dict[str, float] = {}
    for name, motion in MOTIONS.items():
        motor, load = _play(drive, motion)
        errors[f"{name} motor"], errors[f"{name} load"] = motor, load
    return errors


def _play(drive: SimDrive, motion: Callable[[float], float]) -> tuple[float, float]:
    h, servo = drive.period, drive.servo
    drive.reset_faults()
    drive.enable(Mode.POSITION)
    start = servo.position
    apart = []
    try:
        try:
            for k in range(round(_SECONDS / h)):
                target = start + motion(k * h)
                apart.append((target - servo.true_position, target - servo.true_load_position))
                drive.step(Command(position=target))
        finally:
            drive.disable()
    except Exception:  # noqa: BLE001 - a drive that stops on such a motion, or after it, has the worst of all errors
        return math.inf, math.inf
    judged = np.array(apart[round(_WARM_UP / h) :])
    motor, load = np.sqrt(np.mean(judged**2, axis=0))
    return float(motor), float(load)


def play(seed: int, unfit: str | None = None) -> Mixed:
    """One whole run, and its axis before and after."""
    from bench.faults.axis_file import command, write_axis
    from bench.faults.cases import Case
    from bench.faults.child import program, start
    from bench.faults.pool import outcome

    link, kind = draw_link(seed, unfit)
    folder = Path(tempfile.mkdtemp(prefix="mixed-"))
    try:
        case = Case(seed, "mixed", "run", 0, ())
        write_axis(case, folder, f"{link}&memory={folder / 'mem'}")
        ending = start(lambda: program(command(case, folder)), folder / "out.txt").wait(60.0)
        before = held_out(open_sim(link))
        after = held_out(open_sim(f"{link}&memory={folder / 'mem'}"))
        said = outcome(ending.words)
        return Mixed(
            seed, link, kind, ending.code, said, ending.words[-300:], round(ending.cpu, 2), before, after
        )
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def table(results: Sequence[Mixed]) -> str:
    """By kind of axis, in Markdown."""
    lines = [
        "| axis | runs | kept | code 3 | regressions | not as it should be |",
        "|---|---|---|---|---|---|",
    ]
    for kind in ["", *UNFIT]:
        mine = [result for result in results if result.unfit == kind]
        if mine:
            lines.append(_row(kind or "fit", mine))
    lines.append(_row("all", list(results)))
    return "\n".join(lines)


def _row(name: str, results: Sequence[Mixed]) -> str:
    wrong = [result for result in results if result.wrong]
    shown = "; ".join(f"{result.seed}: {result.wrong}" for result in wrong[:4]) or "none"
    counts = (
        len(results),
        sum(result.code == 0 for result in results),
        sum(result.code == REFUSED for result in results),
        sum(result.regression for result in results),
    )
    return f"| {name} | {' | '.join(map(str, counts))} | {shown} |"


def read_results(path: Path | None) -> list[Mixed]:
    """Results of a file of JSON lines."""
    if path is None or not path.is_file():
        return []
    return [Mixed(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines() if line]


def _work(job: tuple[int, str | None]) -> Mixed:
    return play(*job)


def main(arguments: Sequence[str] | None = None) -> int:
    """Plays runs; 1 where one was not as it should be."""
    import multiprocessing

    from bench.faults.here import warm

    parser = argparse.ArgumentParser(prog="python -m bench.faults.mixed")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--unfit", choices=["", *UNFIT], help="only such axes; empty: only fit ones")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="results as JSON lines; runs in it are not played again")
    parser.add_argument("--table", type=Path, help="print such a file, play nothing")
    options = parser.parse_args(arguments)
    if options.table is not None:
        sys.stdout.write(table(read_results(options.table)) + "\n")
        return 0
    known = {result.seed for result in read_results(options.out)}
    jobs = [(s, options.unfit) for s in range(options.seed, options.seed + options.runs) if s not in known]
    warm()
    results = []
    with multiprocessing.get_context("fork").Pool(options.workers) as pool:
        for result in pool.imap_unordered(_work, jobs):
            results.append(result)
            sys.stdout.write(result.line() + "\n")
            sys.stdout.flush()
            if options.out is not None:
                with options.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(result)) + "\n")
    sys.stdout.write("\n" + table(results) + "\n")
    return int(any(result.wrong for result in results))


if __name__ == "__main__":
    sys.exit(main())
