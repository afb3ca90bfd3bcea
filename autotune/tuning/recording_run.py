"""Playing one programme for its recording: the same care as in a tuning run, and nothing written for good."""

from __future__ import annotations

from pathlib import Path

from autotune.experiments.programmes import build
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Recording
from autotune.tuning.drive_recorder import record_by_drive, recorder_fits
from autotune.tuning.journal import Journal
from autotune.tuning.preparation import Hold, connected, prepared
from autotune.tuning.recovery import recover
from autotune.tuning.run_directory import Opening, axis_lock, discard_unused, make_run_directory


def record_programme(hold: Hold, programme: str, out: Path) -> Recording:
    """Plays `programme` and writes the recording to `out`, sampled by the drive where it has a recorder.

    What was measured is kept in the run's folder too.

    Raises:
        ConfigurationError: no such programme, or the limits are too small for it.
        AutotuneError: whatever ended it; the axis is at rest and everything is put back.
    """
    axis = hold.axis
    experiments = build(programme, axis)
    with axis_lock(hold.runs, axis.name):
        started = hold.clock()
        directory = make_run_directory(hold.runs, axis.name, started)
        journal = Journal.begin(directory, axis.name, axis.fingerprint, started)
        opening = Opening(hold.open_loop)
        try:
            with connected(opening, journal, hold.reporter) as loop:
                for sentence in recover(loop, hold.runs, journal):
                    hold.reporter.say(sentence)
                with prepared(hold, loop, journal) as session:
                    session.begin("record", sum(experiment.duration for experiment in experiments))
                    if recorder_fits(loop, experiments):
                        hold.reporter.say("sampled by the drive's own recorder")
                        recording = record_by_drive(session, programme, experiments)
                    else:
                        recording, _ = session.play(programme, experiments)
        finally:
            if opening.failed(journal):
                discard_unused(directory)
            elif not journal.state.left_something:
                journal.note(outcome="not_applied")
    write_recording(recording, out)
    return recording
