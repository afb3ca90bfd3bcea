"""Files that a parser takes and nothing after it can hold are refused in words, wherever they are read."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from autotune.core.axis import read_axis
from autotune.core.configuration import read_toml
from autotune.core.documents import DEEPEST, parse_json, parse_toml
from autotune.core.errors import ConfigurationError
from autotune.models.model_file import read_model
from autotune.tuning.backup import load_backup
from autotune.tuning.files import checksum, read_json
from autotune.tuning.journal import Journal

DEEP = 100_000
JSON_CASES = {
    "deep lists": ('{"a":' + "[" * DEEP + "]" * DEEP + "}", "nested deeper than 64"),
    "deep objects": ('{"a":' * 90 + "1" + "}" * 90, "nested deeper than 64"),
    "6000 digits": ('{"a": ' + "9" * 6000 + "}", "damaged"),
    "400 digits": ('{"a": ' + "9" * 400 + "}", "integer of 1329 bits"),
    "nan": ('{"a": NaN}', "NaN, which is no number"),
    "infinity": ('{"a": -Infinity}', "-Infinity, which is no number"),
    "too large": ('{"a": 1e999}', "1e999, which is too large"),
    "no object": ("[1]", "not an object"),
}
TOML_CASES = {
    "deep lists": ("a = " + "[" * 9000, "TOML"),
    "deep tables": ("[" + ".".join("a" * 80) + "]\nx = 1", "nested deeper than 64"),
    "dotted key": (".".join("a" * 20_000) + " = 1", "a line has 40003 characters"),
    "6000 digits": ("a = " + "9" * 6000, "TOML"),
    "400 digits": ("a = " + "9" * 400, "integer of 1329 bits"),
    "nan": ("a = nan", "must be a finite number"),
    "infinity": ("a = [1.0, inf]", "must be a finite number"),
}


@pytest.mark.parametrize(("text", "message"), JSON_CASES.values(), ids=JSON_CASES)
def test_json_that_no_program_can_hold_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "some.json"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=message):
        read_json(path, "journal")


@pytest.mark.parametrize("read", [lambda path: read_toml(path, "file"), read_axis, read_model])
@pytest.mark.parametrize(("text", "message"), TOML_CASES.values(), ids=TOML_CASES)
def test_toml_that_no_program_can_hold_is_refused(
    tmp_path: Path, read: Callable[[Path], object], text: str, message: str
) -> None:
    path = tmp_path / "some.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=message) as caught:
        read(path)
    assert len(str(caught.value)) < 1000


def test_what_the_program_writes_is_far_from_the_bounds() -> None:
    nested: dict[str, object] = {"value": -1.5e300, "count": 2**63, "text": "NaN"}
    for _ in range(DEEPEST // 2):
        nested = {"level": nested, "list": [nested]}
        if len(json.dumps(nested)) > 100_000:
            break
    assert parse_json(json.dumps(nested)) == nested
    assert parse_toml("[a.b]\nc = 1e-300\nd = [[1, 2], [3]]") == {
        "a": {"b": {"c": 1e-300, "d": [[1, 2], [3]]}}
    }


def test_a_large_file_is_refused_by_its_size(tmp_path: Path) -> None:
    for name, size, read in (
        ("large.toml", 5_000_000, lambda path: read_toml(path, "axis file")),
        ("large.json", 65_000_000, lambda path: read_json(path, "journal")),
    ):
        path = tmp_path / name
        with path.open("wb") as file:
            file.truncate(size)  # sparse
        with pytest.raises(ConfigurationError, match=f"has {size // 1_000_000} MB"):
            read(path)


def test_unknown_keys_and_values_of_any_length_make_short_sentences(tmp_path: Path) -> None:
    path = tmp_path / "axis.toml"
    escapes = "\\u001b[2J" * 300
    path.write_text("\n".join(f'"{"k" * 500}{number}" = "{escapes}"' for number in range(500)))
    with pytest.raises(ConfigurationError) as caught:
        read_axis(path)
    assert len(str(caught.value)) < 8000
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "change",
    [
        {"changed": {"torque_limit": "high"}},
        {"changed": {"torque_limit": None}},
        {"changed": [1, 2]},
        {"written": {"stiffness": True}},
        {"phase": "half"},
        {"process": "one"},
        {"axis": 5},
        {"surprise": 1},
    ],
)
def test_a_journal_with_anything_but_numbers_to_put_back_is_damaged(
    tmp_path: Path, change: dict[str, object]
) -> None:
    """Recovery writes `changed` and `written` to a drive."""
    sound = {
        "schema": 1, "axis": "z", "fingerprint": "f", "started": "2026-01-01", "process": 1, "stage": "fit",
        "changed": {"torque_limit": 1.5}, "backup": "", "phase": "none", "written": {}, "outcome": "",
    }  # fmt: skip
    (tmp_path / "journal.json").write_text(json.dumps(sound))
    assert Journal.load(tmp_path).state.changed == {"torque_limit": 1.5}
    (tmp_path / "journal.json").write_text(json.dumps(sound | change))
    with pytest.raises(ConfigurationError, match="is damaged"):
        Journal.load(tmp_path)


@pytest.mark.parametrize("parameters", [{"gain": "much"}, None, [1.0], {"gain": False}])
def test_a_backup_holds_numbers_only(tmp_path: Path, parameters: object) -> None:
    folder = tmp_path / "backups" / "z"
    folder.mkdir(parents=True)
    content = {"schema": 1, "axis": "z", "taken": "now", "identity": {}, "parameters": parameters}
    (folder / "20260101-000000-1.json").write_text(json.dumps(content | {"checksum": checksum(content)}))
    with pytest.raises(ConfigurationError, match="is damaged"):
        load_backup(tmp_path, "z", "20260101-000000-1")
