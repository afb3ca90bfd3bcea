"""`make lint`: how long functions are, and in how many modules the estimation lives.

What ruff does not count: lines of a function, docstring included, and modules of the packages that a reader of the
estimation has to know.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

MOST_LINES = 60
MOST_MODULES = 65
COUNTED = ("autotune/estimation", "autotune/identify", "autotune/diagnosis")
PARTS = ("autotune", "drivers", "sim", "bench", "tests")


def long_functions(root: Path) -> Iterator[str]:
    """Functions above `MOST_LINES`, by place."""
    for path in sorted(path for part in PARTS for path in (root / part).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > MOST_LINES:
                    yield f"{path.relative_to(root)}:{node.lineno}: {node.name} has {lines} lines"


def modules(root: Path) -> dict[str, int]:
    """How many modules each of the counted packages has, `__init__` left out."""
    return {part: sum(path.name != "__init__.py" for path in (root / part).rglob("*.py")) for part in COUNTED}


def main() -> int:
    root = Path(__file__).resolve().parents[1]
    found = list(long_functions(root))
    counts = modules(root)
    total = sum(counts.values())
    print("\n".join(found) or f"no function has more than {MOST_LINES} lines")
    print(", ".join(f"{part} {count}" for part, count in counts.items()), f"= {total} modules")
    if total > MOST_MODULES:
        print(f"{MOST_MODULES} modules at most: merge what belongs together")
    return 1 if found or total > MOST_MODULES else 0


if __name__ == "__main__":
    sys.exit(main())
