"""The page about friction over velocity: its entry is one that a profile may have, and that of the simulated drive."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from autotune.core.paths import config_directory
from autotune_drivers.tables import VelocityPoints

PAGE = (Path(__file__).resolve().parents[2] / "docs/friction-in-the-drive.md").read_text(encoding="utf-8")


def test_its_entry_is_that_of_the_simulated_drive_but_for_the_source() -> None:
    (block,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    shown = tomllib.loads(block)["friction_table"]
    profile = config_directory() / "profiles/autotune-sim-table.toml"
    own = tomllib.loads(profile.read_text(encoding="utf-8"))["friction_table"]
    entries = [VelocityPoints.model_validate({**entry, "source": "a page"}) for entry in (shown, own)]
    assert entries[0] == entries[1]
