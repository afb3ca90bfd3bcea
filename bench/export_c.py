"""The exported C file against the Python feedforward over random motion, and how long a step takes.

Time is that of the processor, the median of blocks: others may be busy on the host.

python -m bench.export_c [--samples 10000000] [--seed 15]
"""

from __future__ import annotations

import argparse
import ctypes
import platform
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from autotune.control.model_feedforward import ModelFeedforward
from autotune.core.arrays import Floats
from autotune.export.request import Request
from autotune.export.targets import export
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.table import EFFECTS

H = 1e-3
BLOCK = 100_000
NUMBERS = {
    "inertia": 6.66e-4, "viscous": 4.13e-3, "coulomb": 0.30, "stiffness": 60.0, "micro_damping": 0.1,
    "offset": 0.048,
}  # fmt: skip
LOOP = """
#include <time.h>
#include "autotune_ff.h"
static autotune_ff_state state;
void start(void) { autotune_ff_init(&state); }
double run(long n, const double *q, const double *v, const double *a, double *t)
{
    struct timespec begin, end;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
    for (long k = 0; k < n; k++) {
        t[k] = autotune_ff_step(&state, (AUTOTUNE_REAL)q[k], (AUTOTUNE_REAL)v[k], (AUTOTUNE_REAL)a[k]);
    }
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
    return (double)(end.tv_sec - begin.tv_sec) + 1e-9 * (double)(end.tv_nsec - begin.tv_nsec);
}
"""


def everything() -> DriveModel:
    """A model with every effect that is fed forward, and as many waves and elements as a model holds."""
    ripple, memory = {}, {}
    for i in range(1, 11):
        ripple |= {f"order_{i}": 6.0 * i, f"sin_{i}": 0.02 / i, f"cos_{i}": -0.01 / i}
        memory |= {f"displacement_{i}": 1e-3 * 1.6**i, f"torque_{i}": 0.02}
    effects = {
        "torque_ripple": ripple,
        "direction_asymmetry": {"coulomb": 0.04, "viscous": 1e-3},
        "stribeck": {"break_away": 0.38, "stribeck_velocity": 0.3, "stribeck_exponent": 1.3},
        "nonlinear_viscous": {"torque": 0.05, "exponent": 0.66, "knee": 0.05},
        "position_dependent_friction": {
            "height": 0.3, "centre": 0.5, "width": 0.8, "order": 2, "sin": 0.1, "cos": 0.05,
        },
        "gravity_imbalance": {"sin": 0.05, "cos": -0.03, "order": 0.5},
        "spring": {"stiffness": 0.03},
        "reversal_memory": memory,
    }  # fmt: skip
    model = base_model(NUMBERS)
    for name, values in effects.items():
        model = model.with_effect(EFFECTS[name].make(values))
    return model


def motion(random: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """A block of restless motion over six decades of speed, with rests; shape (BLOCK,) each."""
    pieces = BLOCK // 200
    size = (10.0 ** random.uniform(-4.0, 1.5, pieces) * (random.random(pieces) > 0.1)).repeat(200)
    velocity = size * np.convolve(random.normal(0.0, 1.0, BLOCK), np.ones(25) / 5.0, "same")
    position = np.remainder(random.uniform(-20.0, 20.0) + np.cumsum(velocity) * H, 40.0) - 20.0
    return position, velocity, np.gradient(velocity, H)


def compiled(folder: Path, compiler: str, real: str) -> ctypes.CDLL:
    """The exported file as a library."""
    for name, content in export(Request(everything(), "bench", H), "c").files.items():
        (folder / name).write_bytes(content)
    (folder / "loop.c").write_text(LOOP)
    library = folder / f"{compiler}-{real}.so"
    command = [
        compiler,
        "-std=gnu99",
        "-O2",
        f"-DAUTOTUNE_REAL={real}",
        "-fPIC",
        "-shared",
        "-o",
        str(library),
    ]
    subprocess.run([*command, "autotune_ff.c", "loop.c", "-lm"], cwd=folder, check=True)
    loaded = ctypes.CDLL(str(library))
    loaded.run.restype = ctypes.c_double
    return loaded


def main() -> None:
    """Runs all of it and prints a line for each build."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=15)
    chosen = parser.parse_args()
    print(f"{chosen.samples} samples, seed {chosen.seed}, {platform.machine()}")
    with tempfile.TemporaryDirectory() as folder:
        builds = [(c, r) for c in ("gcc", "clang") for r in ("double", "float")]
        laws = {build: compiled(Path(folder), *build) for build in builds}
        for law in laws.values():
            law.start()
        worst: dict[tuple[str, str], float] = dict.fromkeys(builds, 0.0)
        seconds: dict[tuple[str, str], list[float]] = {build: [] for build in builds}
        python = ModelFeedforward(everything(), H)
        random, largest, began = np.random.default_rng(chosen.seed), 0.0, time.monotonic()
        for _ in range(chosen.samples // BLOCK):
            columns = motion(random)
            rows = zip(*(column.tolist() for column in columns), strict=True)
            expected = np.array([python.step(q, v, a, None) for q, v, a in rows])
            largest = max(largest, float(np.max(np.abs(expected))))
            for build, law in laws.items():
                torque = np.empty(BLOCK)
                pointers = [x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in (*columns, torque)]
                seconds[build].append(law.run(ctypes.c_long(BLOCK), *pointers))
                worst[build] = max(worst[build], float(np.max(np.abs(torque - expected))))
    for compiler, real in builds:
        error, pace = worst[compiler, real], 1e9 * float(np.median(seconds[compiler, real])) / BLOCK
        print(f"{compiler:5} {real:6}  largest error {error:.2g} N m of {largest:.3g}   {pace:.0f} ns a step")
    print(f"{time.monotonic() - began:.0f} s in all")


if __name__ == "__main__":
    main()
