"""A recording that is short and can be fitted."""

from __future__ import annotations

import pytest

import autotune
from autotune.recordings.recording import Recording


@pytest.fixture(scope="session")
def short() -> Recording:
    return autotune.simulate("sim://lugre?seed=1", programme="high-speed")
