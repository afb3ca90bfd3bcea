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
def signals_are_heard() -> Iterator[None]:
    """Hangup and interrupt act here and in children, though whoever started the tests may ignore them.

    `nohup` ignores the one, a shell that starts something in the background the other.
    """
    usual = {signal.SIGHUP: signal.SIG_DFL, signal.SIGINT: signal.default_int_handler}
    ignored = [number for number in usual if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, usual[number])
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)
