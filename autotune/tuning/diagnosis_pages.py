"""The diagnosis of a run in its report: which effects, how the error fell, and what each feedforward gave."""

from __future__ import annotations

from autotune.models.drive_model import DriveModel
from autotune.models.table import effect_kind
from autotune.models.total_friction import total_in_words
from autotune.tuning.findings import Findings
from autotune.tuning.given_model import Given
from autotune.tuning.given_model import table as given_table
from autotune.tuning.stage_diagnose import Diagnosed
from autotune.view.data import Rank, Step, torque_unit
from autotune.view.report import Picture, Table
from autotune.view.scale import quantity

SHOWN = 8
WORTH = 0.005  # of the squared error: candidates that take less away stand in no table
HARMFUL = -0.05  # candidates that make it worse than this are left out of the picture
_NOT_GIVEN = (
    " The run found this about the model that it identified itself, not about the one that was given."
)
_VERDICTS = {
    "none": "Nothing is missing in the identified model that this run could show.",
    "unknown": "Something repeatable is missing that is none of the known effects.",
    "ambiguous": "Something is missing; these recordings cannot tell which of the candidates it is.",
    "failed": "The recordings of this run allow no diagnosis.",
}


def diagnosis_pictures(findings: Findings, motion_unit: str) -> list[Picture]:
    """Ranking of the candidates, and the staircase of the model's error."""
    from autotune.view import figures

    found = findings.diagnosed
    if found is None or not found.candidates:
        return []
    ranks = [
        Rank(c["effect"], c["gain"], c["accepted"], c["why"]) for c in found.candidates if c["gain"] > HARMFUL
    ]
    caption = (
        "How far each effect lowers the squared torque error on experiments that its fit has not seen."
        f"{_NOT_GIVEN if findings.given else ''}"
    )
    pictures = [Picture("What the identified model lacks", caption, figures.ranking(ranks))]
    if findings.given is None and found.model is not None and found.model.history:
        pictures.append(_staircase(found.model, found, motion_unit))
    return pictures


def _staircase(model: DriveModel, found: Diagnosed, motion_unit: str) -> Picture:
    from autotune.view import figures

    entries = [entry for entry in model.history if entry.error_after is not None]
    steps = [Step("as identified", entries[0].error_before or 0.0)] if entries else []
    steps += [Step(entry.action, entry.error_after or 0.0) for entry in entries]
    return Picture(
        "How the model's error fell",
        f"Rms torque error on data not used for the fit ({_unseen(found)}) with each effect that was added.",
        figures.staircase(steps, found.noise_floor_rms, torque_unit(motion_unit)),
    )


def diagnosis_tables(findings: Findings, motion_unit: str) -> list[Table]:
    """What was found, in words, and what each feedforward gave on the benchmark."""
    found = findings.diagnosed
    if found is None:
        return []
    tables = [_verdict(found, motion_unit, findings.given)]
    if findings.given is not None:
        tables.insert(0, given_table(findings.given, findings.modelled, findings.adapted is not None))
    if found.effects:
        rows = [[effect.replace("_", " "), *_words(effect)] for effect in found.effects]
        title = "Effects" if findings.given is None else "Effects that the run named"
        tables.append(Table(title, ("effect", "looks like", "cause", "what can be done"), rows))
    if len((rivals := _rivals(found)).rows):
        tables.append(rivals)
    if findings.modelled is not None and findings.adapted is not None:
        tables.append(_candidates(findings, motion_unit))
    return tables


def _words(effect: str) -> tuple[str, str, str]:
    kind = effect_kind(effect)
    return kind.looks_like, kind.cause, kind.remedy


def _verdict(found: Diagnosed, motion_unit: str, given: Given | None) -> Table:
    names = ", ".join(effect.replace("_", " ") for effect in found.effects)
    unit = torque_unit(motion_unit)
    rows = [["verdict", _VERDICTS.get(found.verdict, f"missing: {names} ({found.confidence})")]]
    if found.error_before is not None and found.error_after is not None:
        fall = f"{quantity(found.error_before, unit)} → {quantity(found.error_after, unit)}"
        rows.append([f"torque error on unseen data ({_unseen(found)})", fall])
    if found.noise_floor_rms is not None:
        rows.append(["noise floor", quantity(found.noise_floor_rms, unit)])
    total = total_in_words(found.model) if found.model is not None else ""
    if total:
        rows.append(["friction of the model", total])
    if found.stiffness is not None:
        text = f"{quantity(found.stiffness, f'{unit}/{motion_unit}')}, all elements together"
        rows.append(["stiffness at rest of the model with these effects", text])
    rows += [
        [f"not fed forward: {name.replace('_', ' ')}", why] for name, why in found.not_fed_forward.items()
    ]
    if found.next_experiment:
        rows.append(["next experiment", found.next_experiment])
    if given is not None:
        return Table("Diagnosis of the identified model", ("", ""), rows, _NOT_GIVEN.strip())
    return Table("Diagnosis", ("", ""), rows)


def _unseen(found: Diagnosed) -> str:
    """In a run the trajectory that may only veto a name is the confirming one."""
    return found.unseen.replace("veto", "the confirming trajectory")


def _rivals(found: Diagnosed) -> Table:
    """Every candidate that takes something away, and why it was or was not accepted."""
    judged = sorted(found.candidates, key=lambda one: -float(one["gain"]))
    rows = [
        [
            one["effect"].replace("_", " "),
            f"{100 * one['gain']:.1f} %",
            "yes" if one["accepted"] else "no",
            one["why"],
        ]
        for one in judged[:SHOWN]
        if one["accepted"] or one["gain"] > WORTH
    ]
    return Table(
        "Candidates", ("effect", "of the squared error", "accepted", "why"), rows, numeric=frozenset({1})
    )


def _candidates(findings: Findings, motion_unit: str) -> Table:
    adapted, modelled = findings.adapted, findings.modelled
    rows: list[list[str]] = []
    if adapted is not None and adapted.steps:
        rows.append(["the thesis's laws", quantity(adapted.steps[0].peak_error, motion_unit)])
        rows.append(["LuGre, refined", quantity(adapted.best.peak_error, motion_unit)])
    if modelled is not None:
        name = "diagnosed model" if findings.given is None else "model that was given"
        rows.append([name, quantity(modelled.steps[0].measured.peak_error, motion_unit)])
        if len(modelled.steps) > 1:
            rows.append([f"{name}, best window", quantity(modelled.best.measured.peak_error, motion_unit)])
    note = modelled.reason if modelled is not None else ""
    return Table(
        "Feedforward candidates", ("feedforward", "peak error on the benchmark"), rows, note, frozenset({1})
    )
