"""Whole tuning runs in process, on presets varied by ±20 %: what they prove, and what they leave in the drive.

    python -m bench.tuning --seed S [--axes N] [--tree DIR]

Axis k is `edm-vertical` or `lugre` in turn with seed S + k, tuned by `autotune run` of the tree named, in a process of
its own, so that an earlier state of the code can be measured beside this one. A line a run, and a summary: peak errors
of the averaged benchmark before, with the feedforward that the host plays, and with what the drive keeps.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from autotune_sim.presets import preset

ROOT = Path(__file__).resolve().parents[1]
KINDS = ("edm-vertical", "lugre")
LONGEST = 1200.0
"""s, of a run: thirty times what it takes."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run.

    Attributes:
        before, host, drive: peak errors [rad]; nan where the run told none.
        named: effects that it named, with how sure it was.
        inertia: relative error of the identified one.
        machine: seconds that the axis moved; `seconds` of the run by the wall.
    """

    kind: str
    seed: int
    outcome: str
    before: float
    host: float
    drive: float
    named: str
    inertia: float
    machine: float
    seconds: float

    def __str__(self) -> str:
        peaks = " ".join(f"{1e3 * peak:7.3f}" for peak in (self.before, self.host, self.drive))
        return (
            f"{self.kind:13} {self.seed:9} {self.outcome:12} {peaks} {100 * self.inertia:+6.2f} "
            f"{self.machine:6.0f} {self.seconds:5.0f}  {self.named}"
        )


def tuned(kind: str, seed: int, tree: Path) -> Run:
    """`autotune run` of a tree on one axis, all asked questions answered with yes."""
    text = (tree / "config/axes/edm-vertical.toml").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        axis = Path(folder) / "axis.toml"
        axis.write_text(re.sub('link = ".*"', f'link = "sim://{kind}?seed={seed}"', text), encoding="utf-8")
        code = "from autotune.cli.main import main; main()"
        command = [
            sys.executable,
            "-c",
            code,
            "run",
            str(axis),
            "--yes",
            "--json",
            "--runs",
            f"{folder}/runs",
        ]
        path = os.pathsep.join(str(tree / part) for part in (".", "drivers", "sim"))
        began = time.monotonic()
        environment = os.environ | {"PYTHONPATH": path}
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, timeout=LONGEST, check=False
        )
        seconds = time.monotonic() - began
    try:
        result = json.loads(done.stdout)
    except ValueError:
        last = (done.stderr.decode(errors="replace").strip().splitlines() or ["?"])[-1]
        result = {"outcome": f"exit {done.returncode}", "diagnosis": {"verdict": last}}
    return _run(kind, seed, result, seconds)


def _run(kind: str, seed: int, result: dict[str, Any], seconds: float) -> Run:
    found, true = result.get("diagnosis") or {}, preset(kind, seed).plant
    inertia = (result.get("parameters") or {}).get("inertia", {}).get("value", np.nan)
    named = ", ".join(found.get("effects") or []) or found.get("verdict", "")
    return Run(
        kind,
        seed,
        result["outcome"],
        before=_peak(result, "before"),
        host=_peak(result, "after"),
        drive=_peak(result, "committed"),
        named=f"{named} {found.get('confidence') or ''}".strip(),
        inertia=inertia / true.inertia - 1.0,
        machine=result.get("machine_seconds", np.nan),
        seconds=seconds,
    )


def _peak(result: dict[str, Any], which: str) -> float:
    return float((result.get(which) or {}).get("peak_error", np.nan))


def summary(runs: Sequence[Run]) -> str:
    """How often what was proved was kept, and how much less the errors are."""
    lines = []
    for kind in KINDS:
        here = [run for run in runs if run.kind == kind]
        kept = sum(run.outcome == "kept" for run in here)
        host, drive = ([getattr(run, name) for run in here] for name in ("host", "drive"))
        lines.append(
            f"{kind}: {kept} of {len(here)} kept; host {_spread(host)}, drive by itself {_spread(drive)} mrad; "
            f"{np.nanmedian([run.machine for run in here]):.0f} s of machine time"
        )
    return "\n".join(lines)


def _spread(peaks: Sequence[float]) -> str:
    return f"{1e3 * np.nanmedian(peaks):.3f} ({1e3 * np.nanmin(peaks):.3f} to {1e3 * np.nanmax(peaks):.3f})"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True, help="of the first axis")
    parser.add_argument("--axes", type=int, default=10)
    parser.add_argument("--tree", type=Path, default=ROOT, help="whose autotune is measured")
    chosen = parser.parse_args()
    runs = []
    print("axis               seed outcome      before    host   drive  J [%]   [s]  wall  named")
    for number in range(chosen.axes):
        runs.append(tuned(KINDS[number % 2], chosen.seed + number, chosen.tree.resolve()))
        print(runs[-1], flush=True)
    print(summary(runs))
    return 0 if all(run.outcome == "kept" for run in runs) else 1


if __name__ == "__main__":
    sys.exit(main())
