"""The folder `config`, in a checkout and installed."""

from __future__ import annotations

import sys
import sysconfig
from pathlib import Path

import pytest

from autotune.core import paths
from autotune.core.errors import ConfigurationError


def test_in_a_checkout() -> None:
    assert (paths.config_directory() / "eds" / "autotune-sim.eds").is_file()


def test_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    installed = tmp_path / "share" / "autotune" / "config"
    monkeypatch.setattr(paths, "__file__", str(tmp_path / "site" / "autotune" / "core" / "paths.py"))
    monkeypatch.setattr(sysconfig, "get_path", lambda name: str(tmp_path))
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "elsewhere"))
    with pytest.raises(ConfigurationError, match="install autotune again"):
        paths.config_directory()
    installed.mkdir(parents=True)
    assert paths.config_directory() == installed
