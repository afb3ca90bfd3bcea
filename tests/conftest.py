"""One thread of linear algebra a process, as in every program of autotune.

Property tests see the same examples in every run; HYPOTHESIS_PROFILE=random looks for new ones.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

from autotune.core.threads import one_thread

one_thread()
settings.register_profile("same", derandomize=True)
settings.register_profile("random", print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Slow ones first: no worker begins one when the others have nothing left."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.fixture
def hangup_is_heard() -> Iterator[None]:
    """SIGHUP acts here and in children, though whoever started the tests may have been told to ignore it (nohup)."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    if ignored:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    if ignored:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
