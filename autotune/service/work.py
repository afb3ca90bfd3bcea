"""One job, done: a check, a run, an approved commit, a rollback, a deciding experiment. Used by the worker process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from autotune.control.reduction import reduces
from autotune.core.axis import Axis
from autotune.core.errors import AutotuneError, ConfigurationError, Interrupted
from autotune.core.loop import Loop
from autotune.core.ripple_parameters import is_ripple
from autotune.models.model_file import parse_model
from autotune.monitoring.check import CheckRequest, check_axis
from autotune.monitoring.drift import DriftSettings
from autotune.service.orders import DONE, Done, Order, salvage
from autotune.service.settings import Idle
from autotune.tuning.ending import KeptBut
from autotune.tuning.files import read_json
from autotune.tuning.findings import FILE_NAME as FINDINGS
from autotune.tuning.findings import latest_run
from autotune.tuning.observer import Observer
from autotune.tuning.outcome import Outcome, RunResult
from autotune.tuning.preparation import SessionRequest
from autotune.tuning.progress import Reporter
from autotune.tuning.proof import TrackingError
from autotune.tuning.recording_run import play_programme
from autotune.tuning.rollback import roll_back
from autotune.tuning.run import Request, tune
from autotune.tuning.stage_prove import GIVEN_BACK


class NotIdle(AutotuneError):
    """The machine's input says that it is not idle; the job waits."""

    exit_code = 3


@dataclass(frozen=True)
class Tools:
    """What a job works with."""

    axis: Axis
    open_loop: Callable[[], Loop]
    reporter: Reporter
    clock: Callable[[], datetime]
    observers: Sequence[Observer] = ()


def perform(order: Order, tools: Tools) -> Done:
    """Does the job.

    Raises:
        KeyboardInterrupt, Interrupted: the axis is at rest, everything put back.
    """
    doing = {"check": _check, "run": _run, "commit": _commit, "rollback": _rollback, "decide": _decide}[
        order.kind
    ]
    idle = Idle(**order.options.get("idle", {}))
    open_link = tools.open_loop
    tools = replace(tools, open_loop=lambda: idle_only(open_link(), idle))
    try:
        return doing(order, tools)
    except NotIdle as error:
        return Done("not_idle", error.exit_code, str(error))
    except Interrupted:
        raise
    except KeptBut as error:
        kept = salvage(Path(order.runs), order.axis, order.id)
        return Done("kept", error.exit_code, str(error), kept.run if kept else "")
    except AutotuneError as error:
        outcome = {3: "not_enough", 4: "guard", 5: "fault"}.get(error.exit_code, "refused")
        return Done(outcome, error.exit_code, str(error))
    except OSError as error:
        where = f": {error.filename}" if error.filename else ""
        return Done("refused", 2, f"{error.strerror or error}{where}")


def idle_only(loop: Loop, idle: Idle) -> Loop:
    """The loop, if the machine's input says that it is idle.

    Raises:
        NotIdle: it does not; the link is closed again.
    """
    if idle.by != "input":
        return loop
    try:
        value = int(loop.read_parameters([idle.input])[idle.input])
    except BaseException:
        loop.close()
        raise
    if not value & idle.mask:
        loop.close()
        raise NotIdle(f"the machine is not idle: {idle.input} is {value}, mask {idle.mask}; the job waits")
    return loop


def _check(order: Order, tools: Tools) -> Done:
    settings = DriftSettings(**order.options.get("drift", {}))
    result = check_axis(
        CheckRequest(
            tools.axis,
            tools.open_loop,
            Path(order.runs),
            tools.reporter,
            tools.clock,
            tools.observers,
            settings=settings,
        )
    )
    return Done(DONE, 0, result.verdict.sentence, result.run_directory.name)


