"""docs/python.md: every snippet is short, and runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import autotune

PAGE = Path(__file__).parents[2] / "docs" / "python.md"
LONGEST = 15
"""Lines that are not empty: more is no longer read at a glance."""


def _snippets() -> list[tuple[str, str]]:
    """Heading and text of each Python block."""
    found = []
    for section in PAGE.read_text(encoding="utf-8").split("\n## ")[1:]:
        title = section.split("\n", 1)[0]
        found += [(title, code) for code in re.findall(r"```python\n(.*?)```", section, re.DOTALL)]
    return found


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording of 10 s, a model of it, and a file as a scope writes it."""
    folder = tmp_path_factory.mktemp("python")
    recording = autotune.simulate("sim://edm-vertical?seed=3", programme="high-speed")
    autotune.write_recording(recording, folder / "axis.parquet")
    fitted = autotune.fit(recording)
    assert fitted.model is not None
    autotune.write_model(fitted.model, folder / "model.toml")
    table = [recording["time"], np.degrees(recording["position"]), recording["torque"] / 0.05]
    header = "time,angle,current"
    np.savetxt(folder / "scope.csv", np.column_stack(table)[:3000], "%.9g", ",", header=header, comments="")
    return folder


def test_every_topic_is_shown_in_a_few_lines() -> None:
    titles = {title for title, _ in _snippets()}
    assert titles == {"Load", "Fit", "Compare", "Diagnose", "Add", "Plot", "Simulate", "Tune"}
    assert all(len([x for x in code.splitlines() if x.strip()]) < LONGEST for _, code in _snippets())


@pytest.mark.parametrize(
    ("title", "code"),
    [
        pytest.param(
            title,
            code,
            id=f"{title}-{number}",
            marks=[pytest.mark.slow, pytest.mark.long] * (title == "Tune"),
        )
        for number, (title, code) in enumerate(_snippets())
    ],
)
def test_a_snippet_runs(
    title: str,
    code: str,
    prepared: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(prepared)
    names: dict[str, object] = {}
    exec(compile(code, f"{PAGE.name}: {title}", "exec"), names)
    assert capsys.readouterr().out or (prepared / "mine.html").is_file()
    if title == "Tune":
        result = names["result"]
        assert isinstance(result, autotune.RunResult)
        assert result.outcome.value == "kept"
    if title == "Diagnose":
        found = names["found"]
        assert isinstance(found, autotune.DiagnosisResult)
        assert found.verdict in ("named", "none", "unknown", "ambiguous")
