"""Taking up an interrupted run from its last whole stage: what was measured counts, if nothing has changed since.

What only computes (fit, diagnosis) is done again from the recordings. The proof is always measured anew: what is
committed is proved in the same run, minutes before.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from autotune.control.adaptation import AdaptationResult
from autotune.control.feedforward import LugreParameters
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.models.model_file import read_model
from autotune.recordings.files import read_recording
from autotune.tuning.files import read_json
from autotune.tuning.findings import FILE_NAME, HOST_FILE, made_with
from autotune.tuning.journal import Journal
from autotune.tuning.outcome import Outcome
from autotune.tuning.proof import TrackingError
from autotune.tuning.request import STAGES
from autotune.tuning.results import run_folders
from autotune.tuning.run_state import RunState
from autotune.tuning.session import Session
from autotune.tuning.stage_adapt import Adapted, RefinementStep, period_average

OLD_SECONDS, OLDEST_SECONDS = 3600.0, 24 * 3600.0
"""From when on the age is told, and refused: friction follows the temperature within hours."""
NEWEST = "newest"
COMPUTED = ("check", "fit", "diagnose")
"""Stages that are done again from what was measured; `diagnose` plays its trajectory only where there is none."""
TAKEN_UP = ("experiment", "adapt")
"""Stages whose measurements are taken over."""


def stages_left(last: str) -> tuple[str, ...]:
    """What is left to be done after the last whole stage."""
    return tuple(stage for stage in STAGES if stage in COMPUTED or STAGES.index(stage) > STAGES.index(last))


def last_whole(directory: Path) -> str:
    """The last stage of a run that another one can take up; "" for none."""
    try:
        whole = read_json(directory / FILE_NAME, "findings file").get("whole", [])
    except ConfigurationError:
        return ""
    return next((stage for stage in reversed(TAKEN_UP) if stage in whole), "")


def take_up(session: Session, state: RunState, name: str) -> str:
    """Copies what an earlier run has measured, and fills the state with what it found.

    Args:
        name: of the run's folder, or "newest".

    Returns:
        its last whole stage.

    Raises:
        ConfigurationError: no such run, nothing whole in it, too old, or made with another drive or axis file.
    """
    directory = _directory(session, name)
    last = last_whole(directory)
    content = read_json(directory / FILE_NAME, "findings file")
    try:
        state.notes.append(_comparable(session, directory, content.get("made_with") or {}))
        _copy(session, directory)
        _fill(session, state, content, last)
    except (KeyError, TypeError, ValueError, OSError) as error:
        if isinstance(error, AutotuneError):
            raise
        raise ConfigurationError(
            f"run {directory.name} cannot be taken up: {FILE_NAME} is damaged ({error}); run all stages again"
        ) from error
    state.whole = [stage for stage in STAGES if STAGES.index(stage) <= STAGES.index(last)]
    return last


def _directory(session: Session, name: str) -> Path:
    """The folder of the run asked for; without a name the newest that was cut off."""
    others = [path for path in run_folders(session.runs, session.axis.name) if path != session.directory]
    if name != NEWEST:
        wanted = Path(name).name
        found = next((path for path in others if path.name == wanted), None)
        if found is None:
            there = ", ".join(path.name for path in others[:3]) or "none"
            raise ConfigurationError(
                f"there is no run {wanted} of axis {session.axis.name}; newest are: {there}"
            )
    else:
        found = next((path for path in others if _cut_off(path)), None)
    if found is None or not last_whole(found):
        raise ConfigurationError(
            f"{'no run of axis ' + session.axis.name if found is None else 'run ' + found.name} can be taken up: none "
            "of its measuring stages was done to the end; run 'autotune run' without --resume"
        )
    return found


def _cut_off(directory: Path) -> bool:
    """Ended neither well nor with a refusal, and with something whole in it."""
    try:
        outcome = Journal.load(directory).state.outcome
    except (ConfigurationError, KeyError, TypeError, ValueError):
        return False
    return outcome in ("", Outcome.ABORTED.value) and bool(last_whole(directory))


def _comparable(session: Session, directory: Path, made: Mapping[str, Any]) -> str:
    """A sentence on what is taken up.

    Raises:
        ConfigurationError: it was made with something else, or too long ago; says what.
    """
    now = made_with(session)
    other = [name for name in now if name != "at" and made.get(name) != now[name]]
    if other:
        raise ConfigurationError(
            f"run {directory.name} was made with another {' and another '.join(other)} than there is now; what it "
            "measured does not count any more. Run all stages again"
        )
    begun, today = datetime.fromisoformat(str(made["at"])), session.clock()
    age = (today.replace(tzinfo=None) - begun.replace(tzinfo=None)).total_seconds()
    if not 0.0 <= age <= OLDEST_SECONDS:
        raise ConfigurationError(
            f"run {directory.name} began {age / 3600.0:.1f} h ago; at most {OLDEST_SECONDS / 3600.0:.0f} h are "
            "allowed, because friction follows temperature and load. Run all stages again"
        )
    old = (
        f" That is {age / 3600.0:.1f} h ago: friction may have moved with the temperature."
        if age > OLD_SECONDS
        else ""
    )
    return f"Taken up from run {directory.name} after its stage '{last_whole(directory)}'.{old}"


def _copy(session: Session, directory: Path) -> None:
    """The new run's folder says everything by itself."""
    for path in sorted((directory / "recordings").glob("*.parquet")):
        if path.stem in ("baseline", "experiment", "confirmation", "decision") or path.stem.startswith(
            "refinement-"
        ):
            session.written[path.stem] = Path(
                shutil.copy2(path, session.directory / "recordings" / path.name)
            )
    if (directory / HOST_FILE).is_file():
        shutil.copy2(directory / HOST_FILE, session.directory / HOST_FILE)


def _fill(session: Session, state: RunState, content: Mapping[str, Any], last: str) -> None:
    findings = state.findings
    if "baseline" in content:
        findings.baseline = TrackingError(**content["baseline"])
    if last != "adapt":
        return
    findings.proposed = LugreParameters(**content["proposed"])
    findings.adapted = _adapted(session, content["adapted"])
    if content.get("law") == "model":
        findings.proposed_model = read_model(session.directory / HOST_FILE)


def _adapted(session: Session, content: Mapping[str, Any]) -> Adapted:
    """Refinement from its recordings; of the laws the state of the parameters is not kept."""
    laws = dict(content["laws"])
    parameters = LugreParameters(**laws.pop("parameters"))
    empty = np.zeros(0)
    result = AdaptationResult(
        parameters=parameters, **laws, time=empty, history=np.zeros((0, 3)), feedback_rms=empty
    )
    steps = []
    for number, values in enumerate(content["steps"]):
        window = read_recording(session.written[f"refinement-{number}"]).select("refinement")
        measured = period_average(window, session.axis.benchmark.frequency)
        steps.append(RefinementStep(LugreParameters(**values), measured, window))
    return Adapted(result, tuple(steps))
