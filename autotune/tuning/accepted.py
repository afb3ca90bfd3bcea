"""Drift that is known and accepted: measured by a whole run, which found nothing that this drive could do better.

What is committed stays in the drive. What checks compare with from then on is the model that the run
identified, so that the same change is not told night after night, and a further one is. Each acceptance
rests on a proof against what is committed, so that many small ones cannot hide a loss.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from autotune.core.axis import Axis
from autotune.tuning.files import write_json
from autotune.tuning.results import run_results

FILE_NAME = "accepted.json"
SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True)
class Accepted:
    """The run that found nothing better, and the peak error that it measured with what is committed."""

    directory: Path
    peak_error: float


def accept(directory: Path, axis: Axis, committed: str, peak_error: float) -> None:
    """Notes in a run's folder that the axis as it found it is accepted.

    Args:
        committed: the run that the drive holds the parameters of.
        peak_error: with them [motion unit].
    """
    content: Mapping[str, object] = {
        "schema": SCHEMA_VERSION,
        "axis": axis.name,
        "fingerprint": axis.fingerprint,
        "committed": committed,
        "peak_error": peak_error,
    }
    write_json(directory / FILE_NAME, dict(content))


def accepted_since(runs: Path, axis: Axis, committed: str) -> Accepted | None:
    """The newest acceptance of what was committed in a run; None where there is none."""
    for directory, content in run_results(runs, axis.name, FILE_NAME):
        if directory.name <= committed:
            break
        peak = content.get("peak_error")
        same = (content.get("fingerprint"), content.get("committed")) == (axis.fingerprint, committed)
        if same and isinstance(peak, (int, float)):
            return Accepted(directory, float(peak))
    return None