def _run(order: Order, tools: Tools) -> Done:
    automatic = bool(order.options.get("automatic", False))
    asked: list[str] = []

    def approve(question: str) -> bool:
        if not automatic:
            asked.append(question)
        return automatic

    given = order.options.get("model")
    result = tune(
        Request(
            tools.axis, tools.open_loop, Path(order.runs), tools.reporter, tools.clock, tools.observers,
            only=order.options.get("only"), gain=order.options.get("gain"), approve=approve,
            model=None if given is None else parse_model(str(given)),
        )
    )  # fmt: skip
    outcome = (
        "guard" if result.guard else result.outcome.value
    )  # a stop by the guard is worth a word in any case
    return Done(outcome, result.exit_code, result.verdict, result.run_directory.name, " ".join(asked))


def _commit(order: Order, tools: Tools) -> Done:
    """Writes what an earlier run has proved, and takes it back if the drive does not show it."""
    runs, proposal = Path(order.runs), str(order.options.get("proposal", ""))
    if latest_run(runs, tools.axis, FINDINGS).name != proposal:
        raise ConfigurationError(
            f"the run {proposal} is not the newest one any more; tune again instead of committing it"
        )
    proved = read_json(runs / proposal / "run.json", "run")
    result = tune(
        Request(
            tools.axis, tools.open_loop, runs, tools.reporter, tools.clock, tools.observers, only="commit"
        )
    )  # fmt: skip
    if result.outcome is not Outcome.KEPT or result.committed is None:
        return Done(result.outcome.value, result.exit_code, result.verdict, result.run_directory.name)
    if _as_proved(proved, result, result.committed, tools.axis.acceptance.improvement):
        return Done("kept", 0, result.verdict, result.run_directory.name)
    backup = roll_back(tools.axis, tools.open_loop, runs, tools.clock())
    sentence = (
        f"Everything was put back (backup {backup.id}): with the parameters in the drive the peak error was "
        f"{1e3 * result.committed.peak_error:.2f} m{tools.axis.motion_unit}, which is not what had been proved."
    )
    return Done("rolled_back", 3, sentence, result.run_directory.name)


def _as_proved(
    proved: Mapping[str, Any], result: RunResult, alone: TrackingError, improvement: float
) -> bool:
    """At least half of the gain is there, with what the host plays where it has its part.

    No gain was proved of ripple alone: the commit has seen that nothing is worse. What a drive without presliding holds
    gives what was only predicted: of that as much is asked as the commit asks, `acceptance.improvement`.
    """
    if result.feedforward and all(map(is_ripple, result.feedforward)):
        return True
    before, after = proved["before"]["peak_error"], proved["after"]["peak_error"]
    held = proved.get("reduction") or {}  # what the drive was to give by itself, where that is less
    if result.with_host is None and held and reduces(held["drive"]):
        return bool(alone.peak_error <= (1.0 - improvement) * before)
    if result.with_host is None:
        after = held.get("predicted_peak_error") or after
    measured = result.with_host or alone
    return bool(measured.peak_error <= before - GIVEN_BACK * (before - after))


def _decide(order: Order, tools: Tools) -> Done:
    """Plays what tells effects apart that a diagnosis leaves in doubt; the recording is in the run's folder."""
    effects = tuple(str(one) for one in order.options.get("effects", ()))
    request = SessionRequest(
        tools.axis, tools.open_loop, Path(order.runs), tools.reporter, tools.clock, tools.observers
    )
    played = play_programme(request, "decide", effects)
    seconds = len(played.recording) * played.recording.period
    asked = f" about {', '.join(effects).replace('_', ' ')}" if effects else ""
    sentence = f"Recorded {seconds:.0f} s{asked}: diagnose again with both recordings."
    return Done(DONE, 0, sentence, played.directory.name)


def _rollback(order: Order, tools: Tools) -> Done:
    backup = roll_back(
        tools.axis, tools.open_loop, Path(order.runs), tools.clock(), order.options.get("to") or None
    )
    return Done("restored", 0, f"The drive holds again what it held on {backup.taken} (backup {backup.id}).")
