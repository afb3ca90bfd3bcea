"""Playing one programme for its recording: the same care as in a tuning run, and nothing written for good."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.experiments.experiment import Experiment, PlannedExperiment
from autotune.experiments.path import Plan
from autotune.experiments.programmes import Choices, build
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Recording
from autotune.tuning.drive_recorder import record_by_drive, recorder_fits
from autotune.tuning.preparation import SessionRequest, connected, own_run, prepared
from autotune.tuning.recovery import recover

HEAD_LINES = 3  # of a file of set points, before its rows


@dataclass(frozen=True, slots=True)
class Played:
    """What a programme has measured, and the run's folder that has it in `recordings`."""

    recording: Recording
    directory: Path


def record_programme(
    request: SessionRequest, programme: str, out: Path, rivals: tuple[str, ...] | None = None
) -> Recording:
    """Plays `programme` and writes the recording to `out`; see `play_programme`."""
    recording = play_programme(request, programme, rivals).recording
    write_recording(recording, out)
    return recording


def play_programme(request: SessionRequest, programme: str, rivals: tuple[str, ...] | None = None) -> Played:
    """Plays `programme` for a recording in the run's folder, sampled by the drive where it has a recorder.

    `rivals`: what programme `decide` is to tell apart.

    Raises:
        ConfigurationError: no such programme, or the limits are too small for it.
        AutotuneError: whatever ended it; the axis is at rest and everything is put back.
    """
    axis = request.axis
    experiments = build(programme, axis, Choices(rivals=rivals))
    with (
        own_run(request) as run,
        connected(run.opening, run.journal, request.reporter) as loop,
    ):
        for sentence in recover(loop, request.runs, run.journal):
            request.reporter.say(sentence)
        with prepared(request, loop, run.journal) as session:
            session.begin("record", sum(experiment.duration for experiment in experiments))
            if recorder_fits(loop, experiments):
                request.reporter.say("sampled by the drive's own recorder")
                recording = record_by_drive(session, programme, experiments)
            else:
                recording, _ = session.play(programme, experiments)
    kept = run.directory / "recordings" / f"{programme}.parquet"
    if not kept.is_file():  # the drive's own recorder writes none
        kept.parent.mkdir(exist_ok=True)
        write_recording(recording, kept)
    return Played(recording, run.directory)


def write_set_points(axis: Axis, programme: str, out: Path, rivals: tuple[str, ...] | None = None) -> float:
    """Writes what `programme` would command to a CSV, for a rig that this program does not drive; seconds of it.

    Its columns `time, experiment, repeat, reference` are those of a recording, to which the rig adds `position` and
    `torque`. The axis has to stand at rest at the middle of its travel first, where everything begins and ends.

    Raises:
        ConfigurationError: no such programme, limits too small for it, or a motion that is not known beforehand.
    """
    plans = [_plan(one, axis) for one in build(programme, axis, Choices(rivals=rivals))]
    lines = [
        f"# motion_unit: {axis.motion_unit}",
        f"# sample_period: {axis.cycle:.12g}",
        "time,experiment,repeat,reference",
    ]
    for plan in plans:
        edges = [*(start for start, _, _ in plan.marks), len(plan.reference)]
        for (start, label, repeat), stop in zip(plan.marks, edges[1:], strict=True):
            begun = len(lines) - HEAD_LINES
            positions = plan.reference[start:stop].tolist()
            lines += [
                f"{(begun + k) * axis.cycle:.9g},{label},{repeat},{position:.12g}"
                for k, position in enumerate(positions)
            ]
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return sum(plan.duration for plan in plans)


def _plan(experiment: Experiment, axis: Axis) -> Plan:
    """The reference of an experiment that is known beforehand and stays inside the limits."""
    if not isinstance(experiment, PlannedExperiment) or experiment.plan.torque.any():
        raise ConfigurationError(
            f"--set-points: what experiment {experiment.name!r} commands depends on what it measures; "
            "'diagnosis' and 'decide' are known beforehand"
        )
    experiment.requirements(axis.limits)
    return experiment.plan
