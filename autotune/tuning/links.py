"""From the link in an axis file to a cyclic loop: one table, one entry a scheme."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.core.loop import LocalLoop, Loop

SESSIONS = "sessions"
"""Folder below that of all runs: what a session has changed in a drive, a file for each drive."""


def _open_simulated(axis: Axis, directory: Path, keep: Path | None) -> Loop:
    from autotune_sim.inprocess import open_sim

    return LocalLoop(open_sim(axis.link, axis.cycle, directory))


def _open_wire(axis: Axis, directory: Path, keep: Path | None) -> Loop:
    from autotune_drivers import open_loop

    return open_loop(axis, directory, keep=keep)


def _open_replay(axis: Axis, directory: Path, keep: Path | None) -> Loop:
    from autotune.recordings.replay import open_replay
    from autotune_drivers.url import parse_link

    return LocalLoop(open_replay(Path(parse_link(axis.link, directory).target)))


OPENERS: dict[str, Callable[[Axis, Path, Path | None], Loop]] = {
    "sim": _open_simulated,
    "canopen+slcan": _open_wire,
    "canopen+socketcan": _open_wire,
    "moteus+serial": _open_wire,
    "replay": _open_replay,
}


def open_link(axis: Axis, directory: Path, runs: Path | None = None) -> Loop:
    """Opens the axis's link; relative paths in it are relative to `directory`, the axis file's folder.

    With `runs`, the folder of all runs, what the session changes in the drive is written below it first, and
    what a session before it has left changed is put back before anything else.

    Raises:
        ConfigurationError: an unknown scheme. LinkError: nobody answers there.
    """
    scheme, separator, _ = axis.link.partition(":")
    opener = OPENERS.get(scheme)
    if opener is None or not separator:
        near = difflib.get_close_matches(scheme, OPENERS, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ConfigurationError(
            f"link {axis.link!r} of axis {axis.name} has an unknown scheme {scheme!r}; known are "
            f"{', '.join(OPENERS)}{hint}"
        )
    return opener(axis, directory, runs.resolve() / SESSIONS / axis.name if runs is not None else None)
