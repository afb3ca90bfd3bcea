"""`autotune gains`: what is known of an axis's loop from its last model, its drive, and its recordings.

Today's gains are read from the drive where its profile maps them, else from the recording's file, else identified
from the recording. Nothing moves here; what is written is the business of `gains_apply`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, pi
from pathlib import Path
from typing import Any

from autotune.control.gains.judge import Task, Verdict, judge
from autotune.control.gains.loop import Gains, LoopTiming, cascaded_from, of_controller
from autotune.control.gains.members import Family, family
from autotune.control.gains.propose import Proposal, propose
from autotune.control.gains.recorded import held_set_points
from autotune.control.gains.steps import step_sizes
from autotune.control.gains.words import TODAY, advice, cycle_in_words
from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError, RecordingError
from autotune.estimation.controller import controller_of
from autotune.estimation.controller_law import PositionController
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import read_model
from autotune.recordings.files import read_recording
from autotune.tuning.files import read_json
from autotune.tuning.findings import latest_run
from autotune.tuning.session import controller_of as controller_in_drive

MODEL, EXPERIMENT, RUN = "model.toml", "recordings/experiment.parquet", "run.json"
NAMES = ("kp", "kd", "ki", "derivative_filter")
TOLD_LATE = 0.05
"""Of the cycle: from so much on it is said that the torque is late."""
NAMED = "The gains named"
ASKED = "command line"
CASCADED = 0.05
"""Part of the reference's rate in the derivative: with less the loops are cascaded."""


@dataclass(frozen=True, slots=True)
class Known:
    """What the answer rests on: the model's file, the gains and where they were found.

    By the model's own run `disturbance` is what shakes the axis [N m or N], None where that could not be told, and
    `late` how much later than it is held the torque comes, beside a lag of the model [s].
    """

    model: DriveModel
    source: Path
    gains: Gains
    gains_from: str
    disturbance: float | None = None
    late: float = 0.0


@dataclass(frozen=True, slots=True)
class Judged:
    """The answer; `words` as `advice` in the JSON, and `next_step` where nothing was applied."""

    known: Known
    kin: Family
    task: Task
    current: Verdict
    proposal: Proposal
    words: tuple[str, ...]
    next_step: tuple[str, ...] = ()

    def as_json(self, applied: bool = False, more: tuple[str, ...] = ()) -> dict[str, Any]:
        proposed = self.proposal.verdict
        return {
            "current": self.current.as_json(),
            "proposed": proposed.as_json() if proposed else None,
            "advice": [*self.words, *more],
            "applied": applied,
            "model": str(self.known.source),
            "gains_from": self.known.gains_from,
        }


def known_of(axis: Axis, runs: Path, held: Mapping[str, float] | None, asked: Gains | None = None) -> Known:
    """Model and gains of an axis.

    Args:
        held: the drive's parameters, None where it was not asked.
        asked: gains to judge instead of today's.

    Raises:
        ConfigurationError: no model, the model of another axis, or no way to tell the gains.
    """
    directory = latest_run(runs, axis, MODEL)
    model = read_model(directory / MODEL)
    if model.fingerprint and model.fingerprint != axis.fingerprint:
        raise ConfigurationError(
            f"the model {directory / MODEL} is of an axis with the fingerprint {model.fingerprint}, {axis.name} has "
            f"{axis.fingerprint}: name, unit, profile or mechanics were changed since. Run 'autotune run' again"
        )
    controller = controller_in_drive(held or {})
    disturbance, late = disturbance_of(directory), _of_diagnosis(directory, "torque_late") or 0.0
    if asked is not None:
        return Known(model, directory / MODEL, asked, ASKED, disturbance, late)
    if controller is not None:
        return Known(model, directory / MODEL, of_controller(controller), "drive", disturbance, late)
    found = _recorded(directory, axis)
    return Known(
        model, directory / MODEL, _gains_of(found), f"{found.source} ({directory.name})", disturbance, late
    )


def disturbance_of(directory: Path) -> float | None:
    """What shakes the axis, as the run in `directory` found it [N m or N]; None where it does not say."""
    return _of_diagnosis(directory, "disturbance")


def _of_diagnosis(directory: Path, name: str) -> float | None:
    """A number that is not below 0 of a run's diagnosis; None where there is none."""
    try:
        found = read_json(directory / RUN, "run file").get("diagnosis") or {}
    except ConfigurationError:
        return None
    level = found.get(name)
    return float(level) if isinstance(level, (int, float)) and 0.0 <= level < inf else None


def _recorded(directory: Path, axis: Axis) -> PositionController:
    path = directory / EXPERIMENT
    if not path.is_file():
        raise ConfigurationError(
            f"the profile {axis.profile} does not map the gains of axis {axis.name}, and {path} is not there "
            "to find them "
            "in: name them with --controller, or run 'autotune run' again, which records it"
        )
    found = controller_of(read_recording(path))
    if not found.usable:
        raise ConfigurationError(
            f"the gains of axis {axis.name} are in neither its profile nor its recording: {found.why} Nothing can be "
            "said about gains that nobody knows: name them with --controller, or record motion under position control "
            "with its set points (column reference)"
        )
    return found


