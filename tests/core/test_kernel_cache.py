"""Processes that compile side by side never compute with machine code of older code or for other arguments."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest

from autotune.core import kernel_cache

TEXT = "def added(x):\n    return x + {}\n"


def _kernel(folder: Path, number: float) -> Any:
    """As a process has it that begins now; the code is that of its time."""
    file = folder / "source.py"
    file.write_text(TEXT.format(number))
    names: dict[str, Any] = {}
    exec(compile(file.read_text(), str(file), "exec"), names)
    return kernel_cache.kept(names["added"], hashlib.sha256(file.read_bytes()).hexdigest())


def test_another_process_reads_the_index_before_newer_code_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After an update two begin at once: numba has the index of the one before its machine code."""
    assert _kernel(tmp_path, 1.0)(1.0) == 2.0
    newer = _kernel(tmp_path, 2.0)
    with monkeypatch.context() as moment:
        moment.setattr(type(newer._cache._cache_file), "_save_data", lambda *_: None)
        assert newer(1.0) == 3.0
    assert _kernel(tmp_path, 2.0)(1.0) == 3.0


def test_machine_code_for_other_arguments_is_another_file(tmp_path: Path) -> None:
    """Two processes that read the index before either has written it; what the later one writes is its own."""
    one, two = _kernel(tmp_path, 1.0), _kernel(tmp_path, 1.0)
    names = {files._data_name(1) for files in (one._cache._cache_file, two._cache._cache_file)}
    assert len(names) == 2


def test_what_older_code_left_is_removed(tmp_path: Path) -> None:
    for number in (1.0, 2.0, 3.0):
        assert _kernel(tmp_path, number)(1.0) == 1.0 + number
    assert len(list(tmp_path.rglob("*.nbc"))) == 1


def test_a_later_process_finds_it(tmp_path: Path) -> None:
    _kernel(tmp_path, 1.0)(1.0)
    again = _kernel(tmp_path, 1.0)
    assert again(1.0) == 2.0
    assert sum(again.stats.cache_hits.values()) == 1
