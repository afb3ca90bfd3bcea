"""A recording as a drive: the same programme gives the same samples, another one is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from autotune.core.drive import HOLD, Command, Mode
from autotune.core.errors import DriveError, LinkError, RecordingError
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Metadata, Recording
from autotune.recordings.replay import ReplayDrive, open_replay
from autotune.tuning.links import open_link
from autotune_sim.inprocess import open_sim
from tests.drivers.contract import column, play, sine, where
from tests.drivers.routines import Sine
from tests.drivers.simulator import axis_of


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Path, list[Command], Recording]:
    drive = open_sim("sim://edm-vertical")
    commands = sine(400, where(drive), feedforward=0.02)
    recording = Recording.from_samples(
        play(drive, commands), Metadata(position_resolution=1.257e-4, axis="edm-vertical"), "sine"
    )
    path = tmp_path / "sine.parquet"
    write_recording(recording, path)
    return path, commands, recording


def test_the_same_commands_give_the_same_samples(recorded: tuple[Path, list[Command], Recording]) -> None:
    path, commands, recording = recorded
    samples = play(open_replay(path), commands)
    for name in ("time", "reference", "position", "torque_command", "torque_feedforward", "temperature"):
        np.testing.assert_array_equal(column(samples, name), recording[name])


def test_another_command_is_refused(recorded: tuple[Path, list[Command], Recording]) -> None:
    path, commands, _ = recorded
    with pytest.raises(DriveError, match="cycle 10"):
        play(open_replay(path), [*commands[:10], Command(5.0)])
    with pytest.raises(DriveError, match="finite"):
        play(open_replay(path), [Command(velocity=math.inf)], Mode.VELOCITY)


def test_its_end_is_said(recorded: tuple[Path, list[Command], Recording]) -> None:
    path, commands, _ = recorded
    with pytest.raises(LinkError, match="ended after 400 cycles"):
        play(open_replay(path), [*commands, HOLD])


def test_columns_that_a_recording_does_not_have_are_nan() -> None:
    columns = {"time": [0.0, 1e-3], "position": [1.0, 2.0], "torque": [0.1, 0.2]}
    drive = ReplayDrive(Recording.from_columns(columns, Metadata()), "little")
    samples = play(drive, [Command(7.0), HOLD])
    assert [sample.position for sample in samples] == [1.0, 2.0]
    assert math.isnan(samples[0].torque_feedback)
    assert drive.read_parameters() == {}


def test_a_link_of_its_own_plays_routines(tmp_path: Path) -> None:
    source = open_sim("sim://edm-vertical")
    source.enable(Mode.POSITION)
    samples = [source.step(HOLD)]
    samples += [source.step(command) for command in sine(400, samples[0].position, feedforward=0.02)]
    source.close()
    write_recording(Recording.from_samples(samples, Metadata(), "sine"), tmp_path / "sine.parquet")
    loop = open_link(axis_of("replay:sine.parquet"), tmp_path)
    rows: list[np.ndarray[tuple[int, int], np.dtype[np.float64]]] = []
    try:
        assert loop.play(Sine(400, feedforward=0.02), rows.append) == samples[-1].position
    finally:
        loop.close()
    assert sum(map(len, rows)) == 400


def test_a_file_that_is_no_recording_is_said(tmp_path: Path) -> None:
    with pytest.raises(RecordingError):
        open_link(axis_of("replay:nothing.parquet"), tmp_path)