def _gains_of(found: PositionController) -> Gains:
    if found.reference_rate < CASCADED and found.kd > 0.0:
        return cascaded_from(found.kp, found.kd, found.ki, found.derivative_filter)
    return Gains(max(found.kp, 0.0), max(found.kd, 0.0), max(found.ki, 0.0), found.derivative_filter)


def _from_in_words(known: Known) -> str:
    where = {
        "drive": "the drive",
        ASKED: "the command line; where today's are meant, leave --controller out",
        "metadata": "the recording of the last run, which names them",
        "trusted": "the recording of the last run, which names them; its data cannot tell",
        "identified": "the recording of the last run: reference and position explain its torque demand with them",
    }
    return f"Gains from {where.get(known.gains_from.split(' (')[0], known.gains_from)}."


def _late(known: Known, axis: Axis) -> tuple[str, ...]:
    if known.late < TOLD_LATE * axis.cycle:
        return ()
    return (
        f"The torque comes {1e3 * known.late:.2g} ms after its demand, by the last run's recordings: that is in all "
        "margins.",
    )


def _unshaken(known: Known) -> tuple[str, ...]:
    if known.disturbance is not None:
        return ()
    return (
        "What shakes this axis is not known: hunting in bursts, with rests of seconds between them, may be missed. Run "
        "'autotune run' again, whose diagnosis finds it.",
    )


def _next_step(axis: Axis, held: Mapping[str, float] | None, proposal: Proposal) -> tuple[str, ...]:
    """What to do with a proposal."""
    verdict = proposal.verdict
    if verdict is None:
        return ()
    if held is not None and controller_in_drive(held) is None:
        return (
            f"The profile {axis.profile} maps no gains: enter them by hand, in the drive's own units, and run "
            "'autotune run' again.",
        )
    if verdict.gains.structure == "pid" and verdict.gains.notch is None:
        return (
            "Nothing is written yet: with --apply the proposal is proved on the axis, and kept if it is better.",
        )
    return ("Nothing is written: only PID gains without a notch can be, by --apply. Enter these by hand.",)


def seen_in_words(directory: Path, axis: Axis) -> str:
    """What the run's recording shows at held set points."""
    try:
        seen = held_set_points(read_recording(directory / EXPERIMENT), axis.position_resolution)
    except (RecordingError, OSError) as error:
        return f"Whether the axis hunted in the last run is not seen: {error}."
    if seen.cycle is None:
        return f"In the last run's recording the axis held its set points ({seen.seconds:.1f} s of them)."
    sentence = cycle_in_words(seen.cycle, axis.motion_unit)
    return f"In the last run's recording the axis hunted at its set points, {sentence}."


def timing_of(
    axis: Axis, held: Mapping[str, float] | None, dead_time: float = 0.0, disturbance: float | None = None
) -> LoopTiming:
    """Cycle, encoder, torque limit (the lesser of drive and file), reference filter and what shakes the axis."""
    limit = min(axis.limits.torque, (held or {}).get("limit.torque") or axis.limits.torque)
    return LoopTiming(
        axis.cycle,
        axis.position_resolution,
        limit,
        dead_time,
        0.1 * dead_time,
        axis.reference.filter,
        disturbance or 0.0,
    )


def task_of(axis: Axis, model: DriveModel, timing: LoopTiming) -> Task:
    """The benchmark's amplitude as the large step, its peak speed as the fastest slow motion."""
    benchmark = axis.benchmark
    return Task(
        step_sizes(model, timing, benchmark.amplitude), 2.0 * pi * benchmark.frequency * benchmark.amplitude
    )


def judge_axis(
    axis: Axis,
    runs: Path,
    held: Mapping[str, float] | None,
    bandwidth: float | None = None,
    dead_time: float = 0.0,
    asked: Gains | None = None,
) -> Judged:
    """Judges today's gains, or those `asked` about, and proposes better ones; some seconds of work, nothing moves.

    Raises:
        ConfigurationError: as `known_of`, or a bandwidth that cannot be.
    """
    known = known_of(axis, runs, held, asked)
    timing = timing_of(axis, held, dead_time + known.late, known.disturbance)
    kin, task = family(known.model, timing), task_of(axis, known.model, timing)
    proposal = propose(kin, task, known.gains, bandwidth)
    current = judge(known.gains, kin, task)
    words = (
        _from_in_words(known),
        *advice(kin, current, proposal, axis.motion_unit, NAMED if asked else TODAY),
        *_late(known, axis),
        *_unshaken(known),
        seen_in_words(known.source.parent, axis),
    )
    return Judged(known, kin, task, current, proposal, words, _next_step(axis, held, proposal))
