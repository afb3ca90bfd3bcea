"""The pages of the viewer, stage by stage: fit, diagnosis, adaptation, proof, verdict; and of comparisons.

Made of the same data as the figures of a report (`view.data`), so that both show the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.units import torque_symbol
from autotune.view.colours import (
    BLUE_ON_DARK,
    GREEN_ON_DARK,
    GREY_ON_DARK,
    ORANGE_ON_DARK,
    PINK_ON_DARK,
)
from autotune.view.data import BeforeAfter, Comparison, Rank, Residual, SteadyState, Step, Trace
from autotune.view.pages import Bar, Bars, Chart, Curve, Page, Panel, TimePlot, Words
from autotune.view.scale import binned, multiple, peak, quantity, thin

MOST_RANKS = 8
POINTS = 6000
RESIDUAL_BINS = 40
CONVERGENCE_SECONDS = 1.0


def fit_page(
    compared: Comparison | None,
    steady: SteadyState | None,
    parameters: str,
    residuals: Sequence[tuple[Residual, Floats]] = (),
) -> Page:
    """Measured and model, what is left, the characteristic, and the parameters as a Markdown table."""
    left: list[Panel | None] = [*over_time(compared)] if compared is not None else []
    right = [characteristic(steady) if steady is not None else None, *(over(*one) for one in residuals[:1])]
    return Page.of("fit", "Fit", left, [*right, Words("Parameters", parameters)], shares=(2.0, 1.2))


def diagnosis_page(
    ranks: Sequence[Rank],
    steps: Sequence[Step],
    residuals: Sequence[tuple[Residual, Floats]],
    words: str,
    unit: str,
    floor: float | None = None,
) -> Page:
    """Ranking as bars, the residual over the coordinates where it lives, how the error fell, what it means."""
    return Page.of(
        "diagnosis",
        "Diagnosis",
        [ranking(ranks), staircase(steps, unit, floor)],
        [over(*one) for one in residuals[:2]],
        [Words("What it means", words)],
        shares=(1.2, 1.2, 0.7),
    )


def adaptation_page(traces: Sequence[Trace], words: str = "", period: float = CONVERGENCE_SECONDS) -> Page:
    """Parameters while they converge, each with its band."""
    plots = [convergence(trace, period) for trace in traces]
    half = (len(plots) + 1) // 2
    return Page.of(
        "adaptation", "Adaptation", plots[:half], [*plots[half:], Words("What the laws say", words)]
    )


def proof_page(shown: BeforeAfter, words: str = "") -> Page:
    """Before and after over the period, with the spread of the repeats; the reference; peak errors as bars."""
    factor, unit = multiple(peak(shown.before, shown.after), shown.motion_unit)
    sides = [(shown.before_name, ORANGE_ON_DARK, shown.before), (shown.after_name, BLUE_ON_DARK, shown.after)]
    if shown.committed is not None:
        sides.append((shown.committed_name, GREEN_ON_DARK, shown.committed))
    error = TimePlot(
        f"Tracking error over one period [{unit}], band: one standard deviation of the repeats",
        tuple(
            Curve(name, colour, shown.time, factor * side.mean(axis=0), factor * side.std(axis=0))
            for name, colour, side in sides
        ),
    )
    reference = TimePlot(
        f"Reference over one period [{shown.motion_unit}]",
        (Curve("reference", BLUE_ON_DARK, shown.time, shown.reference),),
    )
    peaks = tuple(
        Bar(
            name,
            factor * peak(side.mean(axis=0)),
            colour,
            quantity(peak(side.mean(axis=0)), shown.motion_unit),
        )
        for name, colour, side in sides
    )
    return Page.of(
        "proof",
        "Proof",
        [error, reference],
        [
            Bars("Peak of the averaged error (quadrant glitch)", f"peak error [{unit}]", peaks),
            Words("Proof", words),
        ],
        shares=(2.0, 1.0),
    )


def verdict_page(markdown: str, peaks: Sequence[Bar] = (), unit: str = "") -> Page:
    """What the run concludes."""
    bars = Bars("Peak error on the benchmark", f"peak error [{unit}]", tuple(peaks)) if peaks else None
    return Page.of("verdict", "Verdict", [Words("Verdict", markdown)], [bars])


def comparison_page(
    compared: Comparison,
    residuals: Sequence[tuple[Residual, Floats]],
    regimes: Sequence[Bar],
    words: str,
) -> Page:
    """Measured and model over time, where the error lives, by kind of motion."""
    by_motion = Bars(
        "Error by kind of motion", f"rms error [{compared.unit}]", tuple(regimes), compared.noise_floor
    )
    return Page.of(
        "comparison",
        "Model and measurement",
        over_time(compared),
        [*(over(*one) for one in residuals[:2]), by_motion],
        [Words("What it says", words)],
        shares=(1.8, 1.1, 0.7),
    )


def added_page(
    steps: Sequence[Step], before: Comparison | None, after: Comparison | None, words: str, unit: str,
    floor: float | None,
) -> Page:  # fmt: skip
    """How the error fell with what was added, what is left before and after, and the parameters old and new."""
    both = None
    if before is not None and after is not None:
        curves = [
            _thinned(name, colour, one.time, one.measured - one.modelled)
            for name, colour, one in (("before", ORANGE_ON_DARK, before), ("after", BLUE_ON_DARK, after))
        ]
        both = TimePlot(f"What is left of the torque, before and after [{unit}]", tuple(curves))
    measured = over_time(after)[0] if after is not None else None
    return Page.of(
        "added", "Effect added", [measured, both], [staircase(steps, unit, floor), Words("What it says", words)],
        shares=(1.8, 1.0),
    )  # fmt: skip


def link_page(
    time: Floats, interval: Floats, period: float, spreads: Sequence[tuple[str, float]], words: str
) -> Page:
    """How evenly the cycles of a link came: `interval` between answers [s] over `time`, and named spreads [s]."""
    curves = [_thinned("between answers", BLUE_ON_DARK, time, 1e3 * interval)]
    if len(time):
        ends = np.array([time[0], time[-1]])
        curves.append(Curve("cycle asked for", GREEN_ON_DARK, ends, np.full(2, 1e3 * period), guide=True))
    bars = tuple(Bar(name, 1e3 * value, BLUE_ON_DARK, quantity(value, "s")) for name, value in spreads)
    return Page.of(
        "link",
        "Link",
        [TimePlot("Time between answers [ms]", tuple(curves))],
        [Bars("Round trip and jitter", "time [ms]", bars), Words("Cycles", words)],
        shares=(2.0, 1.2),
    )


def over_time(shown: Comparison) -> list[Panel]:
    """Measured and model, and below them what is left."""
    left = shown.measured - shown.modelled
    curves = [
        _thinned("measured", GREY_ON_DARK, shown.time, shown.measured),
        _thinned("model", BLUE_ON_DARK, shown.time, shown.modelled),
    ]
    residual = [_thinned("measured less model", ORANGE_ON_DARK, shown.time, left)]
    if shown.noise_floor is not None and len(shown.time):
        ends = np.array([shown.time[0], shown.time[-1]])
        residual.append(
            Curve("noise floor", GREEN_ON_DARK, ends, np.zeros(2), np.full(2, shown.noise_floor), guide=True)
        )
    quantity_name = shown.quantity.capitalize()
    return [
        TimePlot(f"{quantity_name}, measured and model [{shown.unit}]", tuple(curves)),
        TimePlot(f"What is left [{shown.unit}]", tuple(residual)),
    ]


def over(shown: Residual, direction: Floats) -> Chart | None:
    """The residual over a coordinate, by direction: pooled, what changes its sign would average to nothing."""
    factor, unit = multiple(peak(shown.residual), shown.residual_unit)
    curves = []
    for name, colour, rows in (
        ("forward", BLUE_ON_DARK, direction > 0.0),
        ("backward", ORANGE_ON_DARK, direction < 0.0),
    ):
        x, mean, error = binned(shown.values[rows], factor * shown.residual[rows], RESIDUAL_BINS)
        if len(x) > 1:
            curves.append(Curve(name, colour, x, mean, 2.0 * error))
    if not curves:
        return None
    share = f": {100 * shown.share:.0f} % of its variance" if shown.share is not None else ""
    spoken = shown.coordinate.replace("_", " ")
    floor = factor * shown.noise_floor if shown.noise_floor is not None else None
    return Chart(
        f"Residual over {spoken}{share}",
        f"{spoken} [{shown.unit}]",
        f"residual [{unit}]",
        tuple(curves),
        floor,
    )


def characteristic(shown: SteadyState) -> Chart:
    """Torque at constant velocity, measured and model."""
    torque = torque_symbol(shown.motion_unit, shown.torque_unit)
    order = np.argsort(shown.model_velocity)
    x, y = shown.model_velocity[order], shown.model_torque[order].astype(np.float64).copy()
    breaks = np.flatnonzero(np.diff(np.sign(x)) != 0)
    x, y = np.insert(x, breaks + 1, 0.0), np.insert(y, breaks + 1, np.nan)
    return Chart(
        "Steady-state characteristic",
        f"velocity [{shown.motion_unit}/s]",
        f"torque [{torque}]",
        (
            Curve("model", BLUE_ON_DARK, x, y),
            Curve("measured", GREY_ON_DARK, shown.velocity, shown.torque, shown.torque_error, dots=True),
        ),
    )


def ranking(ranks: Sequence[Rank]) -> Bars:
    """How far each candidate lowers the squared error on unseen data, accepted ones first, then the best."""
    finite = (rank for rank in ranks if np.isfinite(rank.gain))
    best = sorted(finite, key=lambda rank: (not rank.accepted, -rank.gain))[:MOST_RANKS]
    bars = tuple(
        Bar(
            rank.name.replace("_", " "),
            100.0 * max(rank.gain, -0.1),
            GREEN_ON_DARK if rank.accepted else GREY_ON_DARK,
            f"{100 * rank.gain + 0.0:.0f} %".replace("-0 ", "0 ").replace("-", "−"),
        )
        for rank in best
    )
    return Bars(
        "What is missing: error on unseen data falls by",
        "fall of the squared error [%]; green, first: accepted",
        bars,
    )


def staircase(steps: Sequence[Step], unit: str, floor: float | None = None) -> Bars | None:
    """How the error fell with each effect."""
    known = [step for step in steps if np.isfinite(step.error)]
    if len(known) < 2:
        return None
    factor, scaled = multiple(max(step.error for step in known), unit)
    bars = tuple(
        Bar(step.name.replace("_", " "), factor * step.error, BLUE_ON_DARK, quantity(step.error, unit))
        for step in known
    )
    mark = None if floor is None or not np.isfinite(floor) else factor * floor
    note = "; line: noise floor" if mark is not None else ""
    return Bars("How the error fell", f"rms error on unseen data [{scaled}]{note}", bars, mark)


def convergence(trace: Trace, period: float) -> TimePlot:
    """A parameter with the spread that it had over the last period, its bounds where they are near, its end."""
    curves = [
        Curve(trace.name, BLUE_ON_DARK, trace.time, trace.value, _spread(trace.time, trace.value, period))
    ]
    if not len(trace.time):
        return TimePlot(trace.name, ())
    ends = np.array([trace.time[0], trace.time[-1]])
    span = max(float(np.ptp(trace.value)), 0.05 * peak(trace.value))
    for name, bound in (("lower bound", trace.lower), ("upper bound", trace.upper)):
        if bound is not None and np.min(np.abs(trace.value - bound)) < 2.0 * span:
            curves.append(Curve(name, GREY_ON_DARK, ends, np.full(2, bound), guide=True))
    if trace.refined is not None:
        error = None if trace.error is None else np.full(2, trace.error)
        curves.append(Curve("refined", PINK_ON_DARK, ends, np.full(2, trace.refined), error))
    return TimePlot(
        f"{trace.name.replace('_', ' ')} [{trace.unit}], band: spread over a period", tuple(curves)
    )


def _spread(time: Floats, value: Floats, period: float) -> Floats:
    """Standard deviation of the values of the last period, at each moment."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else period
    rows = max(round(period / step), 2) if step > 0 else 2
    sums, squares = (
        np.concatenate([[0.0], np.cumsum(v)]) for v in (value - value.mean(), (value - value.mean()) ** 2)
    )
    end = np.arange(1, len(value) + 1)
    start = np.maximum(end - rows, 0)
    count = end - start
    mean = (sums[end] - sums[start]) / count
    return np.asarray(np.sqrt(np.maximum((squares[end] - squares[start]) / count - mean**2, 0.0)))


def _thinned(name: str, colour: str, time: Floats, value: Floats) -> Curve:
    rows = thin(value, POINTS)
    x, y = time[rows], value[rows].astype(np.float64)
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    gaps = [at for at in np.flatnonzero(np.diff(time) > 20.0 * step) if step > 0.0]
    after = np.searchsorted(rows, np.array(gaps, dtype=np.int64), side="right")
    return Curve(name, colour, np.insert(x, after, time[gaps] + step), np.insert(y, after, np.nan))
