"""Models with every effect, random motion, and the exported C file called from Python."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from autotune.control.model_feedforward import ModelFeedforward
from autotune.core.arrays import Floats
from autotune.export.request import Request
from autotune.export.targets import export
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.model_file import read_model
from autotune.models.table import EFFECTS

H = 1e-3
MODELS = Path(__file__).with_name("models")
"""What `autotune run` proved on sim://edm-vertical?seed=3 and 4 (its feedforward.toml)."""
FED_FORWARD = tuple(name for name, kind in EFFECTS.items() if kind.fed_forward)
NUMBERS = {
    "inertia": 6.66e-4, "viscous": 4.13e-3, "coulomb": 0.30, "stiffness": 60.0, "micro_damping": 0.1,
    "offset": 0.048,
}  # fmt: skip
VALUES: Mapping[str, Mapping[str, float]] = {
    "torque_ripple": {
        "order_1": 12, "sin_1": 0.02, "cos_1": 0.01, "order_2": 24.5, "sin_2": 0.01, "cos_2": -0.004,
    },
    "direction_asymmetry": {"coulomb": 0.04, "viscous": 1e-3},
    "stribeck": {"break_away": 0.38, "stribeck_velocity": 0.3, "stribeck_exponent": 1.3},
    "nonlinear_viscous": {"torque": 0.05, "exponent": 0.66, "knee": 0.05},
    "position_dependent_friction": {
        "height": 0.3, "centre": 0.5, "width": 0.8, "order": 2, "sin": 0.1, "cos": 0.05,
    },
    "gravity_imbalance": {"sin": 0.05, "cos": -0.03, "order": 0.5},
    "spring": {"stiffness": 0.03},
    "reversal_memory": {
        "displacement_1": 0.01, "torque_1": 0.05, "displacement_2": 0.1, "torque_2": 0.05, "damping": 0.02,
    },
    "thermal_drift": {"softening": 0.3, "time_constant": 5.0, "idle": 0.2},
    "torque_lag": {"time_constant": 8e-4},
}  # fmt: skip
SHAPES: Mapping[str, Mapping[str, float]] = {
    "stribeck": {"stribeck_tail": 0.8},
    "direction_asymmetry": {"width": 0.05, "fast": 0.02, "fast_width": 1.0},
    "nonlinear_viscous": {"film_1": 0.03, "film_speed_1": 0.2, "fan_1": 0.002, "fan_speed_1": 2.0},
    "position_dependent_friction": {"edge": 3.5, "from": -1.0, "step": 1.0, "rise_1": 0.2, "rise_3": -0.1},
    "gravity_imbalance": {"sin_2": 0.02, "cos_2": 0.01},
    "spring": {"from": -0.5, "step": 0.5, "ramp_1": 0.02, "ramp_3": 0.05},
    "reversal_memory": {"yielding": 0.7},
}
"""What an effect by another law has beside its own."""
FADING = {"damping_velocity": 0.2, "damping_tail": 0.6}
"""Of a base whose damping in presliding fades with speed."""
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
WARNINGS = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wshadow",
    "-Wdouble-promotion",
    "-Werror",
    "-pedantic",
]
LOOP = """
#include "autotune_ff.h"
autotune_ff_state state;
void start(int faded) { if (faded) { autotune_ff_begin(&state); } else { autotune_ff_init(&state); } }
void again(void) { autotune_ff_reset(&state); }
void run(long n, const double *q, const double *v, const double *a, double *t);
void run(long n, const double *q, const double *v, const double *a, double *t)
{
    long k;
    for (k = 0; k < n; k++) {
        t[k] = (double)autotune_ff_step(&state, (AUTOTUNE_REAL)q[k], (AUTOTUNE_REAL)v[k], (AUTOTUNE_REAL)a[k]);
    }
}
double own_test(void);
double own_test(void) { return (double)autotune_ff_selftest(); }
void fade(int in) { if (in) { autotune_ff_fade_in(&state); } else { autotune_ff_fade_out(&state); } }
int fault(void) { return state.fault; }
"""


def with_effects(*names: str, motion_unit: str = "rad") -> DriveModel:
    """A model with these effects."""
    model = base_model(NUMBERS, motion_unit=motion_unit)
    for name in names:
        model = model.with_effect(EFFECTS[name].make(VALUES[name]))
    return model


def everything(motion_unit: str = "rad") -> DriveModel:
    """A model with every effect that is fed forward."""
    return with_effects(*FED_FORWARD, motion_unit=motion_unit)


