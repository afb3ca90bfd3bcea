"""`autotune`: the command line. Arguments in, text and exit codes out; no traceback reaches a user.

Exit codes: 0 done and kept; 2 usage or configuration; 3 done, nothing in the drive; 4 stopped by the guard;
5 link or drive fault; 130 interrupted (the message says what the drive confirms of its power).
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from itertools import zip_longest
from types import FrameType

import typer

from autotune import __version__
from autotune.cli.output import complain
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.core.garbage import seldom_collected
from autotune.core.memory import large_arrays_kept
from autotune.core.side_by_side import use_free_cores
from autotune.core.threads import one_thread

NEWEST = "newest"
COMMANDS = {
    "init": "Find the drive, read what it says of itself, and write an axis file; nothing moves or is written to it.",
    "run": "Tune an axis: check, experiment, fit, adapt, prove, commit.",
    "check": "Look at an axis for a minute at most: friction, tracking, temperature, and whether it has drifted.",
    "history": "Show parameters over time, temperature beside friction, and events.",
    "link": "Measure the link: round trip, jitter, lost cycles, bus load, torque semantics; the axis holds still.",
    "sim": "Simulate the axis's drive in a process of its own, until Ctrl-C.",
    "rollback": "Restore the drive's parameters from a backup, and store them.",
    "record": "Play a programme on the axis and write the recording.",
    "play": "Play the proved feedforward as torque offset beside the machine's own master, until stopped.",
    "serve": "Look after axes: a gentle check every day, a re-tune when one has drifted, an HTTP API.",
    "gains": "Judge today's gains by the last model, and propose better ones; nothing moves without --apply.",
    "catalogue": "Compare control structures on the twin of the axis; nothing moves without --ceiling.",
    "data": "Recordings that others made.",
    "workbench": "Look at models and recordings in the browser: compare, diagnose, add effects, save.",
    "view": "Show live traces of an axis that a service looks after, or what a run left.",
    "export": "Write a model as C, a LinuxCNC component, an FMU, structured text, or tables.",
    "model": "Drive models: fit, compare, diagnose, add effects, show.",
    "completion": "Print what makes Tab complete commands, options, files and effects: for bash, zsh or fish.",
    "tribology": "Tell what a contact of this surface, material and load should show: stiffness at rest, break-away.",
}
"""Each is the object of that name in the module of that name here, loaded when it is called; the line is its help's."""


def application(arguments: Sequence[str]) -> typer.Typer:
    """The commands: the one that the first argument names; where it names none, a line about each."""
    app = typer.Typer(
        add_completion=False,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        help="Tunes servo axes: measures how the axis behaves, compensates it, proves the gain, commits it.",
    )
    app.callback(invoke_without_command=True)(_root)
    called = arguments[0] if arguments else ""
    if called in COMMANDS:
        _load(app, called)
    else:
        if called and not called.startswith("-"):
            _not_of_a_group(called)
        for name, line in COMMANDS.items():
            app.command(name, help=line)(_not_first)
    return app


def _not_of_a_group(called: str) -> None:
    """A group's command without its group, such as `autotune diagnose`, is answered with the whole name."""
    for group in ("model", "data"):
        app: typer.Typer = getattr(import_module(f"autotune.cli.{group}"), group)
        if called in {one.name or getattr(one.callback, "__name__", "") for one in app.registered_commands}:
            raise ConfigurationError(
                f"{called!r} is a command of the group {group!r}: autotune {group} {called} …; "
                f"see 'autotune {group} {called} --help'"
            )


def _load(app: typer.Typer, name: str) -> None:
    command = getattr(import_module(f"autotune.cli.{name}"), name)
    if isinstance(command, typer.Typer):
        app.add_typer(command, name=name)
    else:
        app.command()(command)


def _not_first() -> None:
    raise ConfigurationError(
        f"the command comes first: autotune {'|'.join(COMMANDS)} …; see 'autotune --help'"
    )


def with_values(arguments: Sequence[str]) -> list[str]:
    """`--resume` without a run means the newest: the parser has no options whose value may be left out."""
    given: list[str] = []
    for one, after in zip_longest(arguments, arguments[1:], fillvalue="-"):
        given.append(one)
        if one == "--resume" and after.startswith("-"):
            given.append(NEWEST)
    return given


def _root(
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    if version:
        typer.echo(f"autotune {__version__}")
        raise typer.Exit


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: ends the process with the exit code of what happened."""
    one_thread()
    if arguments is None:
        seldom_collected()
        if sys.argv[1:2] == ["model"]:  # fits and diagnoses; a server gives memory back
            large_arrays_kept()
            use_free_cores()
    os.environ.setdefault(
        "PYTHONSAFEPATH", "1"
    )  # no process of ours takes a module from the working directory
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup wants that a closed terminal ends nothing
            signal.signal(number, _terminate)
    if arguments is None and not os.environ.get("AUTOTUNE_TRACEBACK"):
        warnings.simplefilter("ignore")  # of libraries, with paths of their sources: nothing for a person
    given = with_values(list(sys.argv[1:] if arguments is None else arguments))
    try:
        ended = application(given)(args=given, prog_name="autotune", standalone_mode=False)
        code = ended if isinstance(ended, int) else 0  # typer.Exit comes as its code
    except typer.Exit as ending:
        code = ending.exit_code
    except typer.Abort:
        code = complain("interrupted", 130)
    except KeyboardInterrupt:
        code = complain("interrupted", 130)  # nothing was under way that would say more
    except AutotuneError as error:
        also = getattr(
            error, "__notes__", []
        )  # what went wrong while power was taken off and settings put back
        code = complain("; ".join([str(error), *also]), error.exit_code)
    except OSError as error:
        code = complain(f"{error.strerror or error}: {error.filename or 'no file named'}", 2)
    except Exception as error:  # noqa: BLE001 - the last line of defence: a sentence instead of a traceback
        code = _unexpected(error)
    sys.exit(code)


def _unexpected(error: Exception) -> int:
    """Usage errors of the parser answer 2; anything else is a defect and says where to look."""
    message = getattr(error, "format_message", None)
    if callable(message):
        path = getattr(getattr(error, "ctx", None), "command_path", "autotune")
        return complain(f"{message() or 'no command given'} (see '{path} --help')", 2)
    if os.environ.get("AUTOTUNE_TRACEBACK"):
        raise error
    return complain(
        f"unexpected {type(error).__name__}: {error}. This is a defect of autotune; run again with the "
        "environment variable AUTOTUNE_TRACEBACK=1 and report what it prints",
        2,
    )


def _terminate(number: int, frame: FrameType | None) -> None:
    """A polite kill, or a terminal that closes, is an interruption: everything is put back before the end."""
    raise KeyboardInterrupt


if __name__ == "__main__":
    main()
