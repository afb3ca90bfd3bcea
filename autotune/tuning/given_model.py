"""A model that a run was given: how it does on this run's experiments beside those that the run has found itself.

The run's diagnosis is that of the model that it identifies; nothing of it was found about the given one. Both stand in
the report, each under its name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from autotune.control.model_feedforward import left_out
from autotune.models.drive_model import DriveModel
from autotune.models.total_friction import total_friction
from autotune.recordings.recording import Recording
from autotune.tuning.stage_diagnose import Diagnosed, error_as_given
from autotune.tuning.stage_model import ModelAdapted
from autotune.view.data import torque_unit
from autotune.view.report import Table
from autotune.view.scale import quantity

NOT_PLAYED = (
    "it has nothing that the identified feedforward lacks, or is too far from it, or no time was left"
)


@dataclass(frozen=True, slots=True)
class Given:
    """Rms torque errors on this run's experiments, all compared in one way; None where they allow no comparison.

    Attributes:
        model: as it was given.
        error, identified, diagnosed: of it, of the model that the run identified, of the one that it diagnosed
            (None also where nothing was named).
    """

    model: DriveModel
    error: float | None
    identified: float | None
    diagnosed: float | None


def compared(recording: Recording, given: DriveModel, found: Diagnosed) -> Given:
    """The given model and those of the run on the run's experiments."""
    diagnosed = None if found.model is None else error_as_given(recording, found.model)[0]
    return Given(given, error_as_given(recording, given)[0], found.error_rms, diagnosed)


def sentence(given: Given) -> str:
    """How both do here, in words."""
    unit = torque_unit(given.model.motion_unit)
    return (
        "The model that was given stands in place of the diagnosed one: its torque error on this run's experiments "
        f"is {_or(given.error, unit)}, that of the identified one {_or(given.identified, unit)}."
    )


def not_proved(modelled: ModelAdapted | None) -> str:
    """Why the given model did not go to the proof; "" where it did."""
    if modelled is None:
        return NOT_PLAYED
    return "" if modelled.chosen else modelled.reason


def as_json(
    given: Given, modelled: ModelAdapted | None, feedforward: Mapping[str, Any] | None
) -> dict[str, Any]:
    """As run.json holds it; `feedforward`: what it gave on the benchmark."""
    return {
        "effects": [effect.name for effect in given.model.effects],
        "error_rms": given.error,
        "identified_error_rms": given.identified,
        "diagnosed_error_rms": given.diagnosed,
        "proved": modelled is not None and modelled.chosen,
        "feedforward": feedforward,
        "not_fed_forward": left_out(given.model),
    }


def table(given: Given, modelled: ModelAdapted | None, adapted: bool) -> Table:
    """The report's table. `adapted`: the run has come so far that the model was to be played."""
    unit, model = torque_unit(given.model.motion_unit), given.model
    effects = ", ".join(effect.name.replace("_", " ") for effect in model.effects)
    rows = [
        ["effects", effects or "none beyond the base model"],
        ["its torque error on this run's experiments", _or(given.error, unit)],
        ["the same of the model that this run identified", _or(given.identified, unit)],
    ]
    if given.diagnosed is not None:
        rows.append(["the same of the model that this run diagnosed", _or(given.diagnosed, unit)])
    rows.append(["its friction in all, viscous part left out", quantity(total_friction(model).value, unit)])
    rows += [[f"not fed forward: {name.replace('_', ' ')}", why] for name, why in left_out(model).items()]
    if adapted:
        why = not_proved(modelled)
        rows.append(["went to the proof", f"no: {why}" if why else "yes"])
    note = (
        "It is the model.toml of this run. The run has not diagnosed it: 'autotune model diagnose' with the recording "
        "experiment and this model says what it lacks. Errors are on data that the run's own models were fitted to."
    )
    return Table("The model that was given", ("", ""), rows, note)


def _or(error: float | None, unit: str) -> str:
    return "not comparable" if error is None else quantity(error, unit)
