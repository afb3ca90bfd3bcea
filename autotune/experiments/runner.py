"""Plays experiments on a drive: power on, guard, publish, power off whatever happens.

`Programme` is a routine (see `autotune.core.loop`): it is picklable and runs in the cyclic loop's
process. Between two experiments of one mode the axis stays powered; a mode is changed at rest, with
power off and on again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from autotune.core.axis import Limits
from autotune.core.drive import HOLD, Command, CutsPower, Drive, Mode, Sample
from autotune.core.errors import AutotuneError, ConfigurationError, DriveFault, GuardStop
from autotune.core.loop import Publish
from autotune.experiments.experiment import Experiment
from autotune.experiments.guard import Guard
from autotune.experiments.motion_watch import Learnt
from autotune.experiments.path import Item, Mark, Switch, unique
from autotune.experiments.standstill import stands
from autotune.recordings.recording import CONDITIONING

REST_SECONDS = 0.1
SLACK_SECONDS = 1.0  # machine time that ways between experiments may take beyond the prediction


@dataclass(frozen=True, slots=True)
class PlayedExperiment:
    """What became of one experiment: machine time, cycles played and lost, and what it returned."""

    name: str
    seconds: float
    samples: int
    missed: int
    result: object = None


@dataclass(frozen=True, slots=True)
class Played:
    """What a programme did; `learnt`: what the guard knows of the axis now."""

    machine_seconds: float
    experiments: tuple[PlayedExperiment, ...]
    learnt: Learnt | None = None

    def result(self, name: str) -> object:
        """What the last experiment of that name returned.

        Raises:
            ConfigurationError: no experiment of that name was played.
        """
        for played in reversed(self.experiments):
            if played.name == name:
                return played.result
        names = ", ".join(unique([played.name for played in self.experiments]))
        raise ConfigurationError(f"no experiment {name!r} was played, only {names or 'none'}")


@dataclass(frozen=True, slots=True)
class Budget:
    """Machine time: what a whole run may use (`limits.machine_seconds`) and has used [s]."""

    seconds: float
    used: float = 0.0

    @property
    def left(self) -> float:
        return max(self.seconds - self.used, 0.0)

    def spend(self, seconds: float) -> Budget:
        return Budget(self.seconds, self.used + seconds)


@dataclass(frozen=True)
class Programme:
    """Experiments to be played one after the other.

    Attributes:
        experiments: in order.
        limits: in force, the tighter of axis file and drive (see `limits_guarded`).
        seconds: machine time that is left for it [s].
        learnt: by the guard of the programme before it in the same session.
    """

    experiments: tuple[Experiment, ...]
    limits: Limits
    seconds: float
    learnt: Learnt | None = None

    @property
    def labels(self) -> Sequence[str]:
        """Labels of all experiments; `conditioning` comes first."""
        return unique([CONDITIONING, *(label for e in self.experiments for label in e.labels)])

    @property
    def duration(self) -> float:
        """Predicted machine time [s]."""
        return sum(experiment.duration for experiment in self.experiments)

    def check(self, period: float) -> None:
        """Finds out, before anything moves, whether all of it may be played.

        Raises:
            ConfigurationError: limits too small for an experiment, too little machine time, or another
                cycle than the drive's.
        """
        for experiment in self.experiments:
            experiment.requirements(self.limits)
            if abs(experiment.motion.period - period) > 1e-9:
                raise ConfigurationError(
                    f"experiment {experiment.name!r} was planned for a cycle of {experiment.motion.period:g} "
                    f"s, but the drive's is {period:g} s; set cycle = {period:g} in the axis file"
                )
        if self.duration > self.seconds + SLACK_SECONDS:
            raise ConfigurationError(
                f"{', '.join(unique([e.name for e in self.experiments]))} would take {self.duration:.0f} s "
                f"of machine time, but only {self.seconds:.0f} s are left; raise limits.machine_seconds or "
                "play fewer"
            )

    def __call__(self, drive: Drive, publish: Publish) -> Played:
        """Plays all; the axis is at rest and without power when this returns or raises.

        Raises:
            ConfigurationError: see `check`; nothing has moved then.
            GuardStop: a limit would have been broken; or, before power, see `standstill.stands`.
            NotEnoughExcitation: an experiment could not do what it is for.
            DriveFault, LinkError, StateError: from the drive.
        """
        self.check(drive.period)
        stands(drive, self.limits)
        for experiment in self.experiments:
            experiment.prepare()
        player = _Player(self, drive, publish)
        try:
            played = player.play()
        except BaseException as error:
            _power_off(drive, error, player.blind)
            raise
        drive.disable()
        return played


def _power_off(drive: Drive, error: BaseException, blind: bool = False) -> None:
    """Power off, without hiding why; if even that fails, the first error says so.

    Args:
        blind: the encoder was in doubt when the error came, whatever that is: it is not to be braked by.
    """
    try:
        if (error.blind if isinstance(error, GuardStop) else blind) and isinstance(drive, CutsPower):
            drive.cut()
        else:
            drive.disable()
    except DriveFault as second:  # power is off, and something came with it
        error.add_note(f"and while power was taken off: {second}")
    except AutotuneError as second:
        error.add_note(
            f"and then power could not be taken off: {second}; use the emergency stop if the axis is powered"
        )


class _Player:
    """One pass through a programme."""

    def __init__(self, programme: Programme, drive: Drive, publish: Publish) -> None:
        self._programme = programme
        self._drive = drive
        self._publish = publish
        self._index = {label: index for index, label in enumerate(programme.labels)}
        resolution = min((one.motion.resolution for one in programme.experiments), default=0.0)
        seconds = programme.seconds + SLACK_SECONDS
        self._guard = Guard(programme.limits, drive.period, resolution, seconds, programme.learnt)
        self._mode: Mode | None = None
        self._last = HOLD
        self._count = 0
        self._missed = 0

    @property
    def blind(self) -> bool:
        """Whether the encoder may not show just now what the axis does."""
        return self._guard.doubtful

    def play(self) -> Played:
        done: list[PlayedExperiment] = []
        sample: Sample | None = None
        for experiment in self._programme.experiments:
            began, count, missed = self._guard.elapsed, self._count, self._missed
            sample = self._ready(experiment, sample)
            sample, result = self._perform(experiment, sample)
            seconds = self._guard.elapsed - began
            cycles = (self._count - count, self._missed - missed)
            done.append(PlayedExperiment(experiment.name, seconds, *cycles, result))
        return Played(self._guard.elapsed, tuple(done), self._guard.learnt)

    def _ready(self, experiment: Experiment, sample: Sample | None) -> Sample:
        """Power in the mode that the experiment begins with; the axis holds where it is."""
        self._guard.where = f"experiment {experiment.name!r}"
        if sample is not None and self._mode is experiment.mode:
            return sample
        return self._switch(Switch(experiment.mode), sample, 0, 0)

    def _switch(self, to: Switch, sample: Sample | None, label: int, repeat: int) -> Sample:
        """Power off at rest, if it was on, and on again in another mode."""
        if sample is not None:
            self._rest(sample, label, repeat)
            self._drive.disable()
        self._drive.enable(to.mode)
        self._mode = to.mode
        self._last = HOLD._replace(torque=to.torque)
        sample = self._drive.step(self._last)
        self._record(sample, label, repeat)
        self._guard.begin(to.mode, sample)
        return sample

    def _rest(self, sample: Sample, label: int, repeat: int) -> None:
        """Repeats the last command, which was one of rest, for a moment before power goes.

        A torque is never repeated: what drifts would go on drifting. The drive's own stop is at once.
        """
        if self._mode is Mode.TORQUE:
            return
        still = self._last._replace(velocity=0.0)
        for _ in range(max(round(REST_SECONDS / self._drive.period), 1)):
            self._guard.check(sample, still)
            sample = self._drive.step(still)
            self._record(sample, label, repeat)

    def _record(self, sample: Sample, label: int, repeat: int) -> None:
        self._publish(sample, label, repeat)
        self._count += 1
        self._missed += sample.missed

    def _perform(self, experiment: Experiment, sample: Sample) -> tuple[Sample, object]:
        """The cycle: command from the experiment, past the guard, to the drive; sample back and out."""
        steps = experiment.run(sample)
        send, check, step, record = steps.send, self._guard.check, self._drive.step, self._record
        label = repeat = 0
        item: Item = next(steps)
        try:
            while True:
                if type(item) is Command:
                    check(sample, item)
                    sample = step(item)
                    record(sample, label, repeat)
                    self._last = item
                elif type(item) is Mark:
                    label, repeat = self._index[item.label], item.repeat
                elif type(item) is Switch and item.mode is not self._mode:
                    sample = self._switch(item, sample, label, repeat)
                try:
                    item = send(sample)
                except StopIteration as end:
                    return sample, end.value
        finally:
            steps.close()
