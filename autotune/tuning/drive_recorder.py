"""Recording with the drive's own recorder: it samples, the host only fetches, between experiments at rest."""

from __future__ import annotations

from collections.abc import Sequence

from autotune.core.drive_recording import RecordingLoop
from autotune.core.errors import AutotuneError
from autotune.experiments.experiment import Experiment
from autotune.recordings.joining import join
from autotune.recordings.recording import Recording, concatenate
from autotune.tuning.session import Session

SLACK = 1.25  # the way between experiments is not in their predicted durations
EXTRA_SECONDS = 3.0


def recorder_fits(loop: object, experiments: Sequence[Experiment]) -> bool:
    """True where the drive has a recorder that holds the longest experiment."""
    if not isinstance(loop, RecordingLoop):
        return False
    seconds = loop.recorder_seconds()
    return seconds > 0.0 and all(_needed([one]) <= seconds for one in experiments)


def record_by_drive(session: Session, name: str, experiments: Sequence[Experiment]) -> Recording:
    """Plays experiments in as few groups as the recorder holds, and joins what the drive has recorded.

    Raises: as `Session.play`; LinkError where the drive's recording has gaps.
    """
    loop = session.loop
    if not isinstance(loop, RecordingLoop):
        return session.play(name, experiments)[0]
    parts = []
    for number, group in enumerate(groups(experiments, loop.recorder_seconds()), 1):
        loop.begin_recording(min(_needed(group), loop.recorder_seconds() * 0.999))
        label = name if number == 1 else f"{name}-{number}"
        try:
            host, _ = session.play(label, group)
        except BaseException as error:
            _give_up(loop, error)
            raise
        parts.append(join(host, loop.end_recording()))
    return concatenate(parts)


def groups(experiments: Sequence[Experiment], seconds: float) -> list[list[Experiment]]:
    """Experiments in order, each group no longer than the recorder holds."""
    found: list[list[Experiment]] = []
    for one in experiments:
        if found and _needed([*found[-1], one]) <= seconds:
            found[-1].append(one)
        else:
            found.append([one])
    return found


def _needed(experiments: Sequence[Experiment]) -> float:
    return SLACK * sum(one.duration for one in experiments) + EXTRA_SECONDS


def _give_up(loop: RecordingLoop, error: BaseException) -> None:
    """Stops the recorder; what it has is not wanted any more, and why is not hidden."""
    try:
        loop.end_recording()
    except AutotuneError as second:
        error.add_note(f"the drive's recorder was not fetched: {second}")
