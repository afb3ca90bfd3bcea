"""The contract suite over every link."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from autotune.core.drive import HOLD, Drive
from autotune.recordings.recording import Metadata, Recording
from autotune.recordings.replay import ReplayDrive
from autotune.tuning.session import controller_of
from autotune_drivers.canopen.opening import CanopenOpener
from autotune_drivers.profile import read_profile
from autotune_drivers.url import parse_link
from autotune_sim.inprocess import SimDrive, open_sim
from tests.drivers.contract import Contract, Hurt, Shape, Wired, play
from tests.drivers.moteus_rig import moteus_opener
from tests.drivers.simulator import Simulator, axis_of, simulator


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("slcan")) as process:
        yield process


class TestInProcess(Contract):
    """sim:// — no wire at all."""

    @pytest.fixture
    def fault(self) -> Hurt:
        def hurt(drive: Drive) -> None:
            assert isinstance(drive, SimDrive)
            drive.inject("drive-fault")

        return hurt

    @pytest.fixture
    def drive(self) -> Iterator[Drive]:
        drive = open_sim("sim://edm-vertical")
        yield drive
        drive.close()


class TestSlcan(Wired):
    """The simulated drive behind an slcan adapter on a pseudo-terminal, in lock-step."""

    @pytest.fixture
    def fault(self, running: Simulator) -> Iterator[Hurt]:
        yield from over_current(running)

    @pytest.fixture
    def drive(self, running: Simulator) -> Iterator[Drive]:
        yield from opened(running.directory)


@pytest.fixture(scope="module")
def moteus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulator]:
    with simulator(tmp_path_factory.mktemp("moteus"), "--link", "moteus", "--node", "1") as process:
        yield process


class TestMoteus(Wired):
    """The simulated drive as a moteus controller on its serial line, in lock-step."""

    patience = 1.0  # of `moteus_rig`

    @pytest.fixture
    def fault(self, moteus: Simulator) -> Iterator[Hurt]:
        yield from over_current(moteus)

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


def over_current(running: Simulator) -> Iterator[Hurt]:
    """Puts the fault in between two cycles, so that no sample tells it; then the drive is switched off and on."""

    def hurt(_: Drive) -> None:
        mark = running.mark
        running.order("drive-fault")
        running.wait_for("fault 2310h", mark)

    yield hurt
    mark = running.mark
    running.order("power-loss")
    running.wait_for("boot-up", mark)


def opened(directory: Path) -> Iterator[Drive]:
    axis = axis_of()
    opener = CanopenOpener(parse_link(axis.link, directory), axis, read_profile(axis.profile))
    drive = opener()
    yield drive
    drive.close()
