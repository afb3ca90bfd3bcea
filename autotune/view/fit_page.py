"""A page with figures about a fit: characteristic, presliding, Dahl's curve, measured and model."""

from __future__ import annotations

from pathlib import Path

from autotune.core.errors import NotEnoughExcitation
from autotune.diagnosis.compare import Compared
from autotune.identify.estimate import Estimate
from autotune.identify.run import Identification
from autotune.identify.steady_state import identify_steady_state
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording
from autotune.view.identification_pictures import (
    identification_pictures,
    methods_table,
    steady_state_picture,
)
from autotune.view.model_pages import comparison_pictures
from autotune.view.model_tables import error_table
from autotune.view.report import Picture, Report, Table, write_report
from autotune.view.scale import quantity, significant


def write_fit(
    path: Path,
    recording: Recording,
    model: DriveModel,
    estimate: Estimate,
    text: str,
    found: Identification | None = None,
    compared: Compared | None = None,
) -> None:
    """Figures of the experiments where they were made, of the speed curve elsewhere; parameters; notes."""
    unit = model.motion_unit
    pictures: list[Picture] = []
    tables = [_parameters(model, estimate)]
    if found is not None:
        pictures += identification_pictures(found, unit)
        if found.presliding is not None:
            tables.append(methods_table(found.presliding.comparison, unit))
    else:
        pictures += _speed_curve(recording)
    if compared is not None:
        pictures += comparison_pictures(compared, model)
        tables.append(error_table(compared, model.torque_symbol, unit))
    notes = [[note] for note in estimate.notes]
    if notes:
        tables.append(Table("Notes", ("what the data say",), notes))
    report = Report("Fitted model", "information", text, pictures=pictures, tables=tables, sign_off=False)
    write_report(path, report)


def _speed_curve(recording: Recording) -> list[Picture]:
    units = recording.metadata.motion_unit, recording.metadata.torque_unit
    try:
        return [steady_state_picture(identify_steady_state(recording), *units)]
    except NotEnoughExcitation:
        return []


def _parameters(model: DriveModel, estimate: Estimate) -> Table:
    rows = []
    for name, value in model.parameters.items():
        found = estimate.parameters.get(name)
        span = " … ".join(significant(edge, 4) for edge in found.interval) if found is not None else ""
        if found is not None and not found.identified:
            span = "not identified"
        rows.append([name, quantity(value.value, model.unit(name), value.standard_error), span])
    columns = ("parameter", "value", "95 % interval")
    return Table("Parameters", columns, rows, numeric=frozenset({1, 2}))
