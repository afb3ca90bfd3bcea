"""docs/adding-an-effect.md, followed to the letter in a copy of the program: its file, its entry, nothing else."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.layout import EFFECT_NAMES

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/adding-an-effect.md").read_text(encoding="utf-8")
NAME = "stiffening_spring"
PLACES = {
    "EFFECT_NAMES": "autotune/models/layout.py",
    "EFFECTS": "sim/autotune_sim/effects.py",
    "VALUES": "tests/models/test_effects.py",
    "MEDIUM": "tests/support/axes.py",
}
NUMBERS = {
    "inertia": 6.7e-4, "viscous": 4e-3, "coulomb": 0.33, "stiffness": 60.0, "micro_damping": 0.1, "offset": 0.05,
}  # fmt: skip

KNOWN = f"""
import autotune
from autotune.control.model_feedforward import fed_forward, left_out
from autotune.models.drive_model import HistoryEntry, base_model
from autotune.models.table import effect_kind
model = base_model({NUMBERS}).with_effect(effect_kind("{NAME}").make({{"hardening": 1e-3}}))
model = model.with_history(HistoryEntry("2026-01-01", "+ {NAME}", "", 0.1, 0.02, 0.01, "test"))
assert "{NAME}" in fed_forward(model) and not left_out(model)
autotune.write_model(model, "with.toml")
assert autotune.read_model("with.toml")["{NAME}.hardening"] == 1e-3
from autotune.export.law import feedforward_law
assert "{NAME.upper()}_HARDENING" in [constant.name for constant in feedforward_law(model, 1e-3).constants]
"""

WORKS = f"""
import numpy as np
import autotune
from autotune.control.model_feedforward import torque_along
from autotune.models.drive_model import base_model
from autotune.models.table import effect_kind
plain = base_model({NUMBERS})
true = plain.with_effect(effect_kind("{NAME}").make({{"hardening": 1e-3}}))
motion = autotune.simulate("sim://edm-vertical?seed=3", programme="diagnosis")
planted = autotune.simulate(true, motion)
without, with_it = (autotune.compare(planted, model) for model in (plain, true))
assert with_it.error_rms < 0.05 * without.error_rms, (with_it, without)
fitted = autotune.fit(planted, effects=["{NAME}"])
assert abs(fitted.model["{NAME}.hardening"] / 1e-3 - 1.0) < 0.02, fitted
added = autotune.add_effect("{NAME}", planted, plain)
assert added.error_after < 0.1 * added.error_before, added
diagnosis = autotune.diagnose(planted, plain)
assert diagnosis.effects == ("{NAME}",), diagnosis
diagnosis.write_html("diagnosis.html")
reference = np.linspace(-5.0, 5.0, 1001)
rate, still = np.full(1001, 10.0), np.zeros(1001)
torque = [torque_along(model, reference, rate, still, 1e-3) for model in (true, plain)]
np.testing.assert_allclose(torque[0] - torque[1], 1e-3 * (reference + 5e-3) ** 3, atol=1e-9)
"""


def text_of(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the program, its byte code but not its compiled kernels, with the page's effect in it."""
    folder = tmp_path_factory.mktemp("copy")
    for part in ("autotune", "drivers", "sim", "config"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("*.nb?"))
    (shown,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    (folder / f"autotune/models/{NAME}.py").write_text(shown, encoding="utf-8")
    layout = folder / "autotune/models/layout.py"
    table = layout.read_text(encoding="utf-8")
    last = f'    "{EFFECT_NAMES[-1]}",\n'
    assert table.count(last) == 1
    layout.write_text(table.replace(last, f'{last}    "{NAME}",\n'), encoding="utf-8")
    return folder


def run(folder: Path, *arguments: str) -> str:
    """Python in the copy; its output. A failure shows what it said."""
    path = os.pathsep.join(str(folder / part) for part in ("", "drivers", "sim"))
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow(6)
def test_models_feedforward_and_show_know_the_effect(copied: Path) -> None:
    run(copied, "-c", KNOWN)
    shown = run(copied, "-m", "autotune.cli.main", "model", "show", "with.toml", "--html", "story.html")
    assert f"{NAME}.hardening" in shown
    assert f"+ {NAME}" in shown
    assert "stiffening spring" in (copied / "story.html").read_text(encoding="utf-8")


@pytest.mark.long  # compiles every kernel anew, with the effect in it
def test_the_effect_is_simulated_compared_fitted_added_diagnosed_and_fed_forward(copied: Path) -> None:
    run(copied, "-c", WORKS)
    page = (copied / "diagnosis.html").read_text(encoding="utf-8")
    assert "Missing: stiffening spring" in page
    assert "Give the cable or hose more length" in page


@pytest.mark.parametrize(("name", "path"), PLACES.items())
def test_every_list_is_where_the_page_says(name: str, path: str) -> None:
    assert f"`{name}`" in PAGE
    assert path in PAGE
    assert re.search(rf"^{name}\b.*= ", text_of(path), re.MULTILINE)


def test_every_list_that_the_page_names_is_looked_for_here() -> None:
    assert set(re.findall(r"`(_?[A-Z][A-Z_]{4,})`", PAGE)) == set(PLACES)


def test_kernels_and_traits_have_the_names_that_the_page_says() -> None:
    fields = {*Kind.__dataclass_fields__, *Kernels.__dataclass_fields__, *Parameter.__dataclass_fields__}
    named = re.findall(r"`(\w+)`", " ".join(re.findall(r"^- (?:The other traits|`\w+`.*|`n).*$", PAGE, re.M)))
    assert len(named) > 10
    modules = {path.stem for path in (ROOT / "autotune/models").glob("*.py")}
    assert set(named) <= fields | modules | {"Kind", "StartContext"}


@pytest.mark.parametrize("place", re.findall(r"\| `([a-z_]+(?:\.[a-z_]+)?)`", PAGE))
def test_physics_enters_where_the_page_says(place: str) -> None:
    module, _, function = place.partition(".")
    if place in Kernels.__dataclass_fields__:
        return
    if not function:
        assert (ROOT / f"autotune/models/{module}.py").is_file()
    else:
        assert f"\ndef {function}(" in text_of(f"autotune/models/{module}.py")


def test_the_number_of_effects_is_right() -> None:
    counted = re.search(r"The library has (\w+)\.", PAGE)
    assert counted is not None
    assert counted[1] == "sixteen"
    assert len(EFFECT_NAMES) == 16
