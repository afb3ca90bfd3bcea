"""The axis file of a case, and the command line that plays its programme."""

from __future__ import annotations

import shlex
from pathlib import Path

from bench.faults.cases import Case

NAME = "hurt"
_TEXT = """schema = 1
name = "{name}"
link = "{link}"
profile = "{profile}"
motion_unit = "rad"
cycle = 0.001

[mechanics]
counts_per_revolution = 50000

[limits]
{limits}

[reference]
filter = 0.8

[benchmark]
amplitude = 0.2
frequency = 1.0
repeats = 5
periods = 2
"""
_LIMITS = {
    "position_min": -20.0,
    "position_max": 20.0,
    "speed": 20.0,
    "torque": 1.34,
    "following_error": 0.15,
    "deceleration": 400.0,
    "temperature": 80.0,
    "machine_seconds": 300.0,
}


def write_axis(case: Case, folder: Path, link: str, profile: str = "autotune-sim") -> Path:
    """Writes the axis file into the case's folder."""
    limits = _LIMITS | dict(case.limits)
    text = "\n".join(f"{name} = {value}" for name, value in limits.items())
    path = folder / "axis.toml"
    path.write_text(_TEXT.format(name=NAME, link=link, profile=profile, limits=text), encoding="utf-8")
    return path


def simulated_link(case: Case, folder: Path, log: str, faults: bool = True) -> str:
    """The link of the drive in process."""
    parts = [f"seed={case.plant}", f"memory={folder / 'mem'}", f"truth={folder / log}"]
    if faults:
        parts += [f"fault={order}" for order in case.orders]
    return f"sim://edm-vertical?{'&'.join(parts)}"


def command(case: Case, folder: Path) -> list[str]:
    """Arguments of the command line."""
    words = shlex.split(case.programme)
    axis, runs = str(folder / "axis.toml"), ["--runs", str(folder / "runs")]
    if words[0] == "record":
        return ["record", axis, words[1], "--out", str(folder / "out.parquet"), "--yes", *runs]
    if words[0] == "run":
        return ["run", axis, "--yes", *runs, *words[1:]]
    return ["check", axis, *runs]
