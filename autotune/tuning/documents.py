"""What a run leaves to look at: `report.html` and `run.rrd`, drawn from its findings."""

from __future__ import annotations

import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from autotune import __version__
from autotune.core.arrays import Floats
from autotune.core.axis import Axis, Limits
from autotune.core.errors import AutotuneError
from autotune.core.friction_table import in_words
from autotune.diagnosis.fit_recordings import model_torque
from autotune.identify.run import Identification
from autotune.models.drive_model import DriveModel
from autotune.recordings.files import read_recording
from autotune.recordings.recording import Recording, concatenate
from autotune.tuning.diagnosis_pages import diagnosis_pictures, diagnosis_tables
from autotune.tuning.final_model import final_model_pictures, result_model
from autotune.tuning.findings import Findings
from autotune.tuning.objects import objects_of
from autotune.tuning.outcome import Outcome, RunResult
from autotune.tuning.parameter_tables import (
    feedforward_table,
    friction_table,
    held_out_table,
    identified_table,
    ripple_table,
)
from autotune.tuning.shown_pages import (
    adaptation_shown,
    before_after_of,
    diagnosis_shown,
    fit_shown,
    limits_shown,
    proof_shown,
    traces_of,
    verdict_shown,
)
from autotune.tuning.stage_prove import COMMITTED, windows_of
from autotune.view import data
from autotune.view.identification_pictures import identification_pictures, methods_table
from autotune.view.pages import Page
from autotune.view.report import Change, Picture, Report, Table, write_report
from autotune.view.report import Outcome as ReportOutcome
from autotune.view.rerun_file import FinalValue, Shown, write_rrd
from autotune.view.scale import quantity

DEFECT = "report-defect.txt"
LEAST_POINTS = 200
NEXT_STEPS = {
    Outcome.KEPT: (
        "Run the machine's own programme once and look at the workpiece or the contour.",
        "Sign this report and keep it with the machine; 'autotune rollback' undoes the change.",
    ),
    Outcome.HOST_ONLY: (
        "The drive is as it was, and does what it did before. The gain is there only while a host plays the "
        "feedforward as torque offset in every cycle; without one nothing has changed.",
        "'autotune export' with this run's folder writes it for the controller that you have: C, LinuxCNC, FMU, "
        "structured text, a TwinCAT table or CSV. To have it in the drive itself, use one that holds a feedforward.",
    ),
    Outcome.ROLLED_BACK: (
        "The drive is as it was. Look at the committed window in run.rrd: something changed after the proof.",
    ),
    Outcome.NOT_APPLIED: (
        "The drive is as it was. Read the reason above; the notes say which experiment fell short and why.",
    ),
    Outcome.ABORTED: ("Clear the cause named above, then run again.",),
}
PROVED_STEPS = (
    "The drive is as it was. What is proved is written, and measured again, once it is approved at the service that "
    "has the axis, or by 'autotune run' with --only commit.",
)
RESUME = "--resume"
STAGE_STEPS = {
    "check": ("Nothing has moved and nothing was written. 'autotune run' without --only does the rest.",),
    "prove": ("The drive is as it was. 'autotune run' with --only commit writes what was proved.",),
}


@dataclass(frozen=True)
class Material:
    """All that the documents are made of."""

    axis: Axis
    result: RunResult
    findings: Findings
    identification: Identification | None = None
    limits: Limits | None = None
    identity: Mapping[str, int | str] = field(default_factory=dict)
    recordings: Sequence[Path] = ()


def write_documents(material: Material) -> None:
    """Writes report.html and run.rrd into the run's folder.

    Raises:
        OSError, AutotuneError: a file could not be written.
    """
    directory = material.result.run_directory
    write_report(directory / "report.html", build_report(material))
    recordings = [read_recording(path) for path in material.recordings]
    if recordings:
        write_rrd(directory / "run.rrd", _in_sequence(recordings), _shown(material, recordings))


def without_documents(material: Material) -> str:
    """Writes them; returns "", or why they are missing: what the run did and found stays true without them."""
    directory = material.result.run_directory
    try:
        write_documents(material)
    except (AutotuneError, OSError) as error:
        return f"The report could not be written: {error}."
    except Exception as error:  # noqa: BLE001 - the last line of defence: the axis is done, its result is told
        with suppress(OSError):
            (directory / DEFECT).write_text(traceback.format_exc(), encoding="utf-8")
        return (
            f"The report could not be written, which is a defect of autotune ({type(error).__name__}: {error}); "
            f"run.json has the result, {DEFECT} beside it what to send with a report of the defect."
        )
    return ""


def build_report(material: Material) -> Report:
    """The report of a run."""
    result, unit = material.result, material.axis.motion_unit
    return Report(
        title=f"Axis {material.axis.name}",
        outcome=_shown_outcome(material),
        verdict=result.verdict,
        subtitle=f"Tuning run of {result.started.replace('T', ' ')}, {result.machine_seconds:.0f} s of machine time, "
        f"autotune {__version__}",
        changes=_changes(material),
        pictures=_pictures(material),
        tables=_tables(material),
        identity={
            "axis file": material.axis.name,
            "link": material.axis.link,
            **_texts(material.identity),
            "program": f"autotune {__version__}",
        },
        limits=_limits(material.limits or material.axis.limits, unit),
        next_steps=(*_next_steps(material), *_way_to_traces(material)),
        data=result.as_json(),
        sign_off=result.outcome is Outcome.KEPT,
    )


