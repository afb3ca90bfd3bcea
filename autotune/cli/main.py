"""`autotune`: the command line. Arguments in, text and exit codes out; no traceback reaches a user.

Exit codes: 0 done and kept; 2 usage or configuration; 3 done, nothing applied; 4 stopped by the guard;
5 link or drive fault; 130 interrupted, axis at rest.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from types import FrameType

import typer

from autotune import __version__
from autotune.cli.output import complain
from autotune.core.errors import AutotuneError

COMMANDS = ("run", "check", "history", "link", "sim", "rollback", "record", "serve", "data", "model")
"""Each is the object of that name in the module of that name here."""


def application(arguments: Sequence[str]) -> typer.Typer:
    """The commands. Where the first argument names one, only that is loaded: a restarted service answers early."""
    app = typer.Typer(
        add_completion=False,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        help="Tunes servo axes: measures how the axis behaves, compensates it, proves the gain, commits it.",
    )
    app.callback(invoke_without_command=True)(_root)
    for name in arguments[:1] if arguments and arguments[0] in COMMANDS else COMMANDS:
        command = getattr(import_module(f"autotune.cli.{name}"), name)
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        else:
            app.command()(command)
    return app


def _root(
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    if version:
        typer.echo(f"autotune {__version__}")
        raise typer.Exit


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: ends the process with the exit code of what happened."""
    signal.signal(signal.SIGTERM, _terminate)
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        ended = application(given)(args=given, standalone_mode=False)
        code = ended if isinstance(ended, int) else 0  # typer.Exit comes as its code
    except typer.Exit as ending:
        code = ending.exit_code
    except typer.Abort:
        code = complain("interrupted", 130)
    except KeyboardInterrupt:
        code = complain("interrupted; the axis is at rest and without power", 130)
    except AutotuneError as error:
        code = complain(str(error), error.exit_code)
    except OSError as error:
        code = complain(f"{error.strerror or error}: {error.filename or 'no file named'}", 2)
    except Exception as error:  # noqa: BLE001 - the last line of defence: a sentence instead of a traceback
        code = _unexpected(error)
    sys.exit(code)


def _unexpected(error: Exception) -> int:
    """Usage errors of the parser answer 2; anything else is a defect and says where to look."""
    message = getattr(error, "format_message", None)
    if callable(message):
        return complain(f"{message() or 'no command given'} (see 'autotune --help')", 2)
    if os.environ.get("AUTOTUNE_TRACEBACK"):
        raise error
    return complain(
        f"unexpected {type(error).__name__}: {error}. This is a defect of autotune; run again with the "
        "environment variable AUTOTUNE_TRACEBACK=1 and report what it prints",
        2,
    )


def _terminate(number: int, frame: FrameType | None) -> None:
    """A polite kill is an interruption: everything is put back before the process ends."""
    raise KeyboardInterrupt


if __name__ == "__main__":
    main()
