"""Where the files are that come with the program: axes, profiles, electronic data sheets."""

from __future__ import annotations

import sys
import sysconfig
from pathlib import Path

from autotune.core.errors import ConfigurationError


def config_directory() -> Path:
    """The folder `config`: of the checkout if the program runs from one, else of the installation.

    Raises:
        ConfigurationError: neither is there.
    """
    checkout = Path(__file__).resolve().parents[2]
    installed = Path(sysconfig.get_path("data"), "share", "autotune", "config")
    prefix = Path(sys.prefix, "share", "autotune", "config")
    if (checkout / "pyproject.toml").is_file() and (checkout / "config").is_dir():
        return checkout / "config"
    for candidate in (installed, prefix):
        if candidate.is_dir():
            return candidate
    raise ConfigurationError(
        f"the folder config is neither in {checkout} nor at {installed}; install autotune again"
    )
