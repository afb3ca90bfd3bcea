"""One run's hold on an axis: the loop, the limits in force, machine time, journal and recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from autotune.core.arrays import Floats
from autotune.core.axis import Axis, Limits
from autotune.core.loop import Loop, Watch
from autotune.experiments.experiment import Experiment
from autotune.experiments.motion_watch import Learnt
from autotune.experiments.path import Motion
from autotune.experiments.record import Progress, Recorder, metadata_for, play
from autotune.experiments.runner import Budget, Played, Programme
from autotune.recordings.recording import Controller, Recording
from autotune.tuning.journal import Journal
from autotune.tuning.observer import Observer, show
from autotune.tuning.progress import Reporter
from autotune.tuning.run_directory import save_recording
from autotune.view.pages import Page


@dataclass
class Session:
    """What every stage needs. Only `budget`, `written`, `seconds` and what the guard has learnt change.

    Attributes:
        limits: in force, the tighter of axis file and drive.
        controller: of the drive, as its parameters tell; None if they do not.
        identity: of the drive, as it tells it.
        runs: folder of all runs (backups live below it); `directory`: of this run.
        clock: local time, passed in.
        observers: see every programme, stage and finding.
        written: recordings saved so far, by name; `seconds`: machine time of each.
    """

    axis: Axis
    loop: Loop
    limits: Limits
    controller: Controller | None
    identity: Mapping[str, int | str]
    runs: Path
    directory: Path
    journal: Journal
    reporter: Reporter
    clock: Callable[[], datetime]
    budget: Budget
    observers: Sequence[Observer] = ()
    written: dict[str, Path] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    _learnt: Learnt | None = None
    _stage_seconds: float = 1.0
    _stage_began: float = 0.0

    @property
    def motion(self) -> Motion:
        """Scales of the axis's experiments."""
        return Motion.of(self.axis)

    def play(
        self, name: str, experiments: Sequence[Experiment], also: Watch | None = None
    ) -> tuple[Recording, Played]:
        """Plays experiments as one programme; what was measured is saved in every case.

        `also`: sees the rows too.

        Raises: as `Programme`; the rows until then are in `recordings/<name>.parquet`.
        """
        programme = Programme(tuple(experiments), self.limits, self.budget.left, self._learnt)
        recorder = Recorder(metadata_for(self.axis, self.controller), programme.labels)
        watches = [observer.programme(programme.labels) for observer in self.observers]
        watches += [also] if also is not None else []
        try:
            played = play(self.loop, programme, recorder, *watches, tell=self._tell)
            self._learnt = played.learnt
        finally:
            self.budget = self.budget.spend(recorder.machine_seconds)
            self.seconds[name] = round(recorder.machine_seconds, 3)
            recording = recorder.recording()
            if len(recording):
                self.written[name] = save_recording(self.directory, name, recording)
        return recording, played

    def milli(self, value: float) -> str:
        """A tracking error in words: in thousandths of the motion unit."""
        return f"{1e3 * value:.2f} m{self.axis.motion_unit}"

    def begin(self, stage: str, seconds: float) -> None:
        """Tells the reporter and the journal that a stage of about `seconds` machine time begins."""
        self._stage_seconds, self._stage_began = seconds, self.budget.used
        self.journal.note(stage=stage)
        self.reporter.stage(stage, seconds)
        for observer in self.observers:
            observer.stage(stage)

    def watching(self, labels: Sequence[str]) -> Watch | None:
        """A watch for a routine that is no programme; None where nobody looks on."""
        watches = [observer.programme(labels) for observer in self.observers]
        if not watches:
            return None

        def watch(rows: Floats) -> None:
            for one in watches:
                one(rows)

        return watch

    def show(self, make: Callable[[], Page]) -> None:
        """Shows what a stage found to whoever looks on."""
        show(self.observers, self.reporter, make)

    def _tell(self, progress: Progress) -> None:
        """Programmes of one stage follow one another: what counts is the stage's machine time."""
        spent = self.budget.used - self._stage_began + progress.seconds
        self.reporter.progress(min(spent / self._stage_seconds, 1.0))


def controller_of(parameters: Mapping[str, float]) -> Controller | None:
    """The position controller that the drive's parameters describe; None if they do not."""
    try:
        return Controller(
            parameters["controller.kp"],
            parameters["controller.kd"],
            parameters["controller.ki"],
            parameters.get("controller.derivative_filter", 1.0),
        )
    except KeyError:
        return None
