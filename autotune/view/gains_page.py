"""Pages of `autotune gains` and `autotune catalogue`: the verdict, and the pictures that it rests on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from autotune.control.gains.judge import Task, Verdict
from autotune.control.gains.members import Family
from autotune.control.gains.propose import Proposal
from autotune.control.gains.regimes import REGIMES, linear_axis
from autotune.control.gains.sampled import axis_response, controller_response, frequencies, sampled_axis
from autotune.control.gains.steps import BEFORE
from autotune.control.gains.twin import follow, step_reference
from autotune.control.structures.catalogue import Catalogue, Entry
from autotune.view.figures.control import LoopCurve, TimeCurve, bars, bode, over_time
from autotune.view.report import Picture, Report, Table, write_report

STEP_SECONDS = 0.4


def write_gains(
    path: Path,
    current: Verdict,
    proposal: Proposal,
    kin: Family,
    task: Task,
    words: Sequence[str],
    unit: str,
) -> None:
    """Bode pictures of both regimes, small and large step, and the verdict in words."""
    shown = [("today", current)] + ([("proposed", proposal.verdict)] if proposal.verdict else [])
    pictures = [
        Picture(
            "Open loop, sticking and sliding",
            "Phase margins are read where a curve crosses 0 dB, gain margins where it crosses −180°.",
            bode([curve for name, verdict in shown for curve in _loops(name, verdict, kin)]),
        ),
        *(
            _steps(what, size, shown, kin, unit)
            for what, size in (("Small", task.steps.small), ("Large", task.steps.large))
        ),
    ]
    write_report(
        path,
        Report(
            "Gains of the axis",
            "information",
            " ".join(words[:3]),
            subtitle="judged on the model of the last run; nothing has moved",
            pictures=pictures,
            tables=[_table(shown, unit)],
            next_steps=words[3:],
            sign_off=False,
        ),
    )


def _loops(name: str, verdict: Verdict, kin: Family) -> list[LoopCurve]:
    member = kin.nominal
    period = member.timing.period
    curves = []
    for regime in REGIMES:
        axis = sampled_axis(linear_axis(member.model, regime), member.timing)
        loop = axis_response(axis, period) * controller_response(verdict.gains, period)
        phase = np.degrees(np.unwrap(np.angle(loop)))
        phase -= 360.0 * np.ceil((phase[0]) / 360.0)
        curves.append(
            LoopCurve(
                f"{name}, {regime}",
                frequencies(period),
                20.0 * np.log10(np.abs(loop)),
                phase,
                name == "today",
            )
        )
    return curves


def _steps(what: str, size: float, shown: Sequence[tuple[str, Verdict]], kin: Family, unit: str) -> Picture:
    member = kin.nominal
    reference = step_reference(size, BEFORE, STEP_SECONDS, member.timing)
    time = np.arange(len(reference), dtype=np.float64) * member.timing.period - BEFORE
    curves = [TimeCurve("reference", time, reference)]
    for name, verdict in shown:
        motion = follow(member.model, verdict.gains, member.timing, reference)
        curves.append(TimeCurve(name, time[: motion.played], motion.position[: motion.played]))
    return Picture(
        f"{what} step on the twin",
        f"A step of {1e3 * size:.3g} m{unit}, with the torque limit and the encoder of the axis.",
        over_time(curves, "position", unit),
    )


def _table(shown: Sequence[tuple[str, Verdict]], unit: str) -> Table:
    rows = []
    for name, one in shown:
        gains = ", ".join(f"{key} {value:.4g}" for key, value in one.gains.named().items())
        hunts = (
            f"±{1e3 * one.cycle.amplitude:.3g} m{unit}, {one.cycle.frequency:.3g} Hz" if one.cycle else "no"
        )
        rows.append(
            (
                name, gains, f"{one.bandwidth:.3g} Hz", f"{one.phase_margin:.0f}°", f"{one.gain_margin:.1f} dB", hunts,
                f"{1e3 * one.small_settling:.0f} / {1e3 * one.large_settling:.0f} ms", f"{one.noise:.2g}",
            )
        )  # fmt: skip
    columns = (
        "",
        "gains",
        "crossover",
        "phase",
        "gain",
        "hunts",
        "settles small / large",
        "torque of a count",
    )
    return Table(
        "In figures", columns, rows, "margins: the least over both regimes and the parameters' intervals"
    )


def write_catalogue(path: Path, found: Catalogue, unit: str) -> None:
    """Errors as bars, sines and steps over time, and the table."""
    offered = [entry for entry in found.entries if not entry.structure.in_host]
    shown_only = [entry for entry in found.entries if entry.structure.in_host]
    pictures = [
        Picture(
            "Largest error on the benchmark's sine",
            "The one that is recommended is green.",
            bars(
                {one.structure.name: one.sine_peak_error for one in found.entries},
                "error",
                unit,
                found.recommended,
            ),
        ),
        Picture(
            "Errors on the sine, offered",
            "The last two periods on the twin.",
            over_time(_sines(offered), "error", unit),
        ),
        Picture(
            "Errors on the sine, on the twin only",
            "These close a loop on friction through the host.",
            over_time(_sines(shown_only), "error", unit),
        ),
        Picture(
            "Large step", "With the torque limit.", over_time(_step_curves(found.entries), "position", unit)
        ),
    ]
    write_report(
        path,
        Report(
            "Control structures on this axis",
            "information",
            found.why,
            subtitle="on the twin of the axis, with today's gains; nothing has moved",
            pictures=pictures,
            tables=[_catalogue_table(found, unit)],
            sign_off=False,
        ),
    )


def _sines(entries: Sequence[Entry]) -> list[TimeCurve]:
    curves = []
    for entry in entries:
        motion = entry.sine
        if motion.bounded:
            rows = len(motion.reference) // 3
            time = np.arange(rows, dtype=np.float64) * motion.period
            curves.append(TimeCurve(entry.structure.name, time, motion.error[-rows:]))
    return curves


def _step_curves(entries: Sequence[Entry]) -> list[TimeCurve]:
    curves = []
    for entry in entries:
        rows = min(round((BEFORE + STEP_SECONDS) / entry.step.period), entry.step.played)
        time = np.arange(rows, dtype=np.float64) * entry.step.period - BEFORE
        curves.append(TimeCurve(entry.structure.name, time, entry.step.position[:rows]))
    return curves


def _catalogue_table(found: Catalogue, unit: str) -> Table:
    rows = [
        (
            one.structure.name, one.structure.source, f"{1e3 * one.sine_peak_error:.3g} m{unit}",
            f"{1e3 * one.small_settling:.0f} / {1e3 * one.large_settling:.0f} ms", f"{100 * one.robustness:.0f} %",
            f"{one.torque_noise:.2g}", f"{one.dead_time:g}", "yes" if one.oscillates else "no", one.structure.effort,
            "on the twin only" if one.structure.in_host else "yes",
        )
        for one in found.entries
    ]  # fmt: skip
    columns = (
        "structure", "thesis", "sine", "steps small / large", "robust on", "torque noise", "cycles it bears",
        "oscillates", "needs", "offered",
    )  # fmt: skip
    return Table("In figures", columns, rows)
