"""The Makefile's targets name folders that there are, and each long test belongs to one of them."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def listed(name: str) -> list[Path]:
    """Paths that a variable of the Makefile holds, below `tests`."""
    found = re.search(rf"^{name} := (.*)$", MAKEFILE, re.MULTILINE)
    assert found, name
    return [ROOT / "tests" / word for word in found[1].split()]


def recipe(target: str) -> str:
    found = re.search(rf"^{target}:.*\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)
    assert found, target
    return found[1]


def test_what_a_target_names_is_there() -> None:
    for name in ("QUICK", "HURT", "LINUXCNC", "ALONE"):
        for path in listed(name):
            assert path.exists(), f"{name} names {path}"
    for word in re.findall(r"(?<![\w/=-])tests/[\w/.]+", MAKEFILE):
        assert (ROOT / word).exists(), word


def test_what_one_half_leaves_out_the_other_runs() -> None:
    assert "$(WIRED:%=tests/%) $(ALONE:%=--ignore=tests/%)" in recipe("wired")
    assert "$(COMPUTED:%=tests/%) $(ALONE:%=tests/%)" in recipe("computed")
    for path in listed("ALONE"):
        assert (ROOT / "tests" / path.relative_to(ROOT / "tests").parts[0]) in listed("WIRED")


def test_a_long_test_is_run_by_exactly_one_target() -> None:
    """`long` takes all of `tests` but what the two others take, and these take nothing twice."""
    for name in ("HURT", "LINUXCNC"):
        assert f"$({name}:%=--ignore=tests/%)" in recipe("long")
    assert "-m long tests " in recipe("long")
    assert "-m '' $(HURT:%=tests/%)" in recipe("faults")
    assert "-m '' -rs $(LINUXCNC:%=tests/%)" in recipe("linuxcnc")
    for path in listed("LINUXCNC"):
        assert not any(path.is_relative_to(folder) for folder in listed("HURT"))
