"""Tables of the pages about models: everything that the command says in lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from autotune.diagnosis.compare import Compared
from autotune.diagnosis.verdict import Diagnosis
from autotune.models.drive_model import DriveModel, staircase
from autotune.models.table import effect_kind
from autotune.view.report import Table
from autotune.view.scale import quantity

_RIGHT = frozenset({1, 2})


def error_table(result: Compared, unit: str, motion_unit: str) -> Table:
    """How large the error is, as a whole and by kind of motion."""
    rows = [
        ["error, rms", quantity(result.error_rms, unit)],
        ["of the torque", f"{100.0 * result.relative_error:.2f} %"],
        ["noise floor, rms", floor_text(result.noise_floor_rms, result.noise_floor_interval, unit)],
    ]
    interval = result.noise_floor_interval
    if interval is None:
        rows.append(["explains of the torque's variance", f"{100.0 * result.explained:.2f} %"])
    else:
        rows.append(["explained of what can be explained", f"{100.0 * result.explained:.2f} %"])
        if result.error_rms <= interval[1]:
            rows.append(["", "the error is not above what noise leaves"])
    if math.isfinite(result.position_rms):
        rows.append(["position, simulated against measured, rms", quantity(result.position_rms, motion_unit)])
    rows += [
        [f"error in {name.replace('_', ' ')}", quantity(value, unit)]
        for name, value in result.regimes.items()
        if math.isfinite(value)
    ]
    return Table("The error in figures", ("", ""), rows, numeric=frozenset({1}))


def worst_table(result: Compared, units: Mapping[str, str], motion_unit: str) -> Table:
    """Stretches with more than their part of the error."""

    def unit_of(coordinate: str) -> str:
        return units[coordinate].format(motion_unit).removeprefix("log10 ")

    rows = [
        [
            worst.coordinate.replace("_", " "),
            " to ".join(quantity(edge, unit_of(worst.coordinate)) for edge in (worst.low, worst.high)),
            f"{100.0 * worst.share:.0f} %",
        ]
        for worst in result.worst
    ]
    return Table("Where it is worst", ("over", "range", "of the squared error"), rows, numeric=_RIGHT)


def floor_text(floor: float, interval: tuple[float, float] | None, unit: str) -> str:
    """The noise floor, an estimate, with its interval."""
    if interval is None or not math.isfinite(floor):
        return "unknown: nothing was recorded twice"
    low, high = (quantity(end, unit) for end in interval)
    return f"{quantity(floor, unit)} ({low} to {high}), estimated from what repeats do not share"


def effects_table(effects: Sequence[str]) -> Table:
    """What was found: what it looks like, what causes it, what can be done."""
    kinds = [effect_kind(name) for name in effects]
    rows = [[kind.name.replace("_", " "), kind.looks_like, kind.cause, kind.remedy] for kind in kinds]
    return Table("What was found", ("effect", "looks like", "caused by", "what to do"), rows)


def candidates_table(result: Diagnosis, unit: str) -> Table:
    """Every candidate with its evidence: why it was taken, or why not."""
    rows = [
        [
            one.effect.replace("_", " "),
            f"{100.0 * one.gain:.1f} %".replace("-", "−"),
            "accepted" if one.accepted else "not accepted",
            one.why,
        ]
        for one in result.candidates
    ]
    rivals = [f"Cannot be told apart for certain: {', '.join(one)}." for one in result.confusable]
    note = " ".join(
        [
            "How far the squared error falls on experiments that the fit has not seen; accepted ones first.",
            *rivals,
        ]
    ).replace("_", " ")
    return Table(
        "Candidates and their evidence", ("effect", "error falls by", "", "why"), rows, note, frozenset({1})
    )


def where_table(where: Mapping[str, float], floor: float, unit: str) -> Table:
    """Share of the error that follows each coordinate, and the floor under it."""
    rows = [
        [name.replace("_", " "), f"{100.0 * share:.0f} %"]
        for name, share in sorted(where.items(), key=lambda item: -item[1])
    ]
    note = (
        f"Noise floor {quantity(floor, unit)} rms." if math.isfinite(floor) else "The noise floor is unknown."
    )
    return Table("Where the error sits", ("over", "of its variance"), rows, note, frozenset({1}))


def parameters_table(model: DriveModel) -> Table:
    """Every parameter with its standard error."""
    rows = [
        [name, f"{value.value:.5g}", f"{value.standard_error:.2g}" if value.standard_error is not None else "–",
         "" if model.unit(name) == "1" else model.unit(name)]
        for name, value in model.parameters.items()
    ]  # fmt: skip
    columns = ("parameter", "value", "± (standard error)", "unit")
    return Table("Parameters", columns, rows, "SI, motor side.", _RIGHT)


def story_table(model: DriveModel) -> Table | None:
    """The steps of the model's history; None without any."""
    rows, before = [], None
    unit = model.torque_symbol
    for stair in staircase(model.history):
        change = f"{100.0 * (stair.error / before - 1.0):+.0f} %".replace("-", "−") if before else ""
        rows.append([stair.action, quantity(stair.error, unit), change])
        before = stair.error
    if not rows:
        return None
    floors = [entry.noise_floor for entry in model.history if entry.error_after is not None]
    note = (
        f"Noise floor (an estimate): {quantity(floors[-1], unit)}."
        if floors and floors[-1] is not None
        else ""
    )
    return Table("Step by step", ("step", "error on data that the fit never saw", ""), rows, note, _RIGHT)
