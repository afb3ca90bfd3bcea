"""From the link in an axis file to a cyclic loop: one table, one entry a scheme."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.core.loop import LocalLoop, Loop


def _open_simulated(axis: Axis, directory: Path) -> Loop:
    from autotune_sim.inprocess import open_sim

    return LocalLoop(open_sim(axis.link, axis.cycle))


def _open_wire(axis: Axis, directory: Path) -> Loop:
    from autotune_drivers import open_loop

    return open_loop(axis, directory)


def _open_replay(axis: Axis, directory: Path) -> Loop:
    from autotune_drivers.replay import open_replay
    from autotune_drivers.url import parse_link

    return LocalLoop(open_replay(Path(parse_link(axis.link, directory).target)))


OPENERS: dict[str, Callable[[Axis, Path], Loop]] = {
    "sim": _open_simulated,
    "canopen+slcan": _open_wire,
    "canopen+socketcan": _open_wire,
    "moteus+serial": _open_wire,
    "replay": _open_replay,
}


def open_link(axis: Axis, directory: Path) -> Loop:
    """Opens the axis's link; relative paths in it are relative to `directory`, the axis file's folder.

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
    return opener(axis, directory)