def fading(*names: str) -> DriveModel:
    """A model with these effects whose damping in presliding fades with speed."""
    model = base_model({**NUMBERS, **FADING})
    for name in names:
        model = model.with_effect(EFFECTS[name].make(VALUES[name]))
    return model


def shaped() -> DriveModel:
    """A model of effects by laws of their own course, and so its base."""
    model = fading().with_curve((1.0, 1.0, 0.9, 0.4))
    for name, shape in SHAPES.items():
        model = model.with_effect(EFFECTS[name].make({**VALUES[name], **shape}))
    return model


def creeping() -> DriveModel:
    """A model without static friction, with everything that multiplies its level."""
    return everything().with_creep(0.3, 0.6)


def sharing() -> DriveModel:
    """A model whose elements are its contact, and share what is added to its level and what multiplies it."""
    elements = {**VALUES["reversal_memory"], "attraction": 40.0}
    return everything().with_effect(EFFECTS["reversal_memory"].make(elements))


def proved(seed: int) -> DriveModel:
    """What a run has proved on a simulated axis."""
    return read_model(MODELS / f"seed-{seed}.toml")


def write(request: Request, target: str, folder: Path) -> dict[str, Path]:
    """Exports into a folder; paths by name."""
    made = export(request, target)
    for name, content in made.files.items():
        (folder / name).write_bytes(content)
    return {name: folder / name for name in made.files}


def random_motion(count: int, seed: int, period: float = H) -> tuple[Floats, Floats, Floats]:
    """Position, velocity and acceleration of restless motion with rests, presliding and fast moves; (count,) each."""
    random = np.random.default_rng(seed)
    size = np.repeat(10.0 ** random.uniform(-4.0, 1.5, count // 200 + 1), 200)[:count]
    rate = random.normal(0.0, 1.0, count)
    smooth = np.convolve(rate, np.ones(25) / 5.0, "same")
    velocity = np.where(random.random(count // 200 + 1) < 0.1, 0.0, 1.0).repeat(200)[:count] * size * smooth
    position = np.cumsum(velocity) * period
    return np.remainder(position, 40.0) - 20.0, velocity, np.gradient(velocity, period)


def python_torque(model: DriveModel, motion: tuple[Floats, Floats, Floats], period: float = H) -> Floats:
    """What `ModelFeedforward` plays; shape (n,) [N m]."""
    law = ModelFeedforward(model, period)
    rows = zip(*(column.tolist() for column in motion), strict=True)
    return np.array([law.step(q, v, a, None) for q, v, a in rows])


class CompiledLaw:
    """The exported C file as a shared library."""

    def __init__(self, request: Request, folder: Path, compiler: str, *options: str) -> None:
        write(request, "c", folder)
        (folder / "loop.c").write_text(LOOP)
        library = folder / f"law{len(list(folder.glob('*.so')))}.so"
        strict = [*WARNINGS, "-O2", *options, "-c", "-o", "/dev/null", "autotune_ff.c"]
        whole = [
            "-std=c99",
            "-O2",
            "-fPIC",
            "-shared",
            *options,
            "-o",
            str(library),
            "autotune_ff.c",
            "loop.c",
            "-lm",
        ]
        for command in ([compiler, *strict], [compiler, *whole]):
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
        self._library = ctypes.CDLL(str(library))
        self._library.own_test.restype = ctypes.c_double
        self.start()

    def start(self, faded: bool = False) -> None:
        self._library.start(int(faded))

    def reset(self) -> None:
        self._library.again()

    def fade(self, inward: bool) -> None:
        self._library.fade(int(inward))

    @property
    def fault(self) -> bool:
        return bool(self._library.fault())

    def self_test(self) -> float:
        return float(self._library.own_test())

    def torque(self, motion: tuple[Floats, Floats, Floats]) -> Floats:
        """Steps through a motion; shape (n,)."""
        columns = [np.ascontiguousarray(column, dtype=np.float64) for column in motion]
        result = np.empty(len(columns[0]))
        kind = ctypes.POINTER(ctypes.c_double)
        pointers = [column.ctypes.data_as(kind) for column in (*columns, result)]
        self._library.run(ctypes.c_long(len(result)), *pointers)
        return result


def a_compiler() -> str:
    """Any compiler, or the test is skipped."""
    if not COMPILERS:
        pytest.skip("no C compiler: install gcc or clang")
    return COMPILERS[0]
