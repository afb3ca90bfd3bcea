"""What `make install` compiles is all that a whole run needs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from autotune.core.paths import config_directory


@pytest.mark.slow
@pytest.mark.long
def test_a_run_finds_every_kernel_compiled(tmp_path: Path) -> None:
    kernels = tmp_path / "kernels"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(kernels)}
    axis = tmp_path / "axis.toml"
    axis.write_text((config_directory() / "axes" / "simulated.toml").read_text(encoding="utf-8"))

    def call(*arguments: str) -> set[str]:
        done = subprocess.run(
            [sys.executable, "-m", *arguments],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=280, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return {path.name for path in kernels.rglob("*.nbc")}

    compiled = call("autotune.cli.compile_kernels")
    assert len(compiled) > 50
    assert call("autotune.cli.main", "run", str(axis), "--yes", "--runs", str(tmp_path / "runs")) == compiled
