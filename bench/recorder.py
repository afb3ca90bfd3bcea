"""The drive's own recorder while both cores are busy: 60 s at 1 kHz, compared with what the plant logged.

    python bench/recorder.py --seconds 60 --busy 2

The simulated drive runs by the wall clock behind its pseudo-terminal; the master has its cyclic process.
Busy processes take the processor away from both. What the host itself has seen is told beside it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "sim"), str(ROOT / "drivers")]

from autotune.core.axis import Axis, read_axis  # noqa: E402
from autotune.core.drive_recording import DriveRecording  # noqa: E402
from autotune.experiments.path import Motion  # noqa: E402
from autotune.experiments.record import Recorder, metadata_for, play  # noqa: E402
from autotune.experiments.runner import Programme  # noqa: E402
from autotune.experiments.sines import BenchmarkSine  # noqa: E402
from autotune.recordings.joining import join  # noqa: E402
from autotune.recordings.recording import Recording  # noqa: E402
from autotune_drivers import open_loop  # noqa: E402
from autotune_drivers.cyclic.loop import CyclicLoop  # noqa: E402
from autotune_drivers.profile import Profile, read_profile  # noqa: E402
from autotune_sim.device import Device  # noqa: E402
from autotune_sim.presets import preset  # noqa: E402
from autotune_sim.server import Server  # noqa: E402
from autotune_sim.servo import Servo  # noqa: E402

COUNTS = 50000.0 / (2.0 * np.pi)
Log = dict[int, tuple[int, int, int, int]]


def work(stop: multiprocessing.synchronize.Event) -> None:  # type: ignore[name-defined]
    while not stop.is_set():
        sum(k * k for k in range(100_000))


def patient() -> Profile:
    """The simulated drive's profile for a host that is late on purpose."""
    found = read_profile("autotune-sim")
    cycle = found.cycle.model_copy(update={"reply_timeout": 1.0, "lost_cycles": 10})
    guard = found.guard.model_copy(update={"consume": 1.0})
    return found.model_copy(update={"cycle": cycle, "guard": guard})


def logger(log: Log) -> object:
    def look(device: Device) -> None:
        s = device.firmware.sample
        log[device.firmware.cycles & 0xFFFF] = (
            round(s.position * COUNTS),
            round(s.position_demand * COUNTS),
            round(s.torque_demand * 1e6),
            round(s.torque_actual * 1e6),
        )

    return look


def serve(server: Server) -> None:
    """The drive has a processor of its own: it goes before the busy processes, where that is permitted."""
    with suppress(OSError):
        os.sched_setscheduler(threading.get_native_id(), os.SCHED_FIFO, os.sched_param(10))
    server.run()


def record(axis: Axis, folder: Path, seconds: float) -> tuple[Recording, DriveRecording, float]:
    loop = open_loop(axis, folder, patient())
    assert isinstance(loop, CyclicLoop)
    try:
        sine = BenchmarkSine(Motion.of(axis), 1, max(round(seconds * axis.benchmark.frequency), 1))
        programme = Programme((sine,), axis.limits, 2.0 * seconds + 10.0)
        recorder = Recorder(metadata_for(axis), programme.labels)
        loop.begin_recording(loop.recorder_seconds() * 0.999)
        play(loop, programme, recorder)
        began = time.monotonic()
        return recorder.recording(), loop.end_recording(), time.monotonic() - began
    finally:
        loop.close()


def compare(drive: DriveRecording, log: Log) -> int:
    """Samples that are not what the plant logged, of all that were recorded."""
    names = ("position", "reference", "torque_command", "torque")
    scales = (COUNTS, COUNTS, 1e6, 1e6)
    raw = [
        np.rint(drive.columns[name] * scale).astype(int) for name, scale in zip(names, scales, strict=True)
    ]
    rows = zip(drive.cycle.tolist(), *(values.tolist() for values in raw), strict=True)
    return sum(log.get(cycle) != tuple(values) for cycle, *values in rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--busy", type=int, default=2, help="busy processes")
    wanted = parser.parse_args()
    stop = multiprocessing.Event()
    busy = [multiprocessing.Process(target=work, args=(stop,), daemon=True) for _ in range(wanted.busy)]
    log: Log = {}
    with tempfile.TemporaryDirectory() as name:
        folder, ready = Path(name), threading.Event()
        axis = read_axis(ROOT / "config" / "axes" / "edm-vertical.toml")
        far = axis.limits.model_copy(
            update={"position_min": -1e4, "position_max": 1e4}
        )  # late hosts brake late
        link = "canopen+slcan:edm.tty?bitrate=1000000&node=5"
        axis = axis.model_copy(update={"link": link, "limits": far})
        servo = Servo(preset("edm-vertical"), 0)
        server = Server(servo, folder / "edm.tty", 5, real_time=True, ready=lambda _: ready.set())
        server.device.on_cycle = logger(log)  # type: ignore[assignment]
        thread = threading.Thread(target=serve, args=(server,))
        thread.start()
        try:
            ready.wait(30)
            for process in busy:
                process.start()
            host, drive, fetched = record(axis, folder, wanted.seconds)
        finally:
            stop.set()
            server.stop()
            thread.join()
    whole = join(host, drive)
    gaps = int(np.count_nonzero(np.diff(drive.cycle) % 65536 != 1))
    print(
        f"{len(whole)} samples of {len(drive.columns)} signals at {1e3 * drive.period:g} ms, {wanted.busy} busy "
        f"processes: {gaps} gaps, {compare(drive, log)} samples differ from the plant's log, fetched in "
        f"{fetched:.1f} s; the host itself saw {len(host)} and lost {int(host.missed.sum())}"
    )


if __name__ == "__main__":
    main()
