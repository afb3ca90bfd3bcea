"""The exported C file: the numbers of the Python feedforward, whatever compiles it; quiet where it must be."""

from __future__ import annotations

import math
import os
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from autotune.export.c_file import export_c
from autotune.export.request import FADE, Request
from autotune.models.drive_model import DriveModel

from .support import (
    COMPILERS,
    FED_FORWARD,
    LOOP,
    CompiledLaw,
    H,
    a_compiler,
    creeping,
    everything,
    fading,
    proved,
    python_torque,
    random_motion,
    shaped,
    sharing,
    with_effects,
    write,
)

SAME = 1e-9
"""N m: a thousandth of what is asked for (1e-6), and a thousand times what was seen."""
FLOAT_TORQUE = 2e-3
"""N m: single precision resolves 2e-6 rad at 20 rad; the stiffest contact here has 60 + 5 N m/rad, waves 24 per rad."""


def compiled(model: DriveModel, folder: Path, **options: float) -> CompiledLaw:
    return CompiledLaw(Request(model, "a model", H, **options), folder, a_compiler())


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("real", ["double", "float"])
def test_it_compiles_without_a_warning_and_passes_its_own_test(
    tmp_path: Path, compiler: str, real: str
) -> None:
    if compiler not in COMPILERS:
        pytest.skip(f"{compiler} is not installed")
    law = CompiledLaw(Request(everything(), "a model", H), tmp_path, compiler, f"-DAUTOTUNE_REAL={real}")
    error = law.self_test()
    largest = float(np.max(np.abs(python_torque(everything(), random_motion(1000, 1)))))
    assert 0.0 <= error <= (1e-12 if real == "double" else 1e-4 * largest)


@pytest.mark.parametrize("motion_unit", ["rad", "m"])
def test_random_motion_gives_the_torque_of_the_python_feedforward(tmp_path: Path, motion_unit: str) -> None:
    model, motion = everything(motion_unit), random_motion(100_000, 2)
    torque = compiled(model, tmp_path).torque(motion)
    expected = python_torque(model, motion)
    assert np.max(np.abs(torque - expected)) < SAME
    assert np.std(expected) > 0.1  # there was something to compare


@pytest.mark.parametrize(
    "effect", [*FED_FORWARD, "none", "proved", "fading", "shaped", "creeping", "sharing"]
)
def test_every_effect_alone_is_the_same(tmp_path: Path, effect: str) -> None:
    own = {
        "none": with_effects(),
        "proved": proved(3),
        "fading": fading("reversal_memory"),
        "shaped": shaped(),
        "creeping": creeping(),
        "sharing": sharing(),
    }
    model = own.get(effect) or with_effects(effect)
    motion = random_motion(5_000, 3)
    assert np.max(np.abs(compiled(model, tmp_path).torque(motion) - python_torque(model, motion))) < SAME


@pytest.mark.parametrize("period", [2.5e-4, 4e-3])
def test_other_cycles_are_the_same(tmp_path: Path, period: float) -> None:
    motion = random_motion(5_000, 4, period)
    law = CompiledLaw(Request(everything(), "a model", period), tmp_path, a_compiler())
    assert np.max(np.abs(law.torque(motion) - python_torque(everything(), motion, period))) < SAME


def test_single_precision_is_near(tmp_path: Path) -> None:
    motion = random_motion(20_000, 5)
    law = CompiledLaw(Request(everything(), "a model", H), tmp_path, a_compiler(), "-DAUTOTUNE_REAL=float")
    expected = python_torque(everything(), motion)
    inertial = 1e-6 * float(np.max(np.abs(expected)))
    assert np.max(np.abs(law.torque(motion) - expected)) < FLOAT_TORQUE + inertial


