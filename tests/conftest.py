"""One thread of linear algebra a process, as in every program of autotune.

Property tests see the same examples in every run; HYPOTHESIS_PROFILE=random looks for new ones. None is held to a time
of the wall clock: a loaded host would break it.

Half of the time of the tests that write journals went into waiting for the disk, and a seventh of all processor time
into looking for garbage among modules that stay: no test cuts the power of the host, so that nothing is gained by the
first, and what was imported before the tests is left out of the second.
"""

from __future__ import annotations

import gc
import os
import signal
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from autotune.core.garbage import seldom_collected
from autotune.core.threads import one_thread

one_thread()
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("random", print_blob=True, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


gc.disable()  # until all is imported


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """What was loaded until now stays; this is called in the workers and in the process that hands out the tests."""
    gc.freeze()
    seldom_collected()
    gc.enable()


@pytest.fixture(autouse=True, scope="session")
def without_waiting_for_the_disk() -> Iterator[None]:
    """Programs that a test starts do wait for it; a test of the order of what reaches the disk puts its own here."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "fsync", lambda descriptor: None)
        yield


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Folders, and modules in them, by their slowest tests: no worker begins one when the others have nothing left.

    A folder's stay together, and a module's: what they share is made once, as long as one worker has them.
    """
    longest: defaultdict[Path, float] = defaultdict(float)
    for item in items:
        for marker in item.iter_markers("slow"):
            for place in (item.path, item.path.parent):
                longest[place] = max(longest[place], *(marker.args or (1.0,)))

    def place(item: pytest.Item) -> tuple[float, Path, float, Path]:
        folder = item.path.parent
        return -longest[folder], folder, -longest[item.path], item.path

    items.sort(key=place)


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
