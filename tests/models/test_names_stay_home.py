"""An effect's name is written in its own module and in the table of effects, nowhere else in the program.

What other modules must know of an effect is a trait of its `Kind`. Where physics is particular to one effect (a map
of torque ripple, the steady-state curve with a Stribeck peak), the module imports that effect's `Kind`.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from autotune.models.layout import EFFECT_NAMES

ROOT = Path(__file__).resolve().parents[2]
TABLE = "autotune/models/layout.py"


def written(path: Path) -> Iterator[tuple[int, str]]:
    """Lines and names of effects in string literals: the name alone, or before a dot (`spring.stiffness`)."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            first, _, rest = node.value.partition(".")
            if first in EFFECT_NAMES and (not rest or " " not in rest):
                yield node.lineno, first


def modules() -> list[str]:
    files = [*(ROOT / "autotune").rglob("*.py"), *(ROOT / "drivers").rglob("*.py")]
    names = sorted(str(file.relative_to(ROOT)) for file in files)
    return [name for name in names if name != TABLE]


@pytest.mark.parametrize("module", modules())
def test_effects_are_named_at_home_only(module: str) -> None:
    path = ROOT / module
    own = path.stem if path.parent == ROOT / "autotune/models" else ""
    elsewhere = [f"{module}:{line}: {name!r}" for line, name in written(path) if name != own]
    assert not elsewhere, "ask a trait of its Kind, or import the Kind"


def test_a_name_would_be_seen(tmp_path: Path) -> None:
    guilty = tmp_path / "guilty.py"
    guilty.write_text(
        'LIST = ("spring", "torque_ripple.sin_1")\n"""spring of the contact"""\n', encoding="utf-8"
    )
    assert [name for _, name in written(guilty)] == ["spring", "torque_ripple"]
