"""Tables that every report has: parameters with intervals, what was written, limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from autotune.view.report import Change, Table
from autotune.view.scale import multiple, quantity, significant

MEANING = {
    "inertia": "Inertia, reflected to the motor",
    "viscous": "Viscous friction",
    "coulomb": "Coulomb friction",
    "stiffness": "Stiffness at rest",
    "micro_damping": "Damping in presliding",
    "offset": "Constant offset (gravity)",
    "break_away": "Break-away torque",
    "stribeck_velocity": "Stribeck velocity",
    "reference_filter": "Reference filter pole",
}


class Parameter(NamedTuple):
    """A parameter as identified or adapted; SI. `source` says where it comes from."""

    name: str
    value: float
    standard_error: float | None
    unit: str
    source: str = ""


class Written(NamedTuple):
    """A drive parameter before and after the run; SI. `unit` may be empty."""

    name: str
    before: float | None
    after: float | None
    unit: str = ""


def meaning(name: str) -> str:
    """What a parameter is, in words; dotted names are explained by their last part."""
    last = name.rsplit(".", 1)[-1]
    return MEANING.get(last, name.replace("_", " ").replace(".", ", "))


def parameter_table(parameters: Sequence[Parameter], title: str = "Parameters") -> Table:
    """Value with its 95 % interval, and where it comes from."""
    rows = []
    for p in parameters:
        half = None if p.standard_error is None else 1.96 * p.standard_error
        relative = _percent(half, p.value)
        rows.append((meaning(p.name), p.name, quantity(p.value, p.unit, half), relative, p.source))
    return Table(
        title,
        ("Parameter", "Name in files", "Value ± 95 %", "±", "From"),
        rows,
        "SI, motor side. The interval covers the true value in 95 of 100 such measurements, "
        "where the model holds.",
        frozenset({2, 3}),
    )


def written_table(changes: Sequence[Written], title: str = "Written to the drive") -> Table:
    """Old and new value of every parameter that the run touched."""
    rows = [
        (
            w.name,
            _optional(w.before, w.unit),
            _optional(w.after, w.unit),
            "" if w.before == w.after else "changed",
        )
        for w in changes
    ]
    return Table(
        title, ("Drive parameter", "Before", "Now", ""), rows, "Read back from the drive.", frozenset({1, 2})
    )


def proof_table(changes: Sequence[Change], repeats: int, title: str = "Proof on the benchmark") -> Table:
    """Before and after with the confidence interval of the difference."""
    rows = []
    for change in changes:
        known = [abs(v) for v in (change.before, change.after) if v is not None]
        factor, unit = multiple(max(known, default=0.0), change.unit)
        interval = "–"
        if change.interval is not None:
            low, high = (significant(edge * factor) for edge in change.interval)
            interval = f"{low} … {high} {unit} ({100 * change.confidence:g} %)"
        before, after = (_optional(v, change.unit) for v in (change.before, change.after))
        rows.append((change.name, before, after, interval))
    note = f"{repeats} measurements each, taken in turn." if repeats else ""
    return Table(title, ("Measure", "Before", "After", "Difference"), rows, note, frozenset({1, 2, 3}))


def limit_facts(limits: Mapping[str, tuple[float, str]]) -> dict[str, str]:
    """Limits as name → text from name → (value, unit)."""
    return {
        name.replace("_", " "): f"{_short(value)} {unit}".strip() for name, (value, unit) in limits.items()
    }


def _short(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def _percent(half: float | None, value: float) -> str:
    if half is None or value == 0:
        return "–"
    return f"{significant(100 * abs(half / value), 2)} %"


def _optional(value: float | None, unit: str) -> str:
    if value is None:
        return "–"
    return quantity(value, unit) if unit else _short(value)
