"""A simulated moteus controller in a process of its own, shared by the tests of a module."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from autotune_drivers.moteus.drive import MoteusDrive
from tests.drivers.moteus_rig import moteus_opener
from tests.drivers.simulator import Simulator, simulator


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("moteus"), "--link", "moteus", "--node", "1") as process:
        yield process


@pytest.fixture
def running(shared: Simulator) -> Iterator[Simulator]:
    """The shared simulator, without faults afterwards."""
    yield shared
    shared.order("clear")


@pytest.fixture
def drive(running: Simulator) -> Iterator[MoteusDrive]:
    drive = moteus_opener(running.directory)()
    yield drive
    drive.close()
