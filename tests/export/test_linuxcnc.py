"""The exported component in a real controller: LinuxCNC's own trajectories and pid, simulated axes, G2 circles."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.export.request import FADE, Request
from autotune.export.targets import export

from .linuxcnc_rig import alone, glitch, needs_linuxcnc, rig, run_circles, turns
from .support import H, everything, proved, python_torque

SEEDS = {"x": 3, "y": 4}
RATES = {"one turn a second": 2.0 * np.pi, "one turn in two": np.pi}
SAME = 1e-9
TOLD, TRUE = 2, 12
"""Where a row of the axes' log has what they were told, and where they truly were."""


def test_the_component_names_no_pin_as_the_law_names_a_variable() -> None:
    """`halcompile` makes a macro of each pin: one of the law's names would break it."""
    text = export(Request(everything(), "a model", H), "linuxcnc").files["autotune_ff.comp"].decode()
    head, _, source = text.partition("\n;;\n")
    pins = [line.split()[3] for line in head.splitlines() if line.startswith(("pin ", "param "))]
    law = source.partition("#define NEAR_ENOUGH")[0]
    assert len(pins) == 12
    assert not [pin for pin in pins if f" {pin} " in law or f" {pin};" in law]


def test_halcompile_takes_it_without_a_warning(tmp_path: Path) -> None:
    needs_linuxcnc()
    for name, content in export(Request(everything(), "a model", H), "linuxcnc").files.items():
        (tmp_path / name).write_bytes(content)
    done = subprocess.run(
        ["halcompile", "--compile", "autotune_ff.comp"],
        cwd=tmp_path,
        env={name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, "warning" in done.stderr) == (0, False), done.stderr


@pytest.mark.slow
@pytest.mark.long
def test_circles_in_linuxcnc() -> None:
    """Quadrant glitch with the export at most 15 % of that without, and 1.2 times that with the true inverse."""
    needs_linuxcnc()
    with alone(), rig({name: proved(seed) for name, seed in SEEDS.items()}) as folder:
        run_circles(folder, *SEEDS.values())
        told = np.load(folder / "axes.npy")
        sampled = np.loadtxt(folder / "samples.txt")
    played = {name: _of(told, name) for name in ("none", "exported", "inverse")}
    peaks = {
        name: np.array([_glitches(rows, rate) for rate in RATES.values()]) for name, rows in played.items()
    }
    shown = {name: np.round(1e3 * found, 4).tolist() for name, found in peaks.items()}
    assert np.all(peaks["exported"] <= 0.15 * peaks["none"]), shown
    # below a count of the encoder (0.13 mrad) one feed alone is noise: each axis by its worst
    assert np.all(peaks["exported"].max(axis=0) <= 1.2 * peaks["inverse"].max(axis=0)), shown
    for row, rate in zip(peaks["none"], RATES.values(), strict=True):
        _check_log(sampled, row, rate)
    _check_numbers(told)


def _of(told: Floats, played: str) -> Floats:
    """Rows in which nothing, the export, or the true inverse was played."""
    inverse = told[:, 1] != 0.0
    offered = np.any(told[:, [3, 8]] != 0.0, axis=1)
    return {"none": ~inverse & ~offered, "exported": offered, "inverse": inverse & ~offered}[played][
        :, None
    ] * told


def _glitches(rows: Floats, rate: float) -> tuple[float, float]:
    """Of both axes, by where they truly were [rad]."""
    reference, velocity = rows[:, [4, 9]], rows[:, [5, 10]]
    late, angle = turns(reference, velocity, rate)
    error = reference - rows[:, TRUE : TRUE + 2]
    return glitch(error[late, 0], angle), glitch(error[late, 1], angle)


def _check_log(sampled: Floats, true: Floats, rate: float) -> None:
    """What halsampler logged, by the encoders, tells of the same glitches without compensation."""
    rows = sampled[(sampled[:, 11] == 0) & (sampled[:, 12] == 0)]
    late, angle = turns(rows[:, [0, 2]], rows[:, [6, 9]], rate)
    for axis, column in enumerate((0, 2)):
        seen = glitch((rows[:, column] - rows[:, column + 1])[late], angle)
        assert seen == pytest.approx(true[axis], rel=0.1)  # a count is 0.13 of about 2 mrad


def _check_numbers(told: Floats) -> None:
    """The torque that LinuxCNC gave is that of the Python feedforward along LinuxCNC's own commands."""
    for column, seed in zip((TOLD, TOLD + 5), SEEDS.values(), strict=True):
        expected = python_torque(proved(seed), tuple(told[:, column + 2 : column + 5].T))  # type: ignore[arg-type]
        given = told[:, column + 1]
        playing = np.flatnonzero(np.any(told[:, [3, 8]] != 0.0, axis=1))
        whole = playing[round(FADE / H) + 10 : -round(FADE / H) - 10]
        assert len(whole) > 5000
        assert np.max(np.abs(given - expected)[whole]) < SAME