def _shown_outcome(material: Material) -> ReportOutcome:
    """A stage that did what was asked of it is no run that found nothing to apply, nor is one that nobody approved."""
    result = material.result
    if _waits(material):
        return "proved"
    if result.stage_done:
        return "checked" if result.only == "check" else "stage"
    return result.outcome.value


def _waits(material: Material) -> bool:
    """Something is proved and ready to be written, and was not approved while the run lasted."""
    result, findings = material.result, material.findings
    ready = findings.better and findings.planned is not None
    return ready and result.outcome is Outcome.NOT_APPLIED and not result.refused and result.only is None


def _next_steps(material: Material) -> tuple[str, ...]:
    result = material.result
    if _waits(material):
        return PROVED_STEPS
    if result.stage_done:
        return STAGE_STEPS.get(
            str(result.only), ("The drive is as it was. Go on with the next stage, or run all of them.",)
        )
    if result.outcome is Outcome.ABORTED and RESUME in result.verdict:
        return ("Go on with --resume as said above, or run again from the beginning.",)
    steps = NEXT_STEPS[result.outcome]
    if result.outcome is not Outcome.KEPT or not result.reduction.get("lost"):
        return steps
    rest = ", ".join(name.replace("_", " ") for name in result.reduction["lost"])
    return (
        f"Let the host play feedforward.toml as torque offset, less what the drive plays, to have the whole gain "
        f"({rest}); or leave it at what the drive does by itself.",
        *steps,
    )


def _way_to_traces(material: Material) -> tuple[str, ...]:
    """How to see what was measured, where something was."""
    if not material.recordings:
        return ()
    return (f"See all traces of this run: autotune view {material.result.run_directory}",)


def _texts(identity: Mapping[str, int | str]) -> dict[str, str]:
    return {
        name: f"0x{value:08X}" if isinstance(value, int) else str(value) for name, value in identity.items()
    }


def _changes(material: Material) -> list[Change]:
    """What is in the drive comes first; what needs a host comes after it, and says so."""
    result, unit = material.result, material.axis.motion_unit
    before, after, proof = result.before, result.after, material.findings.proved
    if before is None:
        return []
    alone = result.committed if result.outcome is Outcome.KEPT else None
    interval = (-proof.proof.interval[1], -proof.proof.interval[0]) if proof else None
    confidence = material.axis.acceptance.confidence
    changes = [
        Change("Peak error, the drive by itself", before.peak_error, alone.peak_error, unit,
               note="quadrant glitch on the benchmark, as committed, without anything from a host"),
        Change("Rms error, the drive by itself", before.rms_error, alone.rms_error, unit),
    ] if alone else []  # fmt: skip
    if alone and not result.reduction:
        return changes
    name = "Peak error, feedforward played by the host" if after else "Peak error (quadrant glitch)"
    how = "" if proof else ", without any feedforward"
    return [
        *changes,
        Change(name, before.peak_error, after.peak_error if after else None, unit, interval, confidence,
               f"peak of the period-averaged error on the benchmark sine{how}"),
        Change("Rms error", before.rms_error, after.rms_error if after else None, unit,
               note="played by the host" if after else ""),
        Change("Largest single error", before.raw_peak_error, after.raw_peak_error if after else None, unit,
               note="played by the host" if after else ""),
    ]  # fmt: skip


def _limits(limits: Limits, unit: str) -> dict[str, str]:
    torque = data.torque_unit(unit)
    units = {
        "position_min": unit,
        "position_max": unit,
        "speed": f"{unit}/s",
        "torque": torque,
        "following_error": unit,
        "deceleration": f"{unit}/s²",
        "temperature": "°C",
        "machine_seconds": "s",
    }
    return {name: f"{getattr(limits, name):g} {text}" for name, text in units.items()}


def _pictures(material: Material) -> list[Picture]:
    from autotune.view import figures

    pictures: list[Picture] = []
    if (tracking := _before_after(material)) is not None:
        pictures.append(
            Picture(
                "Before and after",
                "Tracking error over one period of the benchmark, averaged: before, with what is in the drive now "
                "(where something is), and with the feedforward played by the host. The peaks after each reversal are "
                "the quadrant glitches.",
                figures.before_after(tracking),
            )
        )
    pictures += final_model_pictures(
        material.recordings, result_model(material.result), material.axis.benchmark,
        diagnosed=material.findings.diagnosed is not None, given=material.findings.given is not None,
    )  # fmt: skip
    if traces := _traces(material):
        pictures.append(
            Picture(
                "Adaptation",
                "The thesis's laws (5.14)–(5.16) move the parameters until they settle; the mark at the end is "
                "what refinement made of them.",
                figures.convergence(traces),
            )
        )
    pictures += diagnosis_pictures(material.findings, material.axis.motion_unit)
    if material.identification is not None:
        pictures += identification_pictures(material.identification, material.axis.motion_unit)
    return pictures


