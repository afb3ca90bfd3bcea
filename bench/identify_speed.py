"""Speed of identification: the twin against the same loop in C at -O2, and a joint refinement of 60 s.

python -m bench.identify_speed
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from autotune.core.arrays import Floats
from autotune.identify.refinement import refine_recording
from autotune.models import layout
from autotune.models.drive_model import base_model
from autotune.models.plant import simulate, substeps_for
from autotune.models.table import EFFECTS
from autotune.recordings.recording import Recording
from tests.support.identification_programme import play, truth, varied_axis

SECONDS, PERIOD = 60.0, 1e-3
SOURCE = Path(__file__).with_name("twin.c")
VALUES = {
    "inertia": 6.66e-4,
    "viscous": 4.13e-3,
    "coulomb": 0.33,
    "stiffness": 100.0,
    "micro_damping": 0.1,
    "offset": 0.048,
    "break_away": 0.36,
    "stribeck_velocity": 0.3,
}
RIPPLE = {"order_1": 7.0, "sin_1": 0.006, "cos_1": 0.008}


def best_of(call: Callable[[], object], times: int = 7) -> float:
    """Least processor time of several calls [s]."""
    found = []
    for _ in range(times):
        start = time.process_time()
        call()
        found.append(time.process_time() - start)
    return min(found)


def kernel_times() -> tuple[float, float | None, float]:
    """Seconds for 60 s of the twin: compiled kernel, C (None without a compiler), largest difference."""
    model = base_model(VALUES).with_effect(EFFECTS["torque_ripple"].make(RIPPLE))
    packed = model.pack()
    count = round(SECONDS / PERIOD)
    substeps = substeps_for(packed.p, PERIOD, packed.on)
    reference = 0.2 * np.sin(2.0 * np.pi * np.arange(count) * PERIOD)
    noise = np.random.default_rng(0).normal(0.0, 5e-3, count)
    zero, gains = np.zeros(count), np.array([60.0, 0.15, 6000.0, 0.5, 1.0])
    position, torque = np.empty(count), np.empty(count)

    def loop() -> Floats:
        return np.array([PERIOD, 1.34, 2.0 * np.pi / 50000, 0.0, 0.0, 0.0, 0.0])

    def ours() -> None:
        simulate(
            packed.p, packed.on, np.zeros(layout.STATES), gains, loop(), True, substeps,
            reference, zero, noise, zero, position, torque,
        )  # fmt: skip

    ours()
    own = best_of(ours)
    library = _library()
    if library is None:
        return own, None, 0.0
    numbers = np.array(
        [*(VALUES[name] for name in VALUES), RIPPLE["sin_1"], RIPPLE["cos_1"], RIPPLE["order_1"]]
    )
    other, other_torque = np.empty(count), np.empty(count)

    def theirs() -> None:
        library.simulate(
            _pointer(numbers), _pointer(np.zeros(3)), _pointer(gains), _pointer(loop()), ctypes.c_long(substeps),
            ctypes.c_long(count), _pointer(reference), _pointer(noise), _pointer(other), _pointer(other_torque),
        )  # fmt: skip

    in_c = best_of(theirs)
    return own, in_c, float(np.max(np.abs(position - other)))


def refinement_seconds() -> tuple[float, int]:
    """Processor time of a joint refinement of 8 parameters on 60 s of data, and its rows."""
    axis = varied_axis(5)
    recording = _sixty_seconds(play(axis, 5))
    start = {name: 1.1 * value for name, value in truth(axis.plant).items()}
    model = base_model(start)
    refine_recording(model, recording)
    begin = time.process_time()
    refine_recording(model, recording)
    return time.process_time() - begin, len(recording)


def _sixty_seconds(recording: Recording) -> Recording:
    fitted = recording.rows(recording.experiment != "conditioning")
    return fitted.rows(slice(0, round(SECONDS / PERIOD)))


def _library() -> ctypes.CDLL | None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        return None
    folder = Path(tempfile.mkdtemp())
    target = folder / "twin.so"
    command = [compiler, "-O2", "-shared", "-fPIC", "-o", str(target), str(SOURCE), "-lm"]
    subprocess.run(command, check=True)
    try:
        return ctypes.CDLL(str(target))
    finally:
        shutil.rmtree(folder)


def _pointer(values: Floats) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


def main() -> int:
    """Prints both figures; 1 where one of them is missed."""
    own, in_c, difference = kernel_times()
    print(f"twin, 60 s at 1 kHz: {1e3 * own:.1f} ms compiled kernel (all effects built in)")
    if in_c is None:
        print("no C compiler here: the same loop in C was not timed")
    else:
        print(f"same loop in C, -O2: {1e3 * in_c:.1f} ms, ratio {own / in_c:.2f} (asked: 1.2)")
        print(f"largest difference of position: {difference:.1e} rad")
    seconds, rows = refinement_seconds()
    print(f"joint refinement, 8 parameters, {rows * PERIOD:.0f} s of data: {seconds:.1f} s (asked: 5 s)")
    return int(seconds > 5.0 or (in_c is not None and own > 1.2 * in_c))


if __name__ == "__main__":
    sys.exit(main())
