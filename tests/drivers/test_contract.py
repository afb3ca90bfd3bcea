"""The contract suite over every link."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from autotune.core.drive import Drive
from autotune_drivers.canopen_open import CanopenOpener
from autotune_drivers.profile import read_profile
from autotune_drivers.url import parse_link
from autotune_sim.inprocess import open_sim
from tests.drivers.contract import Contract
from tests.drivers.moteus_rig import moteus_opener
from tests.drivers.simulator import Simulator, axis_of, simulator


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("slcan")) as process:
        yield process


class TestInProcess(Contract):
    """sim:// — no wire at all."""

    @pytest.fixture
    def drive(self) -> Iterator[Drive]:
        drive = open_sim("sim://edm-vertical")
        yield drive
        drive.close()


class TestSlcan(Contract):
    """The simulated drive behind an slcan adapter on a pseudo-terminal, in lock-step."""

    @pytest.fixture
    def drive(self, running: Simulator) -> Iterator[Drive]:
        yield from opened(running.directory)


@pytest.fixture(scope="module")
def moteus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("moteus"), "--link", "moteus", "--node", "1") as process:
        yield process


class TestMoteus(Contract):
    """The simulated drive as a moteus controller on its serial line, in lock-step."""

    @pytest.fixture
    def drive(self, moteus: Simulator) -> Iterator[Drive]:
        drive = moteus_opener(moteus.directory)()
        yield drive
        drive.close()


def opened(directory: Path) -> Iterator[Drive]:
    axis = axis_of()
    opener = CanopenOpener(parse_link(axis.link, directory), axis, read_profile(axis.profile))
    drive = opener()
    yield drive
    drive.close()
