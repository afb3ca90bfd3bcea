"""The drive's own recorder over the real byte stream: what comes out is what the plant logged, with labels."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from autotune.core.drive_recording import DriveRecording
from autotune.core.errors import ConfigurationError, LinkError, LinkTimeout, RecordingError
from autotune.core.loop import LocalLoop
from autotune.experiments.path import Motion
from autotune.experiments.record import Recorder, metadata_for, play
from autotune.experiments.runner import Programme
from autotune.experiments.sines import BenchmarkSine
from autotune.recordings.joining import join
from autotune.recordings.recording import Metadata, Recording
from autotune.tuning.drive_recorder import groups
from autotune_drivers.canopen.drive import CanopenDrive
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.opening import open_drive
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.profile import read_profile
from autotune_sim.device import Device
from tests.drivers.simulator import axis_of
from tests.tuning.cut_rig import NODE, Rig, virtual_time

AXIS = axis_of()
COUNTS = 50000.0 / (2.0 * np.pi)


@contextmanager
def opened() -> Iterator[tuple[Rig, CanopenDrive]]:
    rig = Rig({})
    with virtual_time(rig):
        drive = open_drive(rig, NODE, AXIS, read_profile("autotune-sim"))
        try:
            yield rig, drive
        finally:
            drive.close()


def programme(windows: int = 2) -> Programme:
    sines = [BenchmarkSine(Motion.of(AXIS), 1, 1, label=f"window-{k}") for k in range(windows)]
    return Programme(tuple(sines), AXIS.limits, 100.0)


def played(drive: CanopenDrive, wanted: Programme) -> Recording:
    recorder = Recorder(metadata_for(AXIS), wanted.labels)
    play(LocalLoop(drive), wanted, recorder)
    return recorder.recording()


def test_it_is_what_the_plant_logged_and_what_the_host_saw() -> None:
    log: list[tuple[int, int, float]] = []

    def look(device: Device) -> None:
        sample = device.firmware.sample
        log.append((device.firmware.cycles & 0xFFFF, round(sample.position * COUNTS), sample.torque_demand))

    with opened() as (rig, drive):
        rig.device.on_cycle = look
        drive.begin_recording(20.0)
        host = played(drive, programme())
        drive_made = join(host, drive.end_recording())
    assert len(drive_made) == len(host)
    assert np.array_equal(drive_made["time"], host["time"])
    assert np.array_equal(drive_made.experiment, host.experiment)
    for column in ("position", "torque_command", "torque", "torque_feedback", "velocity"):
        assert np.array_equal(drive_made[column], host[column]), column
    plant = {position for _, position, _ in log}
    assert set(np.rint(drive_made["position"] * COUNTS).astype(int).tolist()) <= plant
    assert drive_made["reference"] == pytest.approx(host["reference"], abs=1.01 / COUNTS)


def test_samples_that_the_host_has_lost_are_in_the_drives_recording() -> None:
    with opened() as (_, drive):
        drive.begin_recording(20.0)
        host = played(drive, programme(1))
        recorded = drive.end_recording()
    holes = np.ones(len(host), dtype=bool)
    holes[500:503] = False
    lossy = host.rows(holes)
    missed = lossy.missed.copy()
    missed[500] = 3
    lossy = Recording.from_columns(dict(lossy.floats), lossy.metadata, lossy.experiment, lossy.repeat, missed)
    whole = join(lossy, recorded)
    assert len(whole) == len(host)
    assert np.array_equal(whole["position"], host["position"])
    assert np.array_equal(whole["time"], host["time"])


def test_settings_of_the_recorder_are_put_back() -> None:
    rig = Rig({})
    before = {sub: rig.device.objects.number(0x2401, sub) for sub in range(1, 9)}
    with virtual_time(rig):
        drive = open_drive(rig, NODE, AXIS, read_profile("autotune-sim"))
        drive.begin_recording(1.0)
        assert rig.device.objects.number(0x2401, 7) != before[7]
        drive.close()  # while it is still armed
    assert {sub: rig.device.objects.number(0x2401, sub) for sub in range(1, 9)} == before


def test_a_recorder_whose_start_was_not_answered_is_stopped_and_its_settings_put_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig({})
    before = {sub: rig.device.objects.number(0x2401, sub) for sub in range(1, 9)}
    with virtual_time(rig):
        drive = open_drive(rig, NODE, AXIS, read_profile("autotune-sim"))
        recorder, write = read_profile("autotune-sim").recorder, Sdo.write
        assert recorder is not None

        def unanswered(sdo: Sdo, ref: ObjectRef, value: Raw) -> None:
            write(sdo, ref, value)
            if (ref, value) == (recorder.control, recorder.start):
                raise LinkTimeout("no answer")

        with monkeypatch.context() as patched:
            patched.setattr(Sdo, "write", unanswered)
            with pytest.raises(LinkTimeout):
                drive.begin_recording(1.0)
        drive.close()
    assert {sub: rig.device.objects.number(0x2401, sub) for sub in range(1, 9)} == before


def test_a_recorder_that_a_dead_session_has_armed_is_stopped_and_its_settings_put_back(
    tmp_path: Path,
) -> None:
    """Armed, it refuses that they are changed."""
    rig = Rig({})
    before = {sub: rig.device.objects.number(0x2401, sub) for sub in range(1, 9)}
    with virtual_time(rig):
        open_drive(rig, NODE, AXIS, read_profile("autotune-sim"), keep=tmp_path).begin_recording(1.0)
        rig.plug()  # the session is dead
        assert rig.device.objects.number(0x2401, 7) != before[7]
        drive = open_drive(rig, NODE, AXIS, read_profile("autotune-sim"), keep=tmp_path)
        assert {sub: rig.device.objects.number(0x2401, sub) for sub in range(1, 9)} == before
        drive.close()


def test_longer_than_it_holds_and_nothing_recorded() -> None:
    with opened() as (_, drive):
        assert drive.recorder_seconds() == pytest.approx(65.536)
        with pytest.raises(ConfigurationError, match="holds 1 to 65536"):
            drive.begin_recording(100.0)
        drive.begin_recording(1.0)
        with pytest.raises(LinkError, match="trigger did not come"):
            drive.end_recording()


def test_experiments_are_grouped_by_what_the_recorder_holds() -> None:
    sines = programme(6).experiments
    assert [len(group) for group in groups(sines, 1e6)] == [6]
    assert [len(group) for group in groups(sines, 1e-3)] == [1] * 6
    two = 1.25 * 2 * sines[0].duration + 3.01
    assert [len(group) for group in groups(sines, two)] == [2, 2, 2]


def segment(count: int, start: int = 65000) -> tuple[Recording, DriveRecording]:
    """A host recording and the drive's, whose counters go over their edge."""
    time = np.arange(count) * 1e-3
    host = Recording.from_columns(
        {"time": time, "position": np.zeros(count), "torque": np.zeros(count)},
        Metadata(motion_unit="rad", sample_period=1e-3),
        np.full(count, "a"),
        np.zeros(count, dtype=np.int64),
        np.zeros(count, dtype=np.int64),
    )
    sync = (start + np.arange(-5, count + 5)) % 65536
    position = np.arange(-5, count + 5, dtype=float)
    columns = {"position": position, "torque": position}
    return host, DriveRecording(columns, sync, (sync + 77) % 65536, 1e-3, ((1, start),))


def test_counters_may_go_over_their_edge() -> None:
    host, drive = segment(2000)
    assert np.array_equal(join(host, drive)["position"], np.arange(2000.0))


def test_gaps_and_foreign_recordings_are_refused() -> None:
    host, drive = segment(100)
    keep = np.arange(110) != 50
    holed = DriveRecording(
        {n: v[keep] for n, v in drive.columns.items()}, drive.sync[keep], drive.cycle[keep], 1e-3, drive.marks
    )
    with pytest.raises(LinkError, match="lost 1 samples in 1 places"):
        join(host, holed)
    short = DriveRecording(
        {n: v[:50] for n, v in drive.columns.items()}, drive.sync[:50], drive.cycle[:50], 1e-3, drive.marks
    )
    with pytest.raises(LinkError, match="lacks 55 of 100"):
        join(host, short)
    other = DriveRecording(drive.columns, (drive.sync + 3000) % 65536, drive.cycle, 1e-3, drive.marks)
    with pytest.raises(LinkError, match="nothing of what was played"):
        join(host, other)
    with pytest.raises(RecordingError, match="no samples"):
        join(host.rows(slice(0, 0)), drive)
