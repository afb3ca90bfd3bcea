"""The report's tables of parameters: identified, proved, written; old and new value with the drive's object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from autotune.control.velocity_table import Points, is_point
from autotune.core.ripple_parameters import is_ripple
from autotune.core.units import torque_symbol
from autotune.models.drive_model import surface_parameter
from autotune.tuning.findings import Findings
from autotune.tuning.outcome import Outcome, RunResult
from autotune.view.report import Table
from autotune.view.scale import multiple, quantity, significant

PREFIX = "feedforward."
APART = 0.05  # of the identified value: from there on the difference wants a word
_WHY = {
    "coulomb": (
        "identified over all speeds in full slip; on the benchmark's short strokes, with one elastic element, "
        "this value left the smallest error"
    ),
    "stiffness": (
        "identified at the smallest displacements; on the benchmark one spring has to stand for the whole way to "
        "slip, and this one left the smallest error"
    ),
    "micro_damping": "identified in presliding; on the benchmark it also stands for lags of the torque path",
    "offset": "identified from strokes in both directions; adapted to the load on the benchmark",
    "break_away": "kept in its ratio to Coulomb friction while that was adapted",
}


def identified_table(result: RunResult) -> Table:
    """Value and interval, both in the value's multiple of the unit."""
    rows = [[name, *_with_interval(one)] for name, one in result.parameters.items()]
    return Table(
        "Identified parameters", ("parameter", "value", "95 % interval"), rows, numeric=frozenset({1, 2})
    )


def _with_interval(one: Mapping[str, object]) -> tuple[str, str]:
    value, unit = float(str(one["value"])), str(one["unit"])
    edges = one["interval"]
    low, high = (float(str(edge)) for edge in edges) if isinstance(edges, Sequence) else (value, value)
    factor, text = multiple(abs(value), unit)
    return quantity(value, unit), f"{significant(low * factor)} … {significant(high * factor)} {text}".strip()


def feedforward_table(result: RunResult, findings: Findings, objects: Mapping[str, str]) -> Table:
    """Identified, before and now, with where the drive keeps it, and why identified and written differ."""
    kept = result.outcome is Outcome.KEPT
    rows = [
        _row(name, value, result, findings, objects)
        for name, value in result.feedforward.items()
        if not is_ripple(name) and not is_point(name)
    ]
    note = "Read back from the drive after writing." if kept else "Proposed; none of it is in the drive."
    now = "in the drive now" if kept else "proposed"
    columns = ("parameter", "object", "identified", "in the drive before", now, "why not as identified")
    return Table("Feedforward", columns, rows, note, frozenset({2, 3, 4}))


def held_out_table(result: RunResult) -> Table:
    """The motion that nothing was adapted to: mean of the windows, as it was, with the host, and by itself."""
    labels = (("before", "before"), ("after", "played by the host"), ("committed", "the drive by itself"))
    rows = [
        [words, *(quantity(_mean(result.held_out[label][figure]), result.motion_unit) for figure in _FIGURES)]
        for label, words in labels
        if label in result.held_out
    ]
    note = "A quick move with a rest, strokes of constant speed and a smaller, faster sine; it must not get worse."
    return Table(
        "On a motion that nothing was adapted to",
        ("", "peak error", "rms error"),
        rows,
        note,
        frozenset({1, 2}),
    )


_FIGURES = ("peak_error", "rms_error")


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _row(
    name: str, value: float, result: RunResult, findings: Findings, objects: Mapping[str, str]
) -> list[str]:
    short = name.removeprefix(PREFIX)
    unit = surface_parameter(short).unit_for(result.motion_unit)
    found = result.parameters.get(short)
    before = findings.held_before.get(name)
    return [
        short,
        objects.get(name, "–"),
        quantity(found["value"], unit) if found else "–",
        quantity(before, unit) if before is not None else "not read",
        quantity(value, unit),
        _why(short, float(found["value"]), value) if found else "",
    ]


def ripple_table(findings: Findings, kept: bool) -> Table | None:
    """What the drive takes of the torque ripple; None for nothing."""
    plan = findings.ripple
    if plan is None:
        return None
    found, gone = plan.alignment, findings.ripple_removed
    written = [[str(order), quantity(abs(wave), "N m"), "in the drive" if kept else "not written"]
               for order, wave in sorted(found.waves.items())]  # fmt: skip
    out = [[f"{one.order:g}", quantity(one.amplitude, "N m"), one.why] for one in plan.kept.left_out]
    note = (
        f"Aligned by experiment: the drive counts the turn from {quantity(found.zero, 'rad')}. Of the ripple in the "
        f"tracking error {100 * (1.0 - found.left):.0f} % were predicted to go"
        + (f", {100 * gone:.0f} % were gone when it was measured after writing." if gone is not None else ".")
    )
    return Table(
        "Torque ripple in the drive", ("order", "amplitude", ""), [*written, *out], note, frozenset({0, 1})
    )


def friction_table(result: RunResult) -> Table | None:
    """Torque over velocity, point by point; None where there is no table."""
    values = {name.removeprefix(PREFIX): value for name, value in result.feedforward.items()}
    points = Points.among(values)
    if points is None:
        return None
    unit = result.motion_unit
    rows = [
        [quantity(float(v), f"{unit}/s"), quantity(float(t), torque_symbol(unit))]
        for v, t in zip(points.velocity[1:], points.torque[1:], strict=True)
    ]
    kept = "In the drive now" if result.outcome is Outcome.KEPT else "Proposed; none of it is in the drive"
    note = f"{kept}. Straight lines from the origin and between the points; the same turned round backwards."
    return Table("Friction over velocity", ("velocity", "torque"), rows, note, frozenset({0, 1}))


def _why(name: str, identified: float, written: float) -> str:
    if abs(written - identified) <= APART * abs(identified):
        return ""
    return _WHY.get(name, "refined on the benchmark, where this value left the smallest error")
