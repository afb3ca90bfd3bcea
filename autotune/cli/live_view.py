"""`--view`: the live view beside a command, whether it has the axis itself or a service does the job."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from autotune.cli.output import say
from autotune.core.axis import Axis

if TYPE_CHECKING:
    from autotune.cli.owned import Service
    from autotune.tuning.observer import Observer
    from autotune.view.live import LiveView

View = Annotated[bool, typer.Option("--view", help="Show live traces in the Rerun viewer.")]


@contextmanager
def live_view(axis: Axis) -> Iterator[LiveView]:
    """A live view of an axis, its address told; whatever happens to it, the command goes on.

    Raises:
        ConfigurationError: there is no viewer, or it does not start; nothing has moved yet.
    """
    from autotune.tuning.shown_pages import limits_shown
    from autotune.view.live import LiveSettings, LiveView

    settings = LiveSettings(axis.motion_unit, axis.cycle, f"Axis {axis.name}", limits_shown(axis))
    with LiveView(settings) as live:
        say(f"live view: {live.address or live.url}")
        yield live
        if live.dropped:
            say(f"the viewer was too slow for {live.dropped} samples; the recording has them all")
        if restarts := int(live.status.get("restarts", 0)):
            say(f"the viewer's server hung and was replaced ({restarts} times); nothing waited for it")


@contextmanager
def following(service: Service, wanted: bool) -> Iterator[None]:
    """A live view of what a service does on an axis, where it is asked for."""
    if not wanted:
        yield
        return
    from autotune.service.live_client import Following

    with live_view(service.axis) as live, Following(service.client, service.axis.name, live):
        yield


@contextmanager
def looking_on(axis: Axis, wanted: bool) -> Iterator[Sequence[Observer]]:
    """Who looks on while a command moves the axis: the live view where it is asked for."""
    if not wanted:
        yield ()
        return
    with live_view(axis) as live:
        yield (live,)
