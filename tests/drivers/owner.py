"""A process that owns a cyclic loop and plays for ever; tests kill it."""

from __future__ import annotations

import sys
from pathlib import Path

from autotune_drivers import open_loop
from tests.drivers.routines import Endless
from tests.drivers.simulator import axis_of


def main(directory: Path, keep: Path | None = None) -> None:
    loop = open_loop(axis_of(), directory, keep=keep)
    sys.stdout.write("open\n")
    sys.stdout.flush()
    loop.play(Endless(directory / "witness"))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
