"""The pages about exports: every command they show is run, and no page is longer than a screen."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from autotune.export.request import Request
from autotune.export.structured_text import export_st
from autotune.export.targets import TARGETS
from autotune.models.model_file import read_model
from tests.export.linuxcnc_rig import MODULES, alone, end_realtime, needs_linuxcnc
from tests.support.commands import called

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs/export"
MODEL = ROOT / "tests/export/models/seed-3.toml"
SCREEN = 50
"""Lines."""


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (PAGES / page).read_text(encoding="utf-8"), re.DOTALL)


def commands(page: str) -> list[list[str]]:
    return [shlex.split(line) for block in blocks(page, "sh") for line in block.splitlines()]


def run(folder: Path, command: list[str]) -> str:
    """Runs one command of a page as a person in that folder would."""
    if command[0] == "autotune":
        done = called(*command[1:], folder=folder)
    else:
        line = command[1:] if command[0] == "sudo" else command
        done = subprocess.run(line, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(MODEL, tmp_path / "axis.toml")
    return tmp_path


def test_every_target_has_its_page_and_it_fits_a_screen() -> None:
    assert {path.stem for path in PAGES.glob("*.md")} == {"README", *TARGETS}
    for path in PAGES.glob("*.md"):
        lines = path.read_text(encoding="utf-8").splitlines()
        assert len(lines) <= SCREEN, path
        for asked in ("Where", "In:", "Out:", "See that it acts", "Switch it off"):
            assert path.stem == "README" or any(f"**{asked}" in line for line in lines), (path, asked)


def test_the_call_in_the_page_about_structured_text_fits_the_block() -> None:
    """Read by somebody else's parser, with inputs and outputs that the block has; and its scaling is right."""
    parse = pytest.importorskip("blark.parse").parse_source_code
    (snippet,) = blocks("st.md", "iecst")
    block = export_st(Request(read_model(MODEL), "a model", 1e-3)).files["autotune_ff.st"].decode("ascii")
    around = (
        "PROGRAM main\nVAR\nff : autotune_ff;\nenabled : BOOL;\nq, v, a, rated_torque : LREAL;\n"
        f"torque_offset : INT;\nEND_VAR\n{snippet}\nEND_PROGRAM\n"
    )
    found = parse(around)
    assert found.exception is None
    assert type(found.transform().items[0]).__name__ == "Program"
    call, scaled = snippet.strip().splitlines()
    variables = {
        kind: re.findall(r"^\s*(\w+) :", part, re.MULTILINE)
        for kind, part in re.findall(r"VAR_(INPUT|OUTPUT)(.*?)END_VAR", block, re.DOTALL)
    }
    assert set(re.findall(r"(\w+) :=", call)) == set(variables["INPUT"]) - {"reset"}
    assert set(re.findall(r"ff\.(\w+)", snippet)) <= set(variables["OUTPUT"])
    functions = {
        "LREAL_TO_INT": round, "LIMIT": lambda low, value, high: min(max(value, low), high), "rated_torque": 0.5,
    }  # fmt: skip
    expression = scaled.partition(":= ")[2].rstrip(";")
    for torque, told in ((0.1, 200), (-0.05, -100), (100.0, 32767), (-100.0, -32767)):
        assert eval(expression, {**functions, "ff": SimpleNamespace(torque=torque)}) == told


@pytest.mark.parametrize("target", ["st", "twincat-table", "csv"])
def test_commands_that_only_export(folder: Path, target: str) -> None:
    for command in commands(f"{target}.md"):
        run(folder, command)
    named = re.findall(r"`(made/[\w.]+)`", (PAGES / f"{target}.md").read_text(encoding="utf-8"))
    assert named
    assert all((folder / name).is_file() for name in named)


def test_c(folder: Path) -> None:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    for command in commands("c.md"):
        run(folder, command)
    (folder / "page.c").write_text(blocks("c.md", "c")[0])
    run(folder, ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-I", "made", "-c", "page.c"])
    assert (folder / "page.o").stat().st_size > 0


def test_fmu(folder: Path) -> None:
    pytest.importorskip("fmpy")
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    for command in commands("fmu.md"):
        run(folder, command)
    largest, gain = run(folder, [sys.executable, "-c", blocks("fmu.md", "python")[0]]).split()[-2:]
    assert 0.2 < float(largest) < 0.6
    assert float(gain) == 1.0


@pytest.mark.slow
@pytest.mark.long
def test_linuxcnc(folder: Path) -> None:
    needs_linuxcnc()
    installed = MODULES / "autotune_ff.so"
    with alone():
        if installed.exists():
            pytest.skip(f"{installed} is somebody's")
        try:
            for command in commands("linuxcnc.md"):
                run(folder, command)
            said = _in_hal(folder, blocks("linuxcnc.md", "hal"))
        finally:
            installed.unlink(missing_ok=True)
    gains = [float(one) for one in re.findall(r"float OUT +(\S+) +autotune-ff\.0\.gain", said)]
    assert gains == pytest.approx([1.0, 0.0]), said


def _in_hal(folder: Path, shown: list[str]) -> str:
    """What the page's HAL lines print, with a thread, the component and a pid as they would be there."""
    before = [
        "loadrt threads name1=servo-thread period1=1000000", "loadrt pid names=pid.x", "loadrt autotune_ff",
        "addf autotune-ff.0 servo-thread", "newsig x-enable bit", "net x-enable autotune-ff.0.enable",
        "sets x-enable TRUE", "start", "loadusr -w sleep 1",
    ]  # fmt: skip
    after = ["loadusr -w sleep 1", "show pin autotune-ff.0"]
    (folder / "page.hal").write_text("\n".join([*before, *"".join(shown).splitlines(), *after]) + "\n")
    environment = os.environ | {"HOME": str(folder), "RTAPI_FIFO_PATH": str(folder / "fifo")}
    command = ["halrun", "-f", "page.hal"]
    if os.getuid() == 0:
        for path in (folder, *folder.parents):
            if path.parts[:2] == ("/", "tmp") and len(path.parts) > 2:
                path.chmod(0o755)
        os.chown(folder, 65534, 65534)
        command = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", *command]
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=240, check=False
        )
    finally:
        end_realtime(environment["RTAPI_FIFO_PATH"])
    assert done.returncode == 0, done.stderr
    return done.stdout
