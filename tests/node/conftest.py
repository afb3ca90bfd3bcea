"""Fixtures: a simulated drive on a bench, or as a process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.node.support import Bench, Simulator


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def make_bench() -> Callable[..., Bench]:
    return Bench


@pytest.fixture
def simulate(tmp_path: Path) -> Iterator[Callable[..., Simulator]]:
    started: list[Simulator] = []

    def start(*options: str, port: Path = tmp_path / "drive.tty") -> Simulator:
        simulator = Simulator(port, *options)
        started.append(simulator)
        simulator.expect("adapter at")
        return simulator

    yield start
    for simulator in started:
        simulator.close()
