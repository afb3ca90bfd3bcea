"""What tests of the moteus line share: the axis behind it, and its opener."""

from __future__ import annotations

from pathlib import Path

from autotune.core.axis import Axis, read_axis
from autotune.core.paths import config_directory
from autotune_drivers.moteus_open import MoteusOpener
from autotune_drivers.moteus_profile import read_moteus_profile
from autotune_drivers.url import parse_link


def moteus_axis(link: str = "moteus+serial:edm.tty?id=1", **changes: object) -> Axis:
    """The vertical axis behind a moteus line."""
    axis = read_axis(config_directory() / "axes" / "edm-vertical-moteus.toml")
    return axis.model_copy(update={"link": link, **changes})


def moteus_opener(
    directory: Path, link: str = "moteus+serial:edm.tty?id=1", **changes: object
) -> MoteusOpener:
    axis = moteus_axis(link, **changes)
    return MoteusOpener(parse_link(axis.link, directory), axis, read_moteus_profile(axis.profile))
