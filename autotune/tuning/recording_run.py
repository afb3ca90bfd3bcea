"""Playing one programme for its recording: the same care as in a tuning run, and nothing written for good."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from autotune.experiments.programmes import Choices, build
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Recording
from autotune.tuning.drive_recorder import record_by_drive, recorder_fits
from autotune.tuning.preparation import SessionRequest, connected, own_run, prepared
from autotune.tuning.recovery import recover


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
