"""The contract suite over every link."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from autotune.core.drive import HOLD, Drive
from autotune.core.recording import Metadata, Recording
from autotune.service.session import controller_of
from autotune_drivers.canopen_open import CanopenOpener
from autotune_drivers.profile import read_profile
from autotune_drivers.replay import ReplayDrive
from autotune_drivers.url import parse_link
from autotune_sim.inprocess import open_sim
from tests.drivers.contract import Contract, Shape, play
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


class TestReplay(Shape):
    """A recording of the axis at rest."""

    @pytest.fixture
    def drive(self) -> Iterator[Drive]:
        source = open_sim("sim://edm-vertical")
        metadata = Metadata(controller=controller_of(source.read_parameters()), torque_limit=1.34)
        drive = ReplayDrive(Recording.from_samples(play(source, [HOLD] * 100), metadata, "rest"), "rest")
        yield drive
        drive.close()

    @pytest.fixture(autouse=True)
    def _names(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A recording knows the controller's parameters only."""
        monkeypatch.setattr("tests.drivers.contract.MISTYPED", ("controller.kpp", r"controller\.kp"))


def opened(directory: Path) -> Iterator[Drive]:
    axis = axis_of()
    opener = CanopenOpener(parse_link(axis.link, directory), axis, read_profile(axis.profile))
    drive = opener()
    yield drive
    drive.close()