def test_sanitizers_find_nothing(tmp_path: Path) -> None:
    write(Request(everything(), "a model", H), "c", tmp_path)
    rows = np.column_stack(random_motion(20_000, 6))
    rows[::1000] = [math.nan, math.inf, -1e300]
    main = LOOP + (
        "#include <stdio.h>\n"
        "int main(void) { double x[3], t; start(1); while (fread(x, sizeof x, 1, stdin) == 1) {\n"
        " if (state.fault) { again(); } run(1, x, x + 1, x + 2, &t); } return own_test() < 1e-9 ? 0 : 1; }\n"
    )
    (tmp_path / "main.c").write_text(main)
    for compiler in COMPILERS:
        options = ["-std=c99", "-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
        command = [compiler, *options, "-o", "checked", "autotune_ff.c", "main.c", "-lm"]
        built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        if built.returncode != 0 and "cannot find" in built.stderr:
            pytest.skip(f"{compiler} has no sanitizers here")
        assert built.returncode == 0, built.stderr
        done = subprocess.run(
            ["./checked"], cwd=tmp_path, input=rows.tobytes(), capture_output=True, check=False, timeout=60,
            env=os.environ | {"ASAN_OPTIONS": "detect_leaks=0"},
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, b"")


def test_another_cycle_is_refused_when_it_is_compiled(tmp_path: Path) -> None:
    write(Request(everything(), "a model", H), "c", tmp_path)
    for cycle, passes in ((1_000_000, True), (2_000_000, False)):
        command = [a_compiler(), "-std=c99", f"-DAUTOTUNE_CYCLE_NS={cycle}", "-c", "autotune_ff.c"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode == 0) is passes
        assert passes or "for a cycle of 1000000 ns" in done.stderr


def test_another_kind_of_number_is_refused_when_it_is_compiled(tmp_path: Path) -> None:
    write(Request(everything(), "a model", H), "c", tmp_path)
    command = [a_compiler(), "-std=c99", "-DAUTOTUNE_REAL=int", "-c", "autotune_ff.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "must be float or double" in done.stderr


def test_the_torque_stays_within_the_limit(tmp_path: Path) -> None:
    motion = random_motion(20_000, 7)
    torque = compiled(everything(), tmp_path, torque_limit=0.25).torque(motion)
    expected = np.clip(python_torque(everything(), motion), -0.25, 0.25)
    assert np.max(np.abs(torque - expected)) < SAME
    assert np.max(np.abs(torque)) == 0.25


def test_when_power_comes_on_it_fades_in_and_on_demand_out_without_a_step(tmp_path: Path) -> None:
    law, count = compiled(with_effects(), tmp_path), 2000
    still = tuple(np.zeros(count) for _ in range(3))
    law.start(faded=True)
    inward = law.torque(still)  # type: ignore[arg-type]
    law.fade(False)
    outward = law.torque(still)  # type: ignore[arg-type]
    offset, step = 0.048, 0.048 * H / FADE
    assert np.max(np.abs(np.diff([0.0, *inward, *outward]))) <= step * (1 + 1e-9)
    assert inward[-1] == pytest.approx(offset)
    assert outward[-1] == 0.0
    assert np.flatnonzero(inward >= offset * (1 - 1e-9))[0] + 1 == pytest.approx(FADE / H, abs=1)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -2e9])
def test_a_reference_that_is_no_number_fades_out_and_never_comes_back_by_itself(
    tmp_path: Path, wrong: float
) -> None:
    law, still = compiled(with_effects(), tmp_path), np.zeros(600)
    before = law.torque((still, still, still))
    bad = still.copy()
    bad[0] = wrong
    after = law.torque((bad, still, still))
    assert law.fault
    assert before[-1] == pytest.approx(0.048)
    assert np.all(np.diff(after) <= 0.0)
    assert after[0] == pytest.approx(0.048, rel=3 * H / FADE)
    assert after[-1] == 0.0
    law.reset()
    assert law.torque((still, still, still))[-1] == pytest.approx(0.048)


def test_a_reset_in_motion_relaxes_the_contact_without_a_step(tmp_path: Path) -> None:
    """The torque goes to nothing and comes back; a cycle changes it by its fade, and the contact's damping."""
    law, count = compiled(with_effects("reversal_memory"), tmp_path), 2000
    moving = (H * np.arange(count), np.ones(count), np.zeros(count))
    before = law.torque(moving)[-1]
    law.reset()
    after = law.torque(moving)
    assert np.max(np.abs(np.diff([before, *after]))) <= 1.5 * H / FADE * before
    assert np.min(after) == 0.0
    assert after[-1] == pytest.approx(before)


def test_only_what_the_model_needs_is_taken_from_libm() -> None:
    plain = export_c(Request(with_effects(), "a model", H)).files["autotune_ff.c"]
    assert b"FF_EXP exp" in plain
    assert not any(
        name in plain for name in (b"FF_SIN", b"FF_POW", b"malloc", b"static AUTOTUNE_REAL FF_MIN")
    )
    assert b"FF_POW pow" in export_c(Request(everything(), "a model", H)).files["autotune_ff.c"]


def test_what_is_left_out_stands_in_the_file_with_its_cost() -> None:
    model = with_effects("thermal_drift", "torque_lag")
    made = export_c(Request(model, "a model", H))
    assert [(one.effect, one.cost is None) for one in made.lost] == [
        ("thermal_drift", False), ("torque_lag", True),
    ]  # fmt: skip
    source = made.files["autotune_ff.c"].decode()
    assert "Left out: thermal_drift, because it depends on how warm the axis is" in source
    assert " N m rms on a sine of 1 rad at 0.5 Hz" in " ".join(source.split()).replace(" * ", " ")


HOSTILE = 'a */ int x; /* é\n#error " """ *) x := 1; (* --> ??/ \\ <b>&'


def test_a_name_cannot_end_the_comment_it_stands_in(tmp_path: Path) -> None:
    model = replace(with_effects("spring"), axis=HOSTILE)
    law = CompiledLaw(Request(model, HOSTILE, H), tmp_path, a_compiler())
    assert law.self_test() < 1e-12
    component = write(Request(model, HOSTILE, H), "linuxcnc", tmp_path)
    first = component["autotune_ff.comp"].read_text().splitlines()[0]
    assert first.count('"') == 2
    ElementTree.parse(component["autotune_ff.lcec.xml"])
    text = write(Request(model, HOSTILE, H), "st", tmp_path)["autotune_ff.st"].read_text()
    assert text.partition("*)")[2].lstrip().startswith("FUNCTION_BLOCK autotune_ff\n")
