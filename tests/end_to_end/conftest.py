"""The bench as a fixture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.end_to_end.support import EXAMPLE, Bench


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    axis = tmp_path / "edm-vertical.toml"
    axis.write_text(EXAMPLE.read_text())
    made = Bench(tmp_path, axis)
    try:
        yield made
    finally:
        made.stop()
