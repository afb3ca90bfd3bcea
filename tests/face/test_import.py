"""Importing autotune is free: nothing heavy is loaded, nothing in the process is changed."""

from __future__ import annotations

import json
import subprocess
import sys

HEAVY = {
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "pyarrow",
    "pandas",
    "rich",
    "typer",
    "plotly",
    "rerun",
    "pydantic",
}


def _afterwards(statement: str) -> dict[str, list[str]]:
    """Modules loaded and environment changed by a statement, in an interpreter of its own."""
    code = (
        "import json, os, sys\nbefore = dict(os.environ)\n"
        f"{statement}\n"
        "changed = sorted(k for k in before.keys() | os.environ.keys() if before.get(k) != os.environ.get(k))\n"
        "loaded = sorted({name.partition('.')[0] for name in sys.modules})\n"
        "own = sorted(name for name in sys.modules if name.startswith('autotune.'))\n"
        "print(json.dumps({'loaded': loaded, 'changed': changed, 'own': own}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def test_importing_autotune_loads_nothing_heavy_and_sets_nothing() -> None:
    found = _afterwards("import autotune; dir(autotune); autotune.__version__")
    assert not HEAVY & set(found["loaded"])
    assert found["changed"] == []
    assert found["own"] == []


def test_importing_the_command_line_sets_nothing_either() -> None:
    found = _afterwards("import autotune.cli.main")
    assert not (HEAVY - {"typer"}) & set(found["loaded"])
    assert found["changed"] == []


def test_help_loads_no_command() -> None:
    found = _afterwards(
        "import io, contextlib, autotune.cli.main as cli\n"
        "with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit): cli.main(['--help'])"
    )
    assert not (HEAVY - {"typer", "rich"}) & set(found["loaded"])
    assert not {f"autotune.cli.{name}" for name in ("run", "model", "data", "serve")} & set(found["own"])
