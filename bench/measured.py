"""Measured data of others through the command line alone: fit, diagnose, add what is named, diagnose again.

    python -m bench.measured [--only emps]

Each set is imported, fitted and diagnosed; the effect named first is added and the new model diagnosed, until
nothing more is named. Figures asked stand beside those seen. The data are not part of the project: a set whose
folder is missing is skipped, with the reason.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from autotune.cli.main import main as autotune
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import read_model
from autotune.recordings.files import read_recording
from autotune.recordings.recording import Recording
from tests.support.emps import held_error

DATA = Path(__file__).resolve().parents[1] / "../shared/data"
MOST_STEPS = 5
Metric = Callable[[Recording, DriveModel], float]


@dataclass(frozen=True, slots=True)
class MeasuredSet:
    """One set: how it is imported, what is asked of the ladder, and how its error is measured [%].

    Attributes:
        second: a file of another trajectory of the same axis, where there is one; it confirms or refutes.
        metric: None for what `model compare` calls relative error.
    """

    name: str
    files: str
    options: tuple[str, ...]
    asked: str
    metric: Metric | None = None
    second: str | None = None


@dataclass(slots=True)
class Ladder:
    """What happened: one row (step, verdict, error [%], seconds) after another."""

    rows: list[tuple[str, str, float, float]] = field(default_factory=list)
    refused: str = ""


EPOS = (
    "--format", "epos", "--column", "velocity=Velocity actual value averaged*-rpm",
    "--column", "torque=Torque actual value averaged*-9.84e-3/100",
)  # fmt: skip
BLDC = (
    "--format",
    "csv",
    "--column",
    "position=Position",
    "--column",
    "velocity=Velocity",
    "--torque-unit",
    "A",
)
EMPS = (
    "--format", "mat", "--unit", "m", "--column", "time=t", "--column", "position=qm",
    "--column", "reference=qg", "--column", "torque=vir*35.15",
)  # fmt: skip
SETS = (
    MeasuredSet(
        "emps",
        "emps/DATA_EMPS.mat",
        EMPS,
        "direction_asymmetry, nonlinear_viscous, torque_ripple; at most 2.35 % (authors 3.112)",
        held_error,
        "emps/DATA_EMPS_PULSES.mat",
    ),
    MeasuredSet(
        "bldc-speed", "bldc_cogging/speed_test1.txt", BLDC, "torque_ripple 72, 18, 12, 24; at most 10 %"
    ),
    MeasuredSet("bldc-current", "bldc_cogging/acc_current.txt", BLDC, "no wrong name"),
    MeasuredSet("lead-screw", "lead_screw/steady_state/0.096kg/*.csv", EPOS, "stribeck; at most 1.3 %"),
    MeasuredSet("lead-screw-50", "lead_screw/start_stop/50.csv", EPOS, "no wrong name, or a sentence"),
    MeasuredSet("lead-screw-200", "lead_screw/start_stop/200.csv", EPOS, "no wrong name, or a sentence"),
)


class Refused(Exception):
    """The command line said no; the sentence is the message."""


def command(*arguments: object) -> str:
    """Runs the command line in this process; returns what it prints.

    Raises:
        Refused: it ended with another code than 0.
    """
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            autotune([str(argument) for argument in arguments])
        except SystemExit as ending:
            code = ending.code
    if code:
        raise Refused(f"exit {code}: {err.getvalue().strip().splitlines()[-1]}")
    return out.getvalue()


def asked_json(*arguments: object) -> dict[str, Any]:
    return dict(json.loads(command(*arguments, "--json")))


def climb(one: MeasuredSet, folder: Path) -> Ladder:
    """Fit, then diagnose and add until nothing is named."""
    recording, ladder = folder / f"{one.name}.parquet", Ladder()
    files = sorted(DATA.glob(one.files))
    second = imported_second(one, folder)
    try:
        command("data", "import", *files, *one.options, "--out", recording)
        began = time.perf_counter()
        model = folder / f"{one.name}-0.toml"
        command("model", "fit", recording, "--out", model)
        ladder.rows.append(("fit", "", error_of(one, recording, model), time.perf_counter() - began))
        for number in range(1, MOST_STEPS):
            began = time.perf_counter()
            found = asked_json("model", "diagnose", recording, *second, "--model", model)
            verdict = f"{found['verdict']} {', '.join(found['effects'])} {found['confidence'] or ''}".strip()
            if not found["effects"]:
                ladder.rows.append(("diagnose", verdict, float("nan"), time.perf_counter() - began))
                break
            better = folder / f"{one.name}-{number}.toml"
            command("model", "add", found["effects"][0], recording, "--model", model, "--out", better)
            model = better
            row = (f"+ {found['effects'][0]}", verdict, error_of(one, recording, model))
            ladder.rows.append((*row, time.perf_counter() - began))
    except Refused as reason:
        ladder.refused = str(reason)
    return ladder


def imported_second(one: MeasuredSet, folder: Path) -> list[Path]:
    """The second trajectory of a set, imported; empty where it is not here."""
    if one.second is None or not (DATA / one.second).is_file():
        return []
    path = folder / f"{one.name}-second.parquet"
    command("data", "import", DATA / one.second, *one.options, "--out", path)
    return [path]


def error_of(one: MeasuredSet, recording: Path, model: Path) -> float:
    """Relative error [%], by the authors' metric or as `model compare` tells it."""
    if one.metric is not None:
        return one.metric(read_recording(recording), read_model(model))
    return 100.0 * float(asked_json("model", "compare", recording, "--model", model)["relative_error"])


def table(one: MeasuredSet, ladder: Ladder) -> list[str]:
    lines = [f"{one.name}: asked {one.asked}"]
    for step, verdict, error, seconds in ladder.rows:
        shown = f"{error:7.2f} %" if np.isfinite(error) else " " * 9
        lines.append(f"  {step:<30}{shown} {seconds:6.1f} s  {verdict}")
    return [*lines, f"  refused: {ladder.refused}"] if ladder.refused else lines


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", help="names of sets, separated by commas")
    wanted = parser.parse_args().only
    for one in SETS:
        if wanted and one.name not in wanted.split(","):
            continue
        if not list(DATA.glob(one.files)):
            sys.stdout.write(f"{one.name}: skipped, ../shared/data/{one.files} is not here\n")
            continue
        if one.second and not (DATA / one.second).is_file():
            sys.stdout.write(f"{one.name}: no second trajectory, ../shared/data/{one.second} is not here\n")
        with tempfile.TemporaryDirectory() as folder:
            sys.stdout.write("\n".join(table(one, climb(one, Path(folder)))) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
