"""Rows as tables for people: a pandas frame where pandas is installed, a plain table in a notebook."""

from __future__ import annotations

import html
import importlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from autotune.core.errors import ConfigurationError

if TYPE_CHECKING:
    import pandas as pd


def frame(rows: Sequence[Mapping[str, Any]] | Mapping[str, Any], index: str | None = None) -> pd.DataFrame:
    """The rows (or columns) as a pandas table.

    Raises:
        ConfigurationError: pandas is not installed.
    """
    try:
        pandas = importlib.import_module("pandas")
    except ImportError:
        raise ConfigurationError(
            "to_frame() needs pandas, which is not installed: pip install pandas; to_json() has the same facts"
        ) from None
    table: pd.DataFrame = pandas.DataFrame(rows)
    return table.set_index(index) if index is not None else table


def html_table(caption: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """An HTML table under a caption; numbers to five digits, everything escaped."""
    if not rows:
        return f"<p>{html.escape(caption)}</p>"
    head = "".join(f"<th>{html.escape(name.replace('_', ' '))}</th>" for name in rows[0])
    body = "".join(f"<tr>{''.join(f'<td>{_cell(cell)}</td>' for cell in row.values())}</tr>" for row in rows)
    return f"<table><caption>{html.escape(caption)}</caption><tr>{head}</tr>{body}</table>"


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return html.escape(f"{value:.5g}" if isinstance(value, float) else str(value))
