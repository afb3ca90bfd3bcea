"""Axes that move, real or simulated: play a programme, tune."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

from threadpoolctl import threadpool_limits

from autotune.api.models import Model, simulate_model
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import ConfigurationError
from autotune.core.paths import config_directory
from autotune.recordings.recording import Recording
from autotune.service.ownership import owned
from autotune.tuning import run
from autotune.tuning.links import open_link
from autotune.tuning.motion_plan import planned_run
from autotune.tuning.outcome import RunResult
from autotune.tuning.preparation import SessionRequest
from autotune.tuning.recording_run import record_programme

Say: TypeAlias = Callable[[str], None]
SIMULATED = "sim:"


def quiet(sentence: str) -> None:
    """Hears nothing."""


def simulate(
    what: Model, recording: Recording | str | Path | None = None, *, programme: str = "identification"
) -> Recording:
    """A recording of a simulated axis, or of a model.

    Args:
        what: `sim://PRESET?seed=3&effect=spring:0.004`, an axis that plays `programme` (as `autotune record` does);
            or a model, which follows the references of `recording` with its controller.

    Raises:
        ConfigurationError: an unknown preset, effect or programme, or a model without a recording.
        NotEnoughExcitation: the model's loop cannot be simulated on this recording.
    """
    if not (isinstance(what, str) and what.startswith(SIMULATED)):
        if recording is None:
            raise ConfigurationError(
                "simulate(model) needs the recording whose references it follows: simulate(model, recording); "
                "a simulated axis is named by a link, for example 'sim://edm-vertical'"
            )
        return simulate_model(what, recording)
    axis = _simulated(what)
    with TemporaryDirectory() as folder:
        runs = Path(folder)
        request = SessionRequest(axis, lambda: open_link(axis, runs, runs), runs, Told(quiet), datetime.now)
        return record_programme(request, programme, runs / "simulated.parquet")


def tune(
    axis: str | Path,
    *,
    yes: bool = False,
    only: str | None = None,
    runs: str | Path = "runs",
    approve: Callable[[str], bool] | None = None,
    progress: Say = quiet,
) -> RunResult:
    """Tunes an axis: check, experiment, fit, adapt, prove, commit; what it came to is also in its run's folder.

    Whatever happens, the axis ends at rest, without power, with every changed setting restored.

    Args:
        axis: an axis file, or a link `sim://PRESET…` to an axis simulated in this process.
        yes: a real axis may move: it is free, and the emergency stop is within reach.
        only: a single stage; `runs`: folder for what runs leave.
        approve: asked, with a sentence, before anything is written to the drive for good; by default it is.
        progress: hears stages and sentences.

    Raises:
        ConfigurationError: a file that is wrong, a real axis without `yes`, or another program has the axis.
        AutotuneError: whatever ended the run, after everything was restored.
    """
    simulated = isinstance(axis, str) and axis.startswith(SIMULATED)
    folder = Path(runs)
    file = folder / "simulated.toml" if simulated else Path(axis)
    known = _simulated(str(axis)) if simulated else read_axis(file)
    _refuse_unasked(known, yes, only)
    with _held(known, None if simulated else file), threadpool_limits(1):
        return run.tune(
            run.Request(
                axis=known,
                open_loop=lambda: open_link(known, file.resolve().parent, folder),
                runs=folder,
                reporter=Told(progress),
                clock=datetime.now,
                only=only,
                approve=approve or (lambda sentence: True),
            )
        )


@dataclass(frozen=True, slots=True)
class Told:
    """Tells stages and sentences of a run."""

    tell: Say

    def stage(self, name: str, seconds: float) -> None:
        self.tell(f"{name} (about {seconds:.0f} s)")

    def progress(self, fraction: float) -> None:
        """Not told: a caller who wants it reads the run's folder."""

    def say(self, sentence: str) -> None:
        self.tell(sentence)


def _refuse_unasked(axis: Axis, yes: bool, only: str | None) -> None:
    plan = planned_run(axis, only)
    if not yes and plan is not None and not axis.link.startswith(SIMULATED):
        raise ConfigurationError(
            f"axis {axis.name} would move: {plan.sentence(axis)} Nobody is asked here: see that it is free to move "
            "and the emergency stop within reach, then call tune(…, yes=True)"
        )


@contextmanager
def _held(axis: Axis, file: Path | None) -> Iterator[None]:
    """Holds the axis against other programs; one that is simulated in this process is nobody else's."""
    if file is None:
        yield
        return
    with owned(axis, file, "tune"):
        yield


def _simulated(link: str) -> Axis:
    axis = read_axis(config_directory() / "axes" / "simulated.toml")
    return axis.model_copy(update={"link": link})