def _before_after(material: Material) -> data.BeforeAfter | None:
    proved = material.findings.proved
    return None if proved is None else before_after_of(material.axis, proved, _committed(material))


def _committed(material: Material) -> Sequence[Recording]:
    """Windows with what is in the drive; none where nothing is, or they were not measured in this run."""
    path = _recorded(material, COMMITTED)
    if material.result.outcome is not Outcome.KEPT or path is None:
        return ()
    return windows_of(read_recording(path), COMMITTED)


def _recorded(material: Material, name: str) -> Path | None:
    return next((path for path in material.recordings if path.stem == name), None)


def _traces(material: Material) -> list[data.Trace]:
    adapted, start = material.findings.adapted, material.findings.start
    if adapted is None:
        return []
    return traces_of(adapted, start.stiffness_range if start else None, material.axis.motion_unit)


def _tables(material: Material) -> list[Table]:
    result, unit = material.result, material.axis.motion_unit
    tables: list[Table] = []
    if result.parameters:
        tables.append(identified_table(result))
    if result.feedforward:
        tables.append(feedforward_table(result, material.findings, objects_of(material.axis.profile)))
    if (points := friction_table(result)) is not None:
        tables.append(points)
    if (ripple := ripple_table(material.findings, result.outcome is Outcome.KEPT)) is not None:
        tables.append(ripple)
    if result.held_out:
        tables.append(held_out_table(result))
    tables += diagnosis_tables(material.findings, unit)
    if material.identification is not None and material.identification.presliding is not None:
        tables.append(methods_table(material.identification.presliding.comparison, unit))
    if result.reduction:
        tables.append(_reduction(result))
    if result.notes:
        tables.append(Table("Notes", ("what the experiments say",), [[note] for note in result.notes]))
    return tables


def _reduction(result: RunResult) -> Table:
    """What the drive cannot hold: predicted before the commit, measured after it."""
    found, unit = result.reduction, result.motion_unit
    rows = [
        [label, *(quantity(value, unit) if value is not None else "not measured" for value in pair)]
        for label, pair in (
            ("Peak error", (found["predicted_peak_error"], found["measured_peak_error"])),
            ("Rms error", (found["predicted_rms_error"], found["measured_rms_error"])),
            (
                "Loss of peak error against the full feedforward",
                (found["predicted_loss"], found["measured_loss"]),
            ),
        )
    ]
    host = f"The host has to play: {', '.join(found['host'])}." if found["host"] else ""
    if found["lost"]:
        host += f" Lost where the host does not play feedforward.toml: {', '.join(found['lost'])}."
    note = f"The drive holds {', '.join(in_words(found['drive']))} only. {host}"
    return Table(
        "Reduction to what the drive holds", ("", "predicted", "measured"), rows, note, frozenset({1, 2})
    )


def _shown(material: Material, recordings: Sequence[Recording]) -> Shown:
    finals = [
        FinalValue(name, v["value"], v["standard_error"], v["unit"])
        for name, v in material.result.parameters.items()
    ]
    found = material.identification
    model = material.findings.model or (found.model if found is not None else None)
    return Shown(
        torque_model=None
        if model is None
        else np.concatenate([_torque_of(model, one) for one in recordings]),
        parameters=finals,
        verdict=f"# {material.axis.name}\n\n{material.result.verdict}",
        limits=limits_shown(material.axis),
        pages=[*_pages(material), verdict_shown(material.result)],
    )


def _torque_of(model: DriveModel, recording: Recording) -> Floats:
    """The model's torque for every row; nan where it says nothing of them."""
    try:
        return model_torque(recording, model)
    except (AutotuneError, np.linalg.LinAlgError):
        return np.full(len(recording), np.nan)


def _pages(material: Material) -> list[Page]:
    """A page for each stage that found something."""
    axis, findings, found = material.axis, material.findings, material.identification
    pages: list[Page] = []
    experiments = _recorded(material, "experiment")
    if experiments is not None and found is not None:
        recording = read_recording(experiments)
        pages.append(fit_shown(axis, found, recording))
        if findings.diagnosed is not None:
            pages.append(diagnosis_shown(axis, findings.diagnosed, found.model, recording, findings.given))
    if findings.adapted is not None:
        bounds = findings.start.stiffness_range if findings.start else None
        pages.append(adaptation_shown(axis, findings.adapted, bounds))
    if findings.proved is not None:
        pages.append(proof_shown(axis, findings.proved, _committed(material)))
    return pages


def _in_sequence(recordings: Sequence[Recording]) -> Recording:
    """One recording whose time goes on from part to part."""
    whole = concatenate(recordings)
    time = np.arange(len(whole)) * whole.period
    columns = {**whole.floats, "time": np.asarray(time, dtype=np.float64)}
    return Recording.from_columns(columns, whole.metadata, whole.experiment, whole.repeat, whole.missed)
