"""What docs/adding-an-effect.md says of the code is so: the file shown, and every name where it is said to be."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from autotune.models.layout import EFFECT_NAMES

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/adding-an-effect.md").read_text(encoding="utf-8")
PLACES = {
    "EFFECT_NAMES": "autotune/models/layout.py",
    "EFFECTS": "autotune/models/table.py",
    "FAMILIES": "autotune/diagnose/starts.py",
    "_CHECKS": "autotune/diagnose/single_recording.py",
    "DYNAMIC": "autotune/diagnose/single_recording.py",
    "OF_PLACE": "autotune/diagnose/single_recording.py",
    "LOOP_LIKE": "autotune/estimation/controller_torque.py",
    "TWO_MASSES": "autotune/diagnose/candidates.py",
    "STARTED": "autotune/identify/fit.py",
    "FED_FORWARD": "autotune/control/model_feedforward.py",
    "LEFT_OUT": "autotune/control/model_feedforward.py",
    "SEPARATIONS": "autotune/diagnose/wording.py",
    "VALUES": "tests/models/test_effects.py",
    "MEDIUM": "bench/diagnosis.py",
}


def text_of(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def test_the_file_shown_is_the_whole_file() -> None:
    (shown,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert shown == text_of("autotune/models/spring.py")


@pytest.mark.parametrize(("name", "path"), PLACES.items())
def test_every_list_is_where_the_page_says(name: str, path: str) -> None:
    assert f"`{name}`" in PAGE
    assert Path(path).name in PAGE
    assert re.search(rf"^{name}\b.*= ", text_of(path), re.MULTILINE)


def test_every_list_that_the_page_names_is_looked_for_here() -> None:
    assert set(re.findall(r"`(_?[A-Z][A-Z_]{4,})`", PAGE)) == set(PLACES)


@pytest.mark.parametrize("place", re.findall(r"\| `([a-z_]+(?:\.[a-z_]+)?)`", PAGE))
def test_physics_enters_where_the_page_says(place: str) -> None:
    module, _, function = place.partition(".")
    if not function:
        assert (ROOT / f"autotune/models/{module}.py").is_file()
    else:
        assert f"\ndef {function}(" in text_of(f"autotune/models/{module}.py")


def test_the_number_of_effects_is_right() -> None:
    counted = re.search(r"The library has (\w+);", PAGE)
    assert counted is not None
    assert counted[1] == "sixteen"
    assert len(EFFECT_NAMES) == 16
