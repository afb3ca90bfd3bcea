"""What a run's report says of iterative learning, where it was done on this axis (`autotune catalogue --ceiling`)."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Any

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.tuning.files import read_json
from autotune.tuning.findings import latest_run

FILE = "ceiling.json"
"""In the folder of the command's own run."""


def ceiling_note(runs: Path, axis: Axis, peak_error: float) -> str:
    """How near this run's `peak_error` [rad or m] comes to what learning left; "" where learning was never done."""
    try:
        content = read_json(latest_run(runs, axis, FILE) / FILE, "ceiling")
    except ConfigurationError:
        return ""
    learnt, count = _number(content.get("learnt")), axis.position_resolution
    if content.get("fingerprint") != axis.fingerprint or learnt <= 0.0:
        return ""
    when, unit = str(content.get("measured", ""))[:10], axis.motion_unit
    return (
        f"Iterative learning, the least that any feedforward could leave, took the benchmark's peak error on this axis "
        f"to {1e3 * learnt:.3g} m{unit} ({when}); with this run's parameters it is {1e3 * peak_error:.3g} m{unit}, "
        f"{(peak_error - learnt) / count:+.1f} counts of the encoder."
    )


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float)) and isfinite(value) else 0.0
