"""What tests of the moteus line share: the axis behind it, its opener, and a console beside the drive."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from autotune.core.axis import Axis, read_axis
from autotune.core.drive import HOLD
from autotune.core.paths import config_directory
from autotune_drivers.moteus.console import Console
from autotune_drivers.moteus.drive import MoteusDrive
from autotune_drivers.moteus.node import MoteusNode
from autotune_drivers.moteus.opening import MoteusOpener
from autotune_drivers.moteus.port import open_port
from autotune_drivers.moteus.profile import MoteusCycle, MoteusGuard, MoteusProfile, read_moteus_profile
from autotune_drivers.url import parse_link

LINK = "moteus+serial:edm.tty?id=1"


def moteus_axis(link: str = LINK, **changes: object) -> Axis:
    """The vertical axis behind a moteus line."""
    axis = read_axis(config_directory() / "axes" / "edm-vertical-moteus.toml")
    return axis.model_copy(update={"link": link, **changes})


def moteus_opener(
    directory: Path, link: str = LINK, watchdog: float = 1.0, **changes: object
) -> MoteusOpener:
    axis = moteus_axis(link, **changes)
    profile = patient(read_moteus_profile(axis.profile), watchdog)
    return MoteusOpener(parse_link(axis.link, directory), axis, profile)


def patient(profile: MoteusProfile, watchdog: float = 1.0) -> MoteusProfile:
    """With times [s] longer than a run's, so that a loaded test machine does not trip them."""
    guard = MoteusGuard.model_construct(watchdog=watchdog)
    return profile.model_copy(update={"guard": guard, "cycle": MoteusCycle(reply_timeout=0.5)})


def console(directory: Path) -> Iterator[Console]:
    port = open_port(directory / "edm.tty", 921600)
    try:
        node = MoteusNode(port, 1)
        node.greet()
        yield Console(node)
    finally:
        port.close()


def hold(drive: MoteusDrive, cycles: int) -> None:
    for _ in range(cycles):
        drive.step(HOLD)


def settings(directory: Path) -> dict[str, str]:
    (found,) = (dict(console.enumerate()) for console in console(directory))
    return found
