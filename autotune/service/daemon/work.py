"""One job, done: a check, a run, an approved commit or a rollback. Used by the worker process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from autotune.core.axis import Axis
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.core.loop import Loop
from autotune.service.check import CheckRequest, check_axis
from autotune.service.committed import run_results
from autotune.service.daemon.settings import Idle
from autotune.service.drift import DriftSettings
from autotune.service.files import read_json, write_json
from autotune.service.findings import FILE_NAME as FINDINGS
from autotune.service.findings import latest_run
from autotune.service.journal import CommitPhase, Journal
from autotune.service.outcome import Outcome
from autotune.service.progress import Reporter
from autotune.service.rollback import roll_back
from autotune.service.stage_prove import GIVEN_BACK
from autotune.service.tuning import Request, tune

KINDS = ("check", "run", "commit", "rollback")
DONE = "done"


class NotIdle(AutotuneError):
    """The machine's input says that it is not idle; the job waits."""

    exit_code = 3


@dataclass(frozen=True, slots=True)
class Order:
    """A job as the worker gets it. `options`: `only`, `to`, `proposal`, `automatic`, `drift`, `idle`."""

    id: str
    axis: str
    kind: str
    file: str
    runs: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        return asdict(self) | {"options": dict(self.options)}


@dataclass(frozen=True, slots=True)
class Done:
    """How a job ended. `run`: name of the folder that it left."""

    outcome: str
    exit_code: int
    sentence: str
    run: str = ""

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class Tools:
    """What a job works with."""

    axis: Axis
    open_loop: Callable[[], Loop]
    reporter: Reporter
    clock: Callable[[], datetime]


def perform(order: Order, tools: Tools) -> Done:
    """Does the job.

    Raises:
        KeyboardInterrupt: the axis is at rest, everything put back.
    """
    doing = {"check": _check, "run": _run, "commit": _commit, "rollback": _rollback}[order.kind]
    idle = Idle(**order.options.get("idle", {}))
    open_link = tools.open_loop
    tools = replace(tools, open_loop=lambda: idle_only(open_link(), idle))
    try:
        return doing(order, tools)
    except NotIdle as error:
        return Done("not_idle", error.exit_code, str(error))
    except AutotuneError as error:
        outcome = {3: "not_enough", 4: "guard", 5: "fault"}.get(error.exit_code, "refused")
        return Done(outcome, error.exit_code, str(error))
    except OSError as error:
        return Done("refused", 2, f"{error.strerror or error}: {error.filename or 'no file named'}")


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
            tools.axis, tools.open_loop, Path(order.runs), tools.reporter, tools.clock, settings=settings
        )
    )
    return Done(DONE, 0, result.verdict.sentence, result.run_directory.name)


def _run(order: Order, tools: Tools) -> Done:
    automatic = bool(order.options.get("automatic", True))
    result = tune(
        Request(
            tools.axis, tools.open_loop, Path(order.runs), tools.reporter, tools.clock,
            only=order.options.get("only"), approve=lambda sentence: automatic,
        )
    )  # fmt: skip
    return Done(result.outcome.value, result.exit_code, result.verdict, result.run_directory.name)


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
            tools.axis, tools.open_loop, runs, tools.reporter, tools.clock, only="commit"
        )
    )  # fmt: skip
    if result.outcome is not Outcome.KEPT or result.committed is None:
        return Done(result.outcome.value, result.exit_code, result.verdict, result.run_directory.name)
    before, after = proved["before"]["peak_error"], proved["after"]["peak_error"]
    if result.committed.peak_error <= before - GIVEN_BACK * (before - after):
        return Done("kept", 0, result.verdict, result.run_directory.name)
    backup = roll_back(tools.axis, tools.open_loop, runs, tools.clock())
    sentence = (
        f"Everything was put back (backup {backup.id}): with the parameters in the drive the peak error was "
        f"{1e3 * result.committed.peak_error:.2f} m{tools.axis.motion_unit}, which is not what had been proved."
    )
    return Done("rolled_back", 3, sentence, result.run_directory.name)


def _rollback(order: Order, tools: Tools) -> Done:
    backup = roll_back(
        tools.axis, tools.open_loop, Path(order.runs), tools.clock(), order.options.get("to") or None
    )
    return Done("restored", 0, f"The drive holds again what it held on {backup.taken} (backup {backup.id}).")


# What is on disk of a job, so that a killed service knows how far it came


def result_file(runs: Path, identifier: str) -> Path:
    """Where the worker writes how the job ended."""
    return runs / ".service" / "jobs" / f"{identifier}.json"


def write_begun(order: Order, process: int, now: datetime) -> None:
    """Notes, before anything is done, which process works on the job."""
    path = result_file(Path(order.runs), order.id).with_suffix(".begun.json")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, {"process": process, "at": now.isoformat(timespec="seconds")})


def write_done(order: Order, done: Done) -> None:
    """Writes how the job ended, before anybody is told."""
    path = result_file(Path(order.runs), order.id)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, {"job": order.as_json(), **done.as_json()})


def read_done(runs: Path, identifier: str) -> Done | None:
    """How the job ended, if its worker came that far."""
    try:
        content = read_json(result_file(runs, identifier), "job")
        return Done(content["outcome"], content["exit_code"], content["sentence"], content["run"])
    except (ConfigurationError, KeyError):
        return None


def salvage(runs: Path, axis: str, identifier: str) -> Done | None:
    """A run whose worker died after the drive had kept the parameters: it counts, and is completed on disk."""
    try:
        begun = read_json(result_file(runs, identifier).with_suffix(".begun.json"), "job")
    except ConfigurationError:
        return None
    for directory, content in run_results(runs, axis, "journal.json"):
        if content.get("process") != begun.get("process") or content.get("started", "") < begun["at"]:
            continue
        return _salvaged(directory, Journal.load(directory))
    return None


def _salvaged(directory: Path, journal: Journal) -> Done | None:
    state = journal.state
    if (directory / "check.json").is_file():
        content = read_json(directory / "check.json", "check")
        return Done(DONE, 0, content["verdict"], directory.name)
    if state.phase is not CommitPhase.KEPT:
        return None
    sentence = (
        "Kept: the drive holds the proved parameters; the run was cut off before its report was written."
    )
    if not (directory / "run.json").is_file():
        proposed = read_json(directory / FINDINGS, "findings file").get("proposed") or {}
        content = {
            "schema": 1, "outcome": "kept", "verdict": sentence, "axis": state.axis, "fingerprint": state.fingerprint,
            "started": state.started, "machine_seconds": 0.0, "run_directory": str(directory),
            "before": None, "after": None, "committed": None, "parameters": {},
            "feedforward": {f"feedforward.{name}": value for name, value in proposed.items()},
        }  # fmt: skip
        write_json(directory / "run.json", content)
    if not state.changed:
        journal.note(outcome="kept")
    return Done("kept", 0, sentence, directory.name)
