"""`autotune`: the command line. Arguments in, text and exit codes out; no traceback reaches a user.

Exit codes: 0 done and kept; 2 usage or configuration; 3 done, nothing applied; 4 stopped by the guard;
5 link or drive fault; 130 interrupted, axis at rest.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType

import typer

from autotune import __version__
from autotune.cli.check import check
from autotune.cli.data import data
from autotune.cli.history import history
from autotune.cli.link import link
from autotune.cli.model import model
from autotune.cli.output import complain
from autotune.cli.record import record
from autotune.cli.rollback import rollback
from autotune.cli.run import run
from autotune.cli.serve import serve
from autotune.cli.sim import sim
from autotune.core.errors import AutotuneError

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Tunes servo axes: measures how the axis behaves, compensates it, proves the gain, commits it.",
)
app.command()(run)
app.command()(check)
app.command()(history)
app.command()(link)
app.command()(sim)
app.command()(rollback)
app.command()(record)
app.command()(serve)
app.add_typer(data, name="data")
app.add_typer(model, name="model")


@app.callback(invoke_without_command=True)
def _root(
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    if version:
        typer.echo(f"autotune {__version__}")
        raise typer.Exit


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: ends the process with the exit code of what happened."""
    signal.signal(signal.SIGTERM, _terminate)
    try:
        ended = app(args=list(arguments) if arguments is not None else None, standalone_mode=False)
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
        return complain(f"{message()} (see 'autotune --help')", 2)
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
